// bolo doctor: what on this host is in the way of sharp frames, and the fix for each problem.
#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/bolod/config.hpp"
#include "tools/cli/cli.hpp"
#include "tools/doctor/checks.hpp"

namespace bolo::tools {
namespace {

using doctor::Check;
using doctor::Verdict;

doctor::Needs needs_of(const daemon::DaemonConfig& config, const cxxopts::ParseResult& given) {
  doctor::Needs needs;
  needs.socket_buffer_bytes = config.camera.socket_buffer_bytes;
  needs.packet_bytes = config.camera.packet_size;
  needs.realtime_priority = std::max(config.camera.realtime_priority, config.pipeline.thread.realtime_priority);
  needs.cpus = config.pipeline.thread.cpus;
  needs.address = config.source == daemon::SourceType::kGenicam ? config.camera.address : "";
  if (given.count("address") != 0) needs.address = given["address"].as<std::string>();
  pipeline::SinkContext context = config.sink_context();
  context.frame = {config.camera.width, config.camera.height};
  for (const auto& sink : config.sinks) {
    needs.shared_bytes += sink->shared_bytes(context);
    needs.video |= sink->group() == "video" && !sink->describe(context).empty();
  }
  return needs;
}

// Opens the device like bolod.
Result<std::string> look_at(const v4l2_source::V4l2SourceOptions& options) {
  v4l2_source::V4l2Source source(options);
  ASSIGN_OR_RETURN(const pipeline::SourceInfo info, source.open());
  return fmt::format("{} at {}: {}x{} at {:.4g} Hz", info.camera_model, options.device, info.format.geometry.width,
                     info.format.geometry.height, 1.0 / info.format.frame_period_s);
}

nlohmann::ordered_json to_json(const std::vector<Check>& checks) {
  nlohmann::ordered_json json{{"ok", true}, {"checks", nlohmann::ordered_json::array()}};
  for (const Check& check : checks) {
    if (check.verdict == Verdict::kProblem) json["ok"] = false;
    nlohmann::ordered_json one{{"name", check.name}, {"verdict", doctor::word(check.verdict)}, {"found", check.found}};
    one["fix"] = nullptr;
    if (!check.fix.empty()) one["fix"] = check.fix;
    json["checks"].push_back(std::move(one));
  }
  return json;
}

void print(const std::vector<Check>& checks) {
  for (const Check& check : checks) {
    std::printf("%-8s %-22s %s\n", std::string(doctor::word(check.verdict)).c_str(), check.title.c_str(),
                printable(check.found).c_str());
    if (!check.fix.empty()) std::printf("%-8s %-22s -> %s\n", "", "", printable(check.fix).c_str());
  }
  const auto count = [&](Verdict v) { return std::ranges::count(checks, v, &Check::verdict); };
  std::printf("%td problems, %td pieces of advice in %zu checks\n", count(Verdict::kProblem), count(Verdict::kAdvice),
              checks.size());
}

Result<int> run_doctor(const cxxopts::ParseResult& given) {
  daemon::DaemonConfig config;
  if (given.count("config") != 0) {
    ASSIGN_OR_RETURN(config, daemon::read_config(given["config"].as<std::string>()));
  }
  const doctor::Needs needs = needs_of(config, given);
  const bool video = config.source == daemon::SourceType::kV4l2 && needs.address.empty();
  doctor::Facts facts = doctor::gather({needs.address, given.count("no-camera") == 0 && !video});
  if (video) facts.device = look_at(config.video);
  if (video && !*facts.device && facts.device->error().message.find(v4l2_source::kInUse) != std::string::npos) {
    facts.device = doctor::used_by(facts.device->error(), config.name);
  }
  const auto checks = doctor::judge(facts, needs);
  if (given.count("json") != 0) {
    std::puts(json_text(to_json(checks), 2).c_str());
  } else {
    print(checks);
  }
  return std::ranges::count(checks, Verdict::kProblem, &Check::verdict) > 0 ? kExitFailed : kExitDone;
}

}  // namespace

int doctor_main(int argc, char** argv) {
  cxxopts::Options options("bolo doctor",
                           "Check what this computer lacks for a camera at 200 frames/s, with a fix for each problem.\n"
                           "Exit code 1 if there is a problem.");
  add_option<std::string>(options, "config", "bolod.toml to check, with its camera", nullptr, "FILE");
  add_option<std::string>(options, "address", "The camera's IP address or id (default: any that answers)");
  add_option<bool>(options, "no-camera", "Do not search the network for cameras");
  add_option<bool>(options, "json", "Print the result as JSON");
  return run_verb("doctor", std::move(options), argc, argv, run_doctor, false);
}

}  // namespace bolo::tools
