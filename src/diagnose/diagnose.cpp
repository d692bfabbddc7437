#include "src/diagnose/diagnose.hpp"

#include <chrono>

#include "src/diagnose/learn.hpp"
#include "src/diagnose/stages.hpp"

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
  if (!progress("events and pixels", 0.03)) return failed("interrupted");
  const Events events = find_events(std::move(*session), options);
  if (!progress("noise", 0.06)) return failed("interrupted");
  const Noise noise = judge_noise(events, options);
  const auto fit = fit_means(events, noise, options, progress);
  if (!fit) return tl::unexpected(fit.error());
  std::vector<Remainder> left;
  if (fit->done) {
    if (!progress("looking at what is left", 0.85)) return failed("interrupted");
    left = test_remainder(events, noise, *fit, options.threads);
  }
  Report report = make_report(events, noise, *fit, left, options);
  auto learned = learn({fit->session, fit->done ? &fit->state : nullptr, fit->jumps, events.bad,
                        noise.statistics.filter, report.effects, options.profile},
                       captures, options, progress);
  if (!learned) return tl::unexpected(learned.error());
  report.learned = std::move(*learned);
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace bolo::diagnose
