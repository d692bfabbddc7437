// `bolo-lab soak`: everything that goes wrong on a vehicle, for as long as one likes.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <iostream>

#include "bolo/client.h"
#include "src/report/sheet.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/soak/reader.hpp"
#include "tools/lab/soak/report.hpp"
#include "tools/lab/soak/run.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kVerb = "soak";
constexpr double kShortest_s = 10.0;
constexpr double kLongest_s = 86400.0;
constexpr double kDefault_s = 120.0;

struct Request {
  soak::SoakRequest soak;
  fs::path report;
  Replace replace = Replace::kNothing;
  bool json = false;
  bool only_schedule = false;
};

cxxopts::Options make_options() {
  cxxopts::Options options(
      "bolo-lab soak",
      "Run a fake camera, bolod and readers for a long time while everything goes wrong that can,\n"
      "and check all the time that every frame is accounted for, every pixel right, and nothing\n"
      "grows. Exit code 1: something did not hold. A daemon of this computer is not touched.\n");
  options.add_options()                                                      //
      ("seconds", "How long (default: 120)", cxxopts::value<double>(), "S")  //
      ("minutes", "The same in minutes", cxxopts::value<double>(), "M")      //
      ("shortened", "A small camera (64x24), for a build's checks")          //
      ("seed", "Another one draws other times, orders and sizes", cxxopts::value<std::uint64_t>()->default_value("1"),
       "N")                                                                                             //
      ("size", "Frames", cxxopts::value<std::string>()->default_value("640x120"), "WxH")                //
      ("rate", "Frames a second", cxxopts::value<double>()->default_value("200"), "HZ")                 //
      ("config", "bolod's configuration; source, name and profile's drop_repeated are the soak's own",  //
       cxxopts::value<std::string>()->default_value(""), "FILE")                                        //
      ("only", "These kinds of trouble only; may be given again (--schedule shows all)",                //
       cxxopts::value<std::string>(), "KIND")                                                           //
      ("step-clock", "Set this computer's clock by 2 s and back, too; as root")                         //
      ("latency-ms", "Most that 99 % of the frames of quiet times may take",                            //
       cxxopts::value<double>()->default_value("100"), "MS")                                            //
      ("report", "Folder for report.html, report.json and the daemon's log",
       cxxopts::value<std::string>()->default_value(""),                                                   //
       "DIR")                                                                                              //
      ("schedule", "Print what would happen when, and end")                                                //
      ("json", "Print the report as JSON, without the timeline")                                           //
      ("read", "Be one of the readers of a soak: a daemon's name", cxxopts::value<std::string>(), "NAME")  //
      ("slow-ms", "With --read: take so long for each frame", cxxopts::value<int>()->default_value("0"), "MS");
  add_overwrite_option(options);
  return options;
}

Result<Geometry> read_size(const std::string& text) {
  Geometry size;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%dx%d%c", &size.width, &size.height, &rest) == 2 && size.width >= 32 &&
      size.height >= 16 && size.width <= 640 && size.height <= 480) {
    return size;
  }
  return bad_input("--size '" + text + "': expected WIDTHxHEIGHT, 32x16 to 640x480, for example 640x120");
}

Result<double> read_seconds(const cxxopts::ParseResult& parsed) {
  if (parsed.count("seconds") + parsed.count("minutes") > 1) return bad_input("give --seconds or --minutes, not both");
  double seconds = kDefault_s;
  if (parsed.count("seconds") != 0) seconds = parsed["seconds"].as<double>();
  if (parsed.count("minutes") != 0) seconds = parsed["minutes"].as<double>() * 60.0;
  if (seconds >= kShortest_s && seconds <= kLongest_s) return seconds;
  return bad_input("a soak takes 10 s to 24 hours");
}

// All kinds, or those that were named.
Result<std::set<soak::Kind>> read_kinds(const cxxopts::ParseResult& parsed) {
  std::set<soak::Kind> kinds;
  for (const auto& argument : parsed.arguments()) {
    if (argument.key() != "only") continue;
    const auto kind = soak::kind_named(argument.value());
    if (!kind) return bad_input("--only '" + argument.value() + "' is no kind; bolo-lab soak --schedule shows all");
    kinds.insert(*kind);
  }
  if (!kinds.empty()) return kinds;
  for (const soak::KindInfo& info : soak::kinds()) {
    if (info.kind != soak::Kind::kClockStep || parsed.count("step-clock") != 0) kinds.insert(info.kind);
  }
  return kinds;
}

Result<Request> read_request(const cxxopts::ParseResult& parsed) {
  Request request;
  const bool shortened = parsed.count("shortened") != 0;
  request.json = parsed.count("json") != 0;
  request.only_schedule = parsed.count("schedule") != 0;
  request.report = parsed["report"].as<std::string>();
  request.replace = replace_of(parsed);
  const auto size = read_size(shortened && parsed.count("size") == 0 ? "64x24" : parsed["size"].as<std::string>());
  if (!size) return tl::unexpected<Error>(size.error());
  request.soak.rig.geometry = *size;
  request.soak.rig.rate_hz = parsed["rate"].as<double>();
  if (!(request.soak.rig.rate_hz >= 20.0 && request.soak.rig.rate_hz <= 1000.0)) {
    return bad_input("--rate must be 20 to 1000 frames a second");
  }
  const std::string config = parsed["config"].as<std::string>();
  if (!config.empty()) request.soak.rig.base_config = fs::absolute(config);
  request.soak.latency_limit_ms = parsed["latency-ms"].as<double>();
  const auto seconds = read_seconds(parsed);
  if (!seconds) return tl::unexpected<Error>(seconds.error());
  const auto kinds = read_kinds(parsed);
  if (!kinds) return tl::unexpected<Error>(kinds.error());
  request.soak.schedule = soak::draw_schedule({parsed["seed"].as<std::uint64_t>(), *seconds, *kinds});
  return request;
}

// A folder for the processes' files, gone afterwards.
class Folder {
 public:
  Folder() {
    std::string pattern = (fs::temp_directory_path() / "bolo-soak-XXXXXX").string();
    if (mkdtemp(pattern.data()) != nullptr) path_ = pattern;
  }
  ~Folder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

std::string command_text(int argc, char** argv) {
  std::string text = "bolo";
  for (int i = 0; i < argc; ++i) text += std::string(" ") + argv[i];
  return text;
}

struct ReportFiles {
  OutputFile page;
  OutputFile numbers;
  OutputFile log;
};

ReportFiles report_files(const Request& request) {
  const fs::path& folder = request.report;
  return {{folder / "report.html", request.replace},
          {folder / "report.json", request.replace},
          {folder / "bolod.log", request.replace}};
}

Status write_report(const Request& request, const soak::Circumstances& circumstances, const soak::SoakResult& result,
                    const soak::Findings& findings) {
  const auto [page, numbers, log] = report_files(request);
  if (auto copy = FileBeside::create(log)) {
    std::error_code error;
    fs::copy_file(request.soak.rig.folder / "bolod.err", copy->path(), fs::copy_options::overwrite_existing, error);
    if (!error) (void)copy->publish();  // a log is no reason to do without the report
  }
  const auto json = soak::report_json(request.soak, circumstances, result, findings, true);
  Status written = write_file(numbers, json.dump(1) + "\n");
  if (!written) return written;
  return write_file(page, soak::report_page(request.soak, circumstances, result, findings));
}

Result<bool> soak_and_report(Request& request, const std::string& command) {
  const auto programs = soak::find_programs();
  if (!programs) return tl::unexpected<Error>(programs.error());
  const Folder folder;
  if (folder.path().empty()) return failed("cannot make a folder for the soak's files");
  if (!request.report.empty()) {
    std::error_code error;
    fs::create_directories(request.report, error);
    if (error) return bad_input("--report " + request.report.string() + ": " + error.message());
    const auto [page, numbers, log] = report_files(request);
    Status good = check_outputs({page.path, numbers.path, log.path}, {}, request.replace);
    if (!good) return tl::unexpected<Error>(good.error());
  }
  request.soak.rig.folder = folder.path();
  const soak::Circumstances circumstances =
      soak::circumstances_of(request.soak, *programs, command, bolo_client_version());
  soak::Findings findings;
  const auto tell = [](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); };
  const auto result = soak::run_soak(request.soak, *programs, interrupted(), tell, findings);
  if (!result) return tl::unexpected<Error>(result.error());
  if (!request.report.empty()) {
    if (Status written = write_report(request, circumstances, *result, findings); !written) {
      return tl::unexpected<Error>(written.error());
    }
  }
  if (request.json) {
    std::puts(soak::report_json(request.soak, circumstances, *result, findings, false).dump(2).c_str());
  } else {
    std::fputs(soak::report_text(*result, findings).c_str(), stdout);
    for (const std::string& line : circumstances.not_done) std::printf("not done: %s\n", line.c_str());
  }
  return findings.all_hold();
}

}  // namespace

int soak_main(int argc, char** argv) {
  auto options = make_options();
  cxxopts::ParseResult parsed;
  if (const auto code = parse(options, argc, argv, parsed)) return *code;
  catch_interrupts();
  if (parsed.count("read") != 0) {
    const Status read = soak::read_along(parsed["read"].as<std::string>(), parsed["slow-ms"].as<int>(), interrupted());
    return read ? kExitDone : report(kVerb, read.error());
  }
  auto request = read_request(parsed);
  if (!request) return report(kVerb, request.error());
  if (request->only_schedule || !request->json) {
    std::fputs(soak::schedule_text(request->soak.schedule).c_str(), request->only_schedule ? stdout : stderr);
  }
  if (request->only_schedule) return kExitDone;
  const auto held = soak_and_report(*request, command_text(argc, argv));
  if (!held) return report(kVerb, held.error());
  return *held ? kExitDone : kExitFailed;
}

}  // namespace bolo::tools
