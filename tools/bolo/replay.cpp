// `bolo replay`: the daemon with a capture in the camera's place.
#include <array>
#include <utility>

#include "drivers/shm/shm_object.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/bolod/daemon.hpp"
#include "tools/bolod/log.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

constexpr const char* kReplayVerb = "replay";

cxxopts::Options replay_options() {
  cxxopts::Options options("bolo replay",
                           "Publish a capture in shared memory as if its camera was live, in this process\n");
  options.positional_help("CAPTURE").show_positional_help();
  options.add_options()                                                                                             //
      ("capture", "The capture to replay (.h5, or the authors' .mat)", cxxopts::value<std::string>())               //
      ("name", "Name of the shared memory; the configuration's where one is given", cxxopts::value<std::string>())  //
      ("config", "Configuration as bolod's: all but its source is used", cxxopts::value<std::string>())             //
      ("pace", "realtime: at the capture's times. fast: as fast as frames are deblurred",                           //
       cxxopts::value<std::string>()->default_value("realtime"))                                                    //
      ("loop", "Begin again after the last frame: numbers and times rise on");
  options.parse_positional({"capture"});
  return options;
}

Result<daemon::DaemonConfig> replay_request(const cxxopts::ParseResult& parsed) {
  if (parsed.count("capture") == 0) return bad_input("which capture? usage: bolo replay CAPTURE [--name NAME]");
  daemon::DaemonConfig config;
  config.name = "replay";
  config.lock_memory = false;
  if (parsed.count("config") != 0) {
    Result<daemon::DaemonConfig> read = daemon::read_config(parsed["config"].as<std::string>());
    if (!read) return read;
    config = std::move(*read);
  }
  if (parsed.count("name") != 0) config.name = parsed["name"].as<std::string>();
  if (const auto path = shm::object_path(config.name); !path) return bad_input("--name: " + path.error().message);
  config.source = daemon::SourceType::kReplay;
  config.replay.file = parsed["capture"].as<std::string>();
  const std::string pace = parsed["pace"].as<std::string>();
  if (pace != "realtime" && pace != "fast") return bad_input("--pace '" + pace + "' is neither realtime nor fast");
  config.replay.pace = pace == "fast" ? replay::Pace::kAsFastAsPossible : replay::Pace::kRealTime;
  config.replay.laps = parsed.count("loop") != 0 ? replay::Laps::kForEver : replay::Laps::kOne;
  return config;
}

}  // namespace

int replay_main(int argc, char** argv) {
  auto options = replay_options();
  cxxopts::ParseResult parsed;
  if (const auto code = parse(options, argc, argv, parsed)) return *code;
  const auto config = replay_request(parsed);
  if (!config) return report(kReplayVerb, config.error());
  daemon::block_signals();
  auto made = daemon::Daemon::create(*config, daemon::make_log(config->log, config->name));
  if (!made) return report(kReplayVerb, made.error());
  if (const Status status = (*made)->run(daemon::OnHangup::kEnd); !status) return report(kReplayVerb, status.error());
  return kExitDone;
}

}  // namespace bolo::tools
