#include "tools/lab/eval/faults.hpp"

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/statistics.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/plot_option.hpp"
#include "tools/lab/eval/faults_plot.hpp"
#include "tools/lab/eval/faults_scenarios.hpp"

namespace bolo::tools {
namespace {

using faults::Outcome;
using faults::Scenario;

constexpr const char* kVerb = "eval faults";
constexpr int kMostRepeats = 1000;

// One scenario, a few times.
struct Row {
  const Scenario* scenario = nullptr;
  std::string injected;  // of the last run
  std::string lost;      // of the last run
  bool equal = true;     // what was lost is what was injected, in every run
  std::vector<double> recovery_ms;
  std::uint64_t reconnects = 0;  // of the last run
  std::string wrong;             // the first that was found; empty: nothing
};

std::string injected_text(const std::vector<fakecam::InjectedFault>& injected) {
  std::string text;
  const auto add = [&text](std::uint64_t n, const char* what) {
    if (n > 0) text += (text.empty() ? "" : ", ") + std::to_string(n) + " " + what;
  };
  for (const fakecam::InjectedFault& fault : injected) {
    add(fault.frames, "frames");
    add(fault.packets, "packets");
    if (fault.frames + fault.packets == 0) add(fault.times, "time");
  }
  return text;
}

Result<Row> row_of(const Scenario& scenario, const faults::Stage& stage, int repeats) {
  Row row;
  row.scenario = &scenario;
  for (int i = 0; i < repeats && !interrupted().load(std::memory_order_relaxed); ++i) {
    const auto outcome = faults::play(scenario, stage, i + 1);
    if (!outcome) return at(scenario.name, outcome.error());
    row.injected = injected_text(outcome->run.injected);
    row.lost = faults::text_of(outcome->run.lost);
    row.equal = row.equal && outcome->losses_match();
    row.recovery_ms.push_back(outcome->verdict.recovery_ms);
    row.reconnects = outcome->run.reconnects;
    if (row.wrong.empty()) row.wrong = what_is_wrong(scenario, *outcome);
  }
  return row;
}

std::string equality(const Row& row) { return row.equal ? "yes" : row.scenario->exact ? "NO" : "no"; }

void print_row(const Row& row) {
  std::printf("%-17s %-26s %-26s %-6s %8.0f %8.0f %11llu  %s\n", row.scenario->name.c_str(), row.injected.c_str(),
              row.lost.c_str(), equality(row).c_str(), quantile(row.recovery_ms, 0.5), quantile(row.recovery_ms, 1.0),
              static_cast<unsigned long long>(row.reconnects), row.wrong.empty() ? "right" : row.wrong.c_str());
  std::fflush(stdout);
}

nlohmann::ordered_json to_json(const Row& row) {
  return {{"fault", row.scenario->name},
          {"script", row.scenario->faults},
          {"injected", row.injected},
          {"lost", row.lost},
          {"equal", row.equal},
          {"recovery_ms", {{"median", quantile(row.recovery_ms, 0.5)}, {"worst", quantile(row.recovery_ms, 1.0)}}},
          {"reconnects", row.reconnects},
          {"wrong", row.wrong}};
}

struct Request {
  int repeats = 3;
  std::string only;
  OutputFile plot;
  bool json = false;
};

Status evaluate(const Request& request) {
  catch_interrupts();
  const auto stage = faults::make_stage();
  if (!stage) return tl::unexpected<Error>(stage.error());
  if (!request.json) {
    std::printf("%-17s %-26s %-26s %-6s %8s %8s %11s  %s\n", "fault", "injected", "counted as lost", "equal", "median",
                "worst ms", "reconnects", "output");
  }
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  std::vector<faults::Recovery> recoveries;
  std::string wrong;
  Progress progress("faults", faults::scenarios().size());
  for (const Scenario& scenario : faults::scenarios()) {
    if (!request.only.empty() && scenario.name != request.only) continue;
    const auto row = row_of(scenario, *stage, request.repeats);
    if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
    if (!row) return tl::unexpected<Error>(row.error());
    if (!request.json) print_row(*row);
    if (!row->wrong.empty()) wrong += (wrong.empty() ? "" : ", ") + scenario.name;
    rows.push_back(to_json(*row));
    recoveries.push_back({scenario.name, row->recovery_ms});
    progress.update(rows.size());
  }
  if (rows.empty()) return bad_input("there is no fault '" + request.only + "' here; without --only all are tried");
  if (request.json) {
    std::puts(nlohmann::ordered_json{{"repeats", request.repeats}, {"rows", rows}}.dump(2).c_str());
  } else {
    std::printf(
        "%d run(s) each, 64x24 pixels at 200 Hz; a silent camera is opened again after 0.6 s. Recovery: from the\n"
        "fault's end until every published plane is that of an undisturbed run again; a window of 17 frames is 85 ms.\n"
        "Where 'equal' may be no: frames that a camera does not send while it is opened again, which are nobody's.\n",
        request.repeats);
  }
  if (!request.plot.empty()) {
    const double period_s = stage->scene.format.frame_period_s;
    plot::Sheet sheet = faults::sheet_of(recoveries, 1e3 * stage->pipeline.deblur.window * period_s);
    sheet.how = "bolo-lab eval faults --repeats " + std::to_string(request.repeats) +
                ": 64x24 pixels at 200 Hz through real packets.";
    if (Status drawn = save(sheet, request.plot); !drawn) return drawn;
  }
  return wrong.empty() ? Status{} : failed("what must hold does not: " + wrong);
}

}  // namespace

int eval_faults_main(int argc, char** argv) {
  cxxopts::Options options("bolo-lab eval faults",
                           "Runs the daemon's pipeline against a fake camera that fails, one fault after the other,\n"
                           "through real packets, and compares what it counts with what was injected and what it\n"
                           "publishes with an undisturbed run.\n");
  options.add_options()("repeats", "Runs of each fault", cxxopts::value<int>()->default_value("3"), "N")(
      "only", "This fault only, by its name in the table", cxxopts::value<std::string>()->default_value(""), "NAME")(
      "json", "Print the table as JSON");
  add_plot_option(options, "Draw how long each is felt");
  cxxopts::ParseResult args;
  if (const auto code = parse(options, argc, argv, args)) return *code;
  const auto plot = plot_file_of(args);
  if (!plot) return report(kVerb, plot.error());
  const Request request{args["repeats"].as<int>(), args["only"].as<std::string>(), *plot, args.count("json") != 0};
  if (request.repeats < 1 || request.repeats > kMostRepeats) {
    return report(kVerb, {ErrorKind::kBadInput, "--repeats must lie in 1 to 1000"});
  }
  const Status done = evaluate(request);
  return done ? kExitDone : report(kVerb, done.error());
}

}  // namespace bolo::tools
