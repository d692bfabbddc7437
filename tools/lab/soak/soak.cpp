// `bolo-lab soak`: all that goes wrong on a vehicle, for any length of time; findings as text and JSON.
#include <algorithm>
#include <cstdio>

#include "bolo/client.h"
#include "src/core/statistics.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/soak/verdicts.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::soak {
namespace {

namespace fs = std::filesystem;
using plot::format;

// --- the report ---

Json json_of(const Invariant invariant, const Findings::Tally& tally) {
  return {{"name", info_of(invariant).name}, {"about", info_of(invariant).about},
          {"holds", tally.broken == 0},      {"looks", tally.checks},
          {"broken", tally.broken},          {"figure", tally.figure}};
}

Json json_of(const Breach& breach) {
  return {{"invariant", info_of(breach.invariant).name},
          {"at_s", breach.at_s},
          {"what", breach.what},
          {"during", breach.during}};
}

Json json_of(const Struck& s) {
  const KindInfo& info = info_of(s.disturbance.kind);
  return {{"kind", info.name},
          {"begin_s", s.begin_s},
          {"end_s", s.over ? Json(s.end_s) : Json(nullptr)},
          {"recovery_s", s.recovery_s ? Json(*s.recovery_s) : Json(nullptr)},
          {"limit_s", info.recovers_within_s},
          {"faults", s.disturbance.faults}};
}

Json report_json(const SoakRequest& request, const std::string& command, const SoakResult& result,
                 const Findings& findings) {
  Json invariants = Json::array();
  for (std::size_t i = 0; i < kInvariants; ++i) {
    invariants.push_back(json_of(static_cast<Invariant>(i), findings.tally(static_cast<Invariant>(i))));
  }
  std::vector<Struck> struck;
  std::ranges::copy_if(result.struck, std::back_inserter(struck), [](const Struck& s) { return s.begin_s >= 0.0; });
  const auto list = [](const auto& items) { return list_of(items, [](const auto& item) { return json_of(item); }); };
  return {{"bolo_soak", 1},
          {"holds", findings.all_hold()},
          {"interrupted", result.interrupted},
          {"seconds", result.seconds},
          {"seed", request.schedule.seed},
          {"measured",
           {{"command", command},
            {"version", bolo_client_version()},
            {"machine", describe_machine()},
            {"solver", result.solver},
            {"others_share_in_quiet", result.others_in_quiet}}},
          {"no_room_for", list_of(request.schedule.no_room, [](Kind kind) { return info_of(kind).name; })},
          {"invariants", invariants},
          {"breaches", list(findings.breaches())},
          {"frames", result.frames},
          {"latency_ms", {{"quiet", result.quiet}}},
          {"lives", result.lives},
          {"disturbances", list(struck)}};
}

std::string schedule_text(const Schedule& schedule) {
  std::string out = format("seed %llu: %zu round(s) of %.1f s\n", static_cast<unsigned long long>(schedule.seed),
                           schedule.rounds.size(), schedule.round_s);
  for (std::size_t r = 0; r < schedule.rounds.size(); ++r) {
    for (const Disturbance& d : schedule.rounds[r].disturbances) {
      out += format("  round %zu, %7.2f s  for %4.2f s  %-18s %s\n", r, d.at_s, d.for_s, info_of(d.kind).name.data(),
                    d.faults.c_str());
    }
  }
  return out;
}

// The verdict, then the report without its list of disturbances.
std::string describe_report(Json report) {
  std::vector<std::string> unjudged;
  for (const Json& invariant : report["invariants"]) {
    if (invariant["looks"] == 0) unjudged.push_back(invariant["name"]);
  }
  double slowest_s = 0.0;
  for (const Json& struck : report["disturbances"]) {
    slowest_s = std::max(slowest_s, struck["recovery_s"].is_null() ? 0.0 : struck["recovery_s"].get<double>());
  }
  const std::string verdict = report["holds"] == false ? "BROKEN.\n"
                              : unjudged.empty()       ? "All held.\n"
                                                 : "What was judged held; not judged: " + joined(unjudged) + ".\n";
  const std::string recovery = format("%zu disturbances in %.0f s, the slowest recovery took %.2f s\n",
                                      report["disturbances"].size(), report["seconds"].get<double>(), slowest_s);
  report.erase("disturbances");
  return verdict + recovery + report_text(report);
}

// --- the verb ---

struct Request {
  SoakRequest soak;
  fs::path report;
  Replace replace = Replace::kNothing;
};

cxxopts::Options make_options() {
  cxxopts::Options options(
      "bolo-lab soak",
      "Run a fake camera, bolod and readers for a long time while everything goes wrong that can,\n"
      "and check all the time that every frame is accounted for, every pixel right, and nothing\n"
      "grows. Exit code 1: something did not hold. A daemon of this computer is not touched.\n");
  add_option<double>(options, "minutes", "How long", "2", "M");
  add_option<bool>(options, "shortened", "A small camera (64x24), for a build's checks");
  add_option<std::uint64_t>(options, "seed", "Another one draws other times, orders and sizes", "1", "N");
  add_option<std::string>(options, "only", "These kinds of trouble only; may be given again (--schedule shows all)",
                          nullptr, "KIND");
  add_option<std::string>(options, "report", "Folder for report.txt, report.json and the daemon's log", "", "DIR");
  add_option<bool>(options, "schedule", "Print what would happen when, and end");
  add_option<std::string>(options, "read", "Be one of the readers of a soak: a daemon's name", nullptr, "NAME");
  add_overwrite_option(options);
  return options;
}

// The kinds named, or all.
Result<std::set<Kind>> read_kinds(const cxxopts::ParseResult& parsed) {
  std::set<Kind> named;
  for (const auto& argument : parsed.arguments()) {
    if (argument.key() != "only") continue;
    const auto kind = kind_named(argument.value());
    if (!kind) return bad_input("--only '" + argument.value() + "' is no kind; bolo-lab soak --schedule shows all");
    named.insert(*kind);
  }
  if (named.empty()) {
    for (const KindInfo& info : kinds()) named.insert(info.kind);
  }
  return named;
}

Result<Request> read_request(const cxxopts::ParseResult& parsed) {
  Request request;
  request.report = parsed["report"].as<std::string>();
  request.replace = replace_of(parsed);
  if (parsed.count("shortened") != 0) request.soak.rig.geometry = {64, 24};
  ASSIGN_OR_RETURN(const double minutes, number_of<double>(parsed, "minutes", 1.0 / 6.0, 1440.0));
  ASSIGN_OR_RETURN(const auto kinds, read_kinds(parsed));
  request.soak.schedule = draw_schedule({parsed["seed"].as<std::uint64_t>(), 60.0 * minutes, kinds});
  return request;
}

constexpr std::array kReportFiles{"report.json", "report.txt", "bolod.log"};

// Creates the folder for the report and checks that no file is in the way.
Status prepare_report(const Request& request) {
  if (request.report.empty()) return {};
  RETURN_IF_ERROR(make_folder(request.report));
  return check_outputs(mapped(kReportFiles, [&](const char* name) { return request.report / name; }), {},
                       request.replace);
}

Status write_report(const Request& request, const Json& json, const std::string& text) {
  if (request.report.empty()) return {};
  if (auto copy = FileBeside::create({request.report / kReportFiles[2], request.replace})) {
    std::error_code error;
    fs::copy_file(request.soak.rig.folder / "bolod.err", copy->opened(), fs::copy_options::overwrite_existing, error);
    if (!error) (void)copy->publish();  // the report matters more than a missing log
  }
  RETURN_IF_ERROR(write_file({request.report / kReportFiles[0], request.replace}, json.dump(1) + "\n"));
  return write_file({request.report / kReportFiles[1], request.replace},
                    text + "\n" + schedule_text(request.soak.schedule));
}

Status soak_and_report(Request& request, const std::string& command) {
  ASSIGN_OR_RETURN(const auto programs, find_programs());
  ASSIGN_OR_RETURN(const auto folder, ScratchFolder::make());
  RETURN_IF_ERROR(prepare_report(request));
  request.soak.rig.folder = folder.path();
  Findings findings;
  const auto print = [](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); };
  ASSIGN_OR_RETURN(const auto result, run_soak(request.soak, programs, interrupted(), print, findings));
  const Json json = report_json(request.soak, command, result, findings);
  const std::string text = describe_report(json);
  RETURN_IF_ERROR(write_report(request, json, text));
  std::fputs(text.c_str(), stdout);
  return findings.all_hold() ? Status{} : failed("something did not hold");
}

Status evaluate(const cxxopts::ParseResult& parsed, const std::string& command) {
  if (parsed.count("read") != 0) {
    return read_along(parsed["read"].as<std::string>(), interrupted());
  }
  ASSIGN_OR_RETURN(auto request, read_request(parsed));
  const bool only_schedule = parsed.count("schedule") != 0;
  std::fputs(schedule_text(request.soak.schedule).c_str(), only_schedule ? stdout : stderr);
  return only_schedule ? Status{} : soak_and_report(request, command);
}

}  // namespace

}  // namespace bolo::tools::soak

int bolo::tools::soak_main(int argc, char** argv) {
  std::string command = "bolo-lab";
  for (int i = 0; i < argc; ++i) command += std::string(" ") + argv[i];
  return run_verb("soak", soak::make_options(), argc, argv,
                  [&](const cxxopts::ParseResult& parsed) { return soak::evaluate(parsed, command); });
}
