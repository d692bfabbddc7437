#include "tools/lab/eval/loss.hpp"

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/report/text.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/plot_option.hpp"
#include "tools/lab/eval/loss_plot.hpp"

namespace bolo::tools {
namespace {

using faults::LossOutcome;
using faults::LossRow;
using faults::LossTask;

constexpr const char* kVerb = "eval loss";

struct Request {
  std::vector<double> rates;
  int packet_size = 1500;
  double seconds = 4.0;
  pipeline::PipelineOptions pipeline;
  OutputFile plot;
  bool json = false;
};

cxxopts::Options command_line() {
  cxxopts::Options options("bolo-lab eval loss",
                           "Streams a street of 640x120 pixels at 200 Hz from a fake camera that loses packets, once\n"
                           "without and once with asking for them again, and judges what is published.\n");
  options.add_options()("rates", "Shares of the packets that are lost, separated by commas",
                        cxxopts::value<std::vector<double>>()->default_value("0,0.001,0.01,0.05"),
                        "A,B")("packet-size", "Bytes: 1500 on every link, up to 9000 with jumbo frames",
                               cxxopts::value<int>()->default_value("1500"),
                               "BYTES")("seconds", "Of each run", cxxopts::value<double>()->default_value("4"), "S")(
      "lookahead", "Frames", cxxopts::value<int>()->default_value("0"), "L")("threads", "Of the deblurring",
                                                                             cxxopts::value<int>()->default_value("2"),
                                                                             "W")("json", "Print the table as JSON");
  add_plot_option(options, "Draw the table");
  return options;
}

Result<Request> read_request(const cxxopts::ParseResult& args) {
  Request request;
  request.rates = args["rates"].as<std::vector<double>>();
  request.packet_size = args["packet-size"].as<int>();
  request.seconds = args["seconds"].as<double>();
  request.pipeline.deblur.lookahead = args["lookahead"].as<int>();
  request.pipeline.workers = args["threads"].as<int>();
  request.json = args.count("json") != 0;
  auto plot = plot_file_of(args);
  if (!plot) return tl::unexpected<Error>(plot.error());
  request.plot = std::move(*plot);
  for (const double rate : request.rates) {
    if (!(rate >= 0.0 && rate <= 1.0)) return bad_input("--rates must lie in 0 to 1");
  }
  if (request.packet_size < 576 || request.packet_size > 9000)
    return bad_input("--packet-size must lie in 576 to 9000");
  if (!(request.seconds >= 0.5 && request.seconds <= 60.0)) return bad_input("--seconds must lie in 0.5 to 60");
  return request;
}

void print_header() {
  std::printf("%8s  %-6s %7s %7s %8s %7s %9s %8s %8s %8s %8s %8s\n", "packets", "asked", "frames", "hit", "network",
              "behind", "frames/s", "ms each", "p50 ms", "p99 ms", "raw K", "sharp K");
}

void print_row(const LossTask& task, const LossRow& row) {
  const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  std::printf("%6.2f %%  %-6s %7llu %7llu %8llu %7llu %9.1f %8.2f %8.2f %8.2f %8.4f %8.4f%s\n", 100.0 * task.rate,
              task.resend ? "again" : "-", n(row.sent), n(row.hit), n(row.network), n(row.behind), row.frames_per_s,
              row.deblur_ms, row.latency_p50_ms, row.latency_p99_ms, row.rmse_raw_k, row.rmse_deblurred_k,
              row.host_dropped > 0 ? "  (this computer dropped packets by itself)" : "");
  std::fflush(stdout);
}

nlohmann::ordered_json to_json(const LossTask& task, const LossRow& row) {
  return {{"rate", task.rate},
          {"resend", task.resend},
          {"packet_size", task.packet_size},
          {"frames_sent", row.sent},
          {"frames_hit", row.hit},
          {"frames_lost", {{"network", row.network}, {"behind", row.behind}}},
          {"deblur_ms_per_frame", row.deblur_ms},
          {"frames_per_s", row.frames_per_s},
          {"latency_ms", {{"p50", row.latency_p50_ms}, {"p99", row.latency_p99_ms}}},
          {"rmse_raw_k", row.rmse_raw_k},
          {"rmse_deblurred_k", row.rmse_deblurred_k},
          {"host_dropped_packets", row.host_dropped}};
}

Status evaluate(const Request& request) {
  catch_interrupts();
  const auto scene = faults::loss_scene(request.seconds);
  if (!scene) return tl::unexpected<Error>(scene.error());
  if (!request.json) print_header();
  std::vector<LossOutcome> outcomes;
  Progress progress("runs", 2 * request.rates.size());
  for (const double rate : request.rates) {
    for (const bool resend : {false, true}) {
      if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
      const LossTask task{rate, resend, request.packet_size, request.seconds};
      const auto row = faults::try_loss(task, *scene, request.pipeline);
      if (!row) return tl::unexpected<Error>(row.error());
      if (!request.json) print_row(task, *row);
      outcomes.push_back({task, *row});
      progress.update(outcomes.size());
    }
  }
  if (request.json) {
    nlohmann::ordered_json rows = nlohmann::ordered_json::array();
    for (const LossOutcome& one : outcomes) rows.push_back(to_json(one.task, one.row));
    std::puts(nlohmann::ordered_json{{"rows", rows}}.dump(2).c_str());
  } else {
    std::puts(
        "hit: frames that lost a packet at first. Counted as lost: network (incomplete, missing), behind (deblurring\n"
        "could not keep up). ms each: deblurring. Latency: first packet received to published. RMSE against the truth\n"
        "over the frames that came, those with a lost one in their window included.");
  }
  if (request.plot.empty()) return {};
  plot::Sheet sheet = faults::sheet_of(outcomes);
  sheet.how = plot::format(
      "bolo-lab eval loss --packet-size %d --seconds %g: 640x120 at 200 Hz from a fake camera on the same computer. "
      "%s.",
      request.packet_size, request.seconds, machine_words().c_str());
  return save(sheet, request.plot);
}

}  // namespace

int eval_loss_main(int argc, char** argv) {
  cxxopts::Options options = command_line();
  cxxopts::ParseResult args;
  if (const auto code = parse(options, argc, argv, args)) return *code;
  const auto request = read_request(args);
  if (!request) return report(kVerb, request.error());
  const Status done = evaluate(*request);
  return done ? kExitDone : report(kVerb, done.error());
}

}  // namespace bolo::tools
