// A stand-in for `bolo` with two verbs: its diagnosis has a constant result and records the process' environment.
#include <filesystem>
#include <fstream>
#include <sstream>

#include "src/capture/capture.hpp"
#include "src/diagnose/diagnose.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::diagnose {
namespace {

std::string contents(const char* file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

// Records arguments, environment, open files, and the files in the captures' folder.
void write_down(const std::filesystem::path& folder) {
  std::ofstream out(folder / "seen.txt");
  out << contents("/proc/self/cmdline") << '\n' << contents("/proc/self/environ") << '\n';
  out << "cwd " << std::filesystem::current_path().string() << '\n';
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    const auto target = std::filesystem::read_symlink(entry.path(), gone);
    if (!gone) out << "fd " << target.string() << '\n';
  }
  for (const auto& entry : std::filesystem::directory_iterator(folder)) out << "file " << entry.path().string() << '\n';
}

}  // namespace

Result<Report> diagnose(const std::vector<std::filesystem::path>& captures, const Options& options,
                        const Progress& progress) {
  Report report;
  report.withheld = options.withheld;
  for (const auto& file : captures) {
    const auto reader = capture::CaptureReader::open(file);
    if (!reader) return tl::unexpected(reader.error());
    report.frames += reader->info().frames;
    report.inputs.push_back(file.string());
    if (!progress("reading", 0.5) || !progress("noise", 0.6)) return bad_input("stopped");
  }
  write_down(captures.front().parent_path());
  const bool unknown = !options.withheld.empty();
  report.verdict = unknown ? "unknown_effect" : "explained";
  report.gap.before = 3.0;
  report.gap.after = unknown ? 3.0 : 1.0;
  report.closed_fraction = unknown ? 0.0 : 1.0;
  if (!unknown) {
    report.effects = {{"row_delay", "readout", 0.99, 3.0, 1.0, false, {{"row_delay_s", {2.8e-5, 0.0, 1e-4}}}, {}}};
  }
  report.learned.profile = options.profile;
  report.learned.profile.row_delay_s = unknown ? 0.0 : 2.8e-5;
  if (options.maps) {
    report.learned.maps.geometry = {2, 1};
    report.learned.maps.offset = {0.25F, -0.5F};
  }
  report.unexplained = {unknown ? 0.001 : 0.5, unknown ? "pixel" : "", ""};
  return report;
}

}  // namespace bolo::diagnose

int main(int argc, char** argv) {
  const std::string_view verb = argc > 1 ? argv[1] : "";
  if (verb == "diagnose") return bolo::tools::diagnose_main(argc - 1, argv + 1);
  if (verb == "blind") bolo::tools::set_program_name("bolo-lab");
  if (verb == "blind") return bolo::tools::blind_main(argc - 1, argv + 1);
  return 2;
}
