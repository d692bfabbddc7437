#include "src/diagnose/diagnose.hpp"

#include <chrono>

#include "diagnosis.hpp"

namespace bolo::diagnose {

Result<Report> diagnose(const std::vector<std::filesystem::path>& captures, const Options& options,
                        const Progress& progress) {
  for (const std::string& name : options.withheld) {
    if (find_effect(name) == nullptr)
      return bad_input("--withhold " + name + ": no effect of the catalogue has this name");
  }
  const auto start = std::chrono::steady_clock::now();
  auto session = read_session(captures, progress);
  if (!session) return tl::unexpected(session.error());
  Diagnosis diagnosis(std::move(*session), options, progress);
  auto report = diagnosis.run();
  if (report) {
    auto learned = diagnosis.learn(captures, *report);
    if (!learned) return tl::unexpected(learned.error());
    report->learned = std::move(*learned);
  }
  if (report) report->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace bolo::diagnose
