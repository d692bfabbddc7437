// `bolod`: the daemon. One instance per camera.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <string>

#include <cxxopts.hpp>

#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/core/unique_fd.hpp"
#include "tools/bolod/config.hpp"
#include "tools/bolod/daemon.hpp"
#include "tools/bolod/log.hpp"
#include "tools/bolod/setup_guard.hpp"

namespace {

constexpr int kExitDone = 0;
constexpr int kExitFailed = 1;
constexpr int kExitUsage = 2;
constexpr int kPatience_ms = 1000;  // for writing the last line, so that a blocked reader does not delay a restart

cxxopts::Options bolod_options() {
  cxxopts::Options options("bolod", "Deblurs a thermal camera's frames and hands them to other programs.");
  options.add_options()                                                                              //
      ("config", "Configuration to run", cxxopts::value<std::string>(), "FILE")                      //
      ("check-config", "Check the configuration, and exit")                                          //
      ("print-config", "Print the complete default configuration with its documentation, and exit")  //
      ("version", "Print the version")                                                               //
      ("h,help", "Print this help");
  return options;
}

int report(const bolo::Error& error) {
  bolo::daemon::write_to_stderr("bolod: " + bolo::message_line(error.message) + "\n", kPatience_ms);
  return error.exit_code();
}

// The file is valid, but a resource that it names is missing or in use. That may be temporary, so a service manager
// gets exit code 1: after 2 (bad input) it would not restart.
int report_start(const bolo::Error& error) {
  const int exit_code = report(error);
  return std::getenv("NOTIFY_SOCKET") == nullptr ? exit_code : kExitFailed;
}

// A failure to write standard output (full disk) is an error.
int printed() {
  std::cout.flush();
  if (std::cout.good() && std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return kExitDone;
  return report({bolo::ErrorKind::kFailed, "standard output cannot be written"});
}

int usage(const std::string& what) {
  std::fprintf(stderr, "bolod: %s; see bolod --help\n", bolo::message_line(what).c_str());
  return kExitUsage;
}

int run(const std::string& file, bool check_only) {
  if (!check_only) bolo::daemon::end_by_signals();  // the file's disk may hang
  const bolo::Result<bolo::daemon::DaemonConfig> config = bolo::daemon::read_config_to_run(file);
  if (!config) return report(config.error());
  if (check_only) {
    std::printf("%s: ok\n", bolo::printable(file).c_str());
    return printed();
  }
  bolo::daemon::block_signals();  // a signal during set-up stays pending for run(), which ends cleanly
  const auto daemon = bolo::daemon::Daemon::create(*config, bolo::daemon::make_log(config->log, config->name));
  if (!daemon) return bolo::daemon::end_requested() ? kExitDone : report_start(daemon.error());
  const bolo::Status status = (*daemon)->run(bolo::daemon::OnHangup::kReload);
  return status ? kExitDone : report(status.error());
}

}  // namespace

int main(int argc, char** argv) {
  bolo::hold_standard_streams();
  bolo::daemon::ignore_signals();
  try {
    bolo::grow_stack();
    cxxopts::Options options = bolod_options();
    const cxxopts::ParseResult parsed = options.parse(argc, argv);
    if (!parsed.unmatched().empty()) return usage("unexpected argument '" + parsed.unmatched().front() + "'");
    if (parsed.count("help") != 0) {
      std::cout << options.help();
      return printed();
    }
    if (parsed.count("version") != 0) {
      std::puts("bolod " BOLO_VERSION);
      return printed();
    }
    if (parsed.count("print-config") != 0) {
      std::cout << bolo::daemon::document_config();
      return printed();
    }
    if (parsed.count("config") == 0) return usage("--config FILE is missing");
    return run(parsed["config"].as<std::string>(), parsed.count("check-config") != 0);
  } catch (const cxxopts::exceptions::exception& e) {
    return usage(e.what());
  } catch (const std::exception& e) {  // out of memory or threads
    return report({bolo::ErrorKind::kFailed, "cannot go on: " + bolo::describe_exception(e)});
  }
}
