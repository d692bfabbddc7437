// bolo diagnose: the gap between simulator and camera, its causes, and how to close it.
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include <unistd.h>

#include "src/capture/pixel_maps_io.hpp"
#include "src/core/text.hpp"
#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/report.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using Given = cxxopts::ParseResult;

cxxopts::Options diagnose_options() {
  using Words = std::vector<std::string>;
  cxxopts::Options options("bolo diagnose",
                           "Measure the gap between simulator and camera, name its causes and how far each closes it.\n"
                           "Give all captures of one bench session together: shutter, flats, chopper, pans, target.");
  add_option<std::string>(options, "o,output", "Folder for report.json and report.html", nullptr, "DIR");
  add_option<std::string>(options, "profile", "Nominal camera of the simulator, maps included (default: a655sc)",
                          nullptr, "P.toml");
  add_option<Words>(options, "withhold", "Remove an effect from the catalogue; repeatable", nullptr, "EFFECT");
  add_option<std::string>(options, "write-profile",
                          "Write the profile that undoes the diagnosed effects; per-pixel maps go into P2-maps.h5",
                          nullptr, "P2.toml");
  add_option<int>(options, "threads", "Worker threads", "2");
  add_option<bool>(options, "json", "Print report.json");
  add_option<Words>(options, "capture", "");
  add_overwrite_option(options);
  options.parse_positional({"capture"});
  options.positional_help("CAPTURE.h5...");
  return options;
}

Result<diagnose::Options> options_of(const Given& given) {
  diagnose::Options options;
  ASSIGN_OR_RETURN(options.threads, number_of<int>(given, "threads", 1, 64));
  if (given.count("withhold") != 0) options.withheld = given["withhold"].as<std::vector<std::string>>();
  options.maps = given.count("write-profile") != 0;
  if (given.count("profile") == 0) return options;
  ASSIGN_OR_RETURN(options.profile, model::read_profile(given["profile"].as<std::string>()));
  return options;
}

// Prints each step on stderr; on a terminal overwriting one line. Otherwise nothing before all captures are read: then
// an unreadable one prints a single line.
class Steps {
 public:
  Steps() : terminal_(isatty(STDERR_FILENO) == 1) {}
  ~Steps() {
    if (terminal_ && !step_.empty()) std::fputc('\n', stderr);
  }
  Steps(const Steps&) = delete;
  Steps& operator=(const Steps&) = delete;

  void update(const std::string& step, double done) {
    const int percent = static_cast<int>(100.0 * done);
    if (!terminal_ && (step == step_ || step == "reading")) return;
    if (step == step_ && percent == percent_) return;
    step_ = step;
    percent_ = percent;
    std::fprintf(stderr, terminal_ ? "\r\033[Kdiagnose: %3d %%  %s" : "diagnose: %3d %%  %s\n", percent, step.c_str());
  }

 private:
  bool terminal_;
  std::string step_;
  int percent_ = -1;
};

void print_profile(const std::filesystem::path& file, const model::CameraProfile& before,
                   const model::CameraProfile& after) {
  const std::vector<std::string> changes = model::changes(before, after);
  std::cout << "  profile     " << printable(file.string()) << (changes.empty() ? ", nothing in it changed" : "")
            << '\n';
  for (const std::string& change : changes) std::cout << "              " << change << '\n';
}

Status run_diagnose(const Given& given) {
  if (given.count("output") == 0) return bad_input("no folder for the report; give -o DIR");
  const std::vector<std::filesystem::path> captures = files_of(given, "capture");
  if (captures.empty()) return bad_input("which captures? give those of one session, CAPTURE.h5...");
  ASSIGN_OR_RETURN(const diagnose::Options options, options_of(given));

  const std::filesystem::path folder = given["output"].as<std::string>();
  const std::filesystem::path profile = options.maps ? given["write-profile"].as<std::string>() : "";
  if (options.maps && profile.empty()) return bad_input("no file for the profile; give --write-profile P2.toml");
  const std::filesystem::path maps = options.maps ? capture::maps_beside(profile) : "";
  const Replace replace = replace_of(given);
  std::vector<std::filesystem::path> inputs = captures;
  if (given.count("profile") != 0) {
    inputs.insert(inputs.end(), {given["profile"].as<std::string>(), options.profile.maps});
  }
  std::vector<std::filesystem::path> outputs = diagnose::report_files(folder);
  outputs.insert(outputs.end(), {profile, maps});
  ASSIGN_OR_RETURN(const auto made, OutputFolder::make(folder));
  RETURN_IF_ERROR(check_outputs(outputs, inputs, replace));

  Result<diagnose::Report> report = [&] {
    Steps steps;
    return diagnose::diagnose(captures, options, [&steps](const std::string& step, double done) {
      steps.update(step, done);
      return !interrupted().load(std::memory_order_relaxed);
    });
  }();
  if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted; no report was written");
  if (!report) return tl::unexpected(report.error());
  RETURN_IF_ERROR(diagnose::write_report(*report, folder, replace));
  if (!profile.empty()) {
    RETURN_IF_ERROR(
        capture::write_profile_files({profile, replace}, maps, report->learned.profile, report->learned.maps));
  }
  if (given.count("json") != 0) {
    std::cout << diagnose::report_json(*report) << '\n';
    return {};
  }
  std::cout << diagnose::report_summary(*report) << "  report      " << printable((folder / "report.html").string())
            << '\n';
  if (!profile.empty()) print_profile(profile, options.profile, report->learned.profile);
  return {};
}

}  // namespace

int diagnose_main(int argc, char** argv) { return run_verb("diagnose", diagnose_options(), argc, argv, run_diagnose); }

}  // namespace bolo::tools
