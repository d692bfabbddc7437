// `bolo stat`: state of a running daemon, from its shared memory.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "drivers/shm/followed_stream.hpp"
#include "drivers/shm/shm_object.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "tools/bolo/control_client.hpp"
#include "tools/bolo/stat_history.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/view/stat_sample.hpp"

namespace bolo::tools {
namespace {

constexpr double kMinInterval = 0.05;
constexpr double kMaxInterval = 3600.0;
constexpr std::chrono::seconds kStatePatience(1);  // a stalled daemon delays the others' rows

struct StatOptions {
  double interval_s = 1.0;
  bool json = false;
  bool once = false;
};

// Shared memory holds what every reader needs; the rest is only available from the daemon.
nlohmann::ordered_json query_state(const shm::ShmReader& reader, const std::string& name) {
  const auto path = control_socket_of(reader, name);
  if (!path) return {};
  const auto answer = ask_daemon(*path, "state", kStatePatience);
  return answer ? nlohmann::ordered_json::parse(*answer, nullptr, false) : nlohmann::ordered_json();
}

StatSnapshot take_snapshot(const shm::ShmReader& reader, const std::string& name) {
  const bool closed = reader.closed();
  StatSnapshot snapshot{reader.header(), monotonic_ns(), closed, reader.camera(), newest_motion(reader)};
  if (!closed) snapshot.status = query_state(reader, name);
  return snapshot;
}

// Prints texts below each other, or on a terminal in place, with a history of the samples.
class Display {
 public:
  explicit Display(const StatOptions& options) : options_(options), history_(options.interval_s) {
    if (!options.json && !options.once && StatScreen::is_there()) screen_.emplace();
  }

  void add(const StatSample& sample) { history_.add(sample); }
  void show(const std::string& text) {
    if (screen_) {
      screen_->show(text, history_);
    } else {
      std::printf("%s%s", shown_ ? "\n" : "", text.c_str());
    }
    std::fflush(stdout);
    shown_ = true;
  }
  void show_json(const std::string& name, const StatSnapshot& snapshot, const StatSample& sample) {
    std::puts(json_text(stat_json(name, snapshot, sample)).c_str());
    std::fflush(stdout);
  }

  // Waits for an interval. False when interrupted, or when output failed.
  bool pause() {
    if (std::ferror(stdout) != 0) return false;
    const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(options_.interval_s * kNsPerSecond);
    for (std::int64_t left_ns = end_ns - monotonic_ns(); left_ns > 0; left_ns = end_ns - monotonic_ns()) {
      if (interrupted()) return false;
      std::this_thread::sleep_for(std::chrono::nanoseconds(std::min<std::int64_t>(left_ns, 50'000'000)));
      if (screen_) screen_->follow_size(history_);
    }
    return !interrupted();
  }

 private:
  const StatOptions& options_;
  StatHistory history_;
  std::optional<StatScreen> screen_;
  bool shown_ = false;
};

struct FollowedCamera {
  shm::FollowedStream stream;
  StatSnapshot before;
};

using Cameras = std::map<std::string, FollowedCamera>;

void add_camera(Cameras& cameras, const std::string& name, shm::FollowedStream stream) {
  StatSnapshot snapshot = take_snapshot(stream.reader(), name);
  cameras.emplace(name, FollowedCamera{std::move(stream), std::move(snapshot)});
}

// Adds daemons that were started since the last call.
void find_cameras(Cameras& cameras) {
  for (const std::string& name : shm::object_names()) {
    if (cameras.contains(name)) continue;
    auto stream = shm::FollowedStream::open(name, 0);
    if (stream && !stream->reader().closed()) add_camera(cameras, name, std::move(*stream));
  }
}

std::string row_of(const std::string& name, const StatSnapshot& snapshot, const StatSample& s) {
  const bolo_shm_header& h = snapshot.header;
  return fmt::format("{:<16} {:<9} {:>9} {:>7.1f} {:>7.1f} {:>8.2f} {:>8.2f} {:>9}  {}\n", name.substr(0, 16), s.state,
                     fmt::format("{}x{}", h.width, h.height), s.received_hz, s.published_hz, s.latency_p50_ms,
                     s.latency_p99_ms, s.lost_total, printable(h.solver));
}

// Shows a sample per interval: of a single name across restarts, otherwise a row per running camera.
void follow(const StatOptions& options, Cameras cameras) {
  const bool single = cameras.size() == 1;
  Display display(options);
  while (display.pause()) {
    std::string text;
    if (!single) {
      text = fmt::format("{:<16} {:<9} {:>9} {:>7} {:>7} {:>8} {:>8} {:>9}  {}\n", "camera", "state", "size", "in/s",
                         "out/s", "p50 ms", "p99 ms", "lost", "solver");
    }
    for (auto& [name, camera] : cameras) {
      StatSnapshot now = take_snapshot(camera.stream.reader(), name);
      const StatSample sample = compare(camera.before, now);
      if (single) display.add(sample);
      if (options.json) display.show_json(name, now, sample);
      text += single ? stat_table(name, now, sample) : row_of(name, now, sample);
      camera.before = camera.stream.follow() ? take_snapshot(camera.stream.reader(), name) : std::move(now);
    }
    if (!options.json) display.show(text);
    if (options.once) break;
    if (!single) find_cameras(cameras);
  }
}

Status run_stat(const cxxopts::ParseResult& given) {
  StatOptions options;
  options.interval_s = given["interval"].as<double>();
  if (!(options.interval_s >= kMinInterval && options.interval_s <= kMaxInterval)) {
    return bad_input("--interval is out of range: 0.05 to 3600 s");
  }
  options.json = given.count("json") != 0;
  options.once = given.count("once") != 0;
  Cameras cameras;
  if (given.count("name") != 0 && !given["name"].as<std::string>().empty()) {
    const auto name = given["name"].as<std::string>();
    ASSIGN_OR_RETURN(auto stream, shm::FollowedStream::open(name, 0));
    add_camera(cameras, name, std::move(stream));
  } else {
    find_cameras(cameras);
  }
  if (cameras.empty()) return bad_input("no daemon runs: start one, see bolo demo");
  follow(options, std::move(cameras));
  return {};
}

}  // namespace

int stat_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo stat",
      "Show rates, losses and latency of a running daemon; without NAME of all that run, one line each.\n");
  add_option<std::string>(cli, "name", "The daemon's name");
  add_option<double>(cli, "interval", "Seconds between samples", "1", "S");
  add_option<bool>(cli, "once", "Print one sample over one interval, and exit");
  add_option<bool>(cli, "json", "Print one JSON object per line");
  cli.parse_positional({"name"});
  cli.positional_help("[NAME]");
  return run_verb("stat", std::move(cli), argc, argv, run_stat);
}

}  // namespace bolo::tools
