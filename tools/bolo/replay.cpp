// `bolo replay`: runs the daemon with a capture instead of a camera.

#include "drivers/shm/shm_object.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/bolod/daemon.hpp"
#include "tools/bolod/log.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

cxxopts::Options replay_options() {
  cxxopts::Options options("bolo replay",
                           "Publish a capture in shared memory as if its camera were live, in this process.\n");
  options.positional_help("CAPTURE").show_positional_help();
  add_option<std::string>(options, "capture", "Capture to replay (.h5, or the authors' .mat)");
  add_option<std::string>(options, "name", "Name of the shared memory (default: the configuration's)");
  add_option<std::string>(options, "config", "Configuration of bolod; its source is ignored");
  add_option<std::string>(options, "pace", "realtime: with the capture's timing. fast: as fast as frames are deblurred",
                          "realtime");
  add_option<bool>(options, "loop", "Repeat endlessly; frame ids and times continue");
  options.parse_positional({"capture"});
  return options;
}

Result<daemon::DaemonConfig> replay_request(const cxxopts::ParseResult& parsed) {
  if (parsed.count("capture") == 0) return bad_input("which capture? usage: bolo replay CAPTURE [--name NAME]");
  daemon::DaemonConfig config;
  config.name = "replay";
  config.lock_memory = false;
  if (parsed.count("config") != 0) {
    ASSIGN_OR_RETURN(config, daemon::read_config(parsed["config"].as<std::string>()));
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

Status run_replay(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const auto config, replay_request(given));
  daemon::block_signals();
  ASSIGN_OR_RETURN(const auto made, daemon::Daemon::create(config, daemon::make_log(config.log, config.name)));
  return made->run(daemon::OnHangup::kEnd);
}

}  // namespace

int replay_main(int argc, char** argv) { return run_verb("replay", replay_options(), argc, argv, run_replay, false); }

}  // namespace bolo::tools
