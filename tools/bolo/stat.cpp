// `bolo stat`: what a running daemon does, from its shared memory.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>

#include "drivers/shm/followed_stream.hpp"
#include "src/core/clock.hpp"
#include "tools/bolo/control_client.hpp"
#include "tools/bolo/stat_history.hpp"
#include "tools/bolo/stat_screen.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/view/stat_sample.hpp"

namespace bolo::tools {
namespace {

constexpr double kMinInterval = 0.05;
constexpr double kMaxInterval = 3600.0;

struct StatOptions {
  std::string name;
  double interval_s = 1.0;
  bool json = false;
  bool once = false;
};

// Shared memory has what every reader needs; the rest only the daemon tells.
nlohmann::ordered_json ask_state(const shm::ShmReader& reader, const std::string& name) {
  const auto path = control_socket_of(reader, name);
  if (!path) return {};
  const auto answer = ask_daemon(*path, "state");
  return answer ? nlohmann::ordered_json::parse(*answer, nullptr, false) : nlohmann::ordered_json();
}

StatLook look_at(const shm::ShmReader& reader, const StatOptions& options) {
  const bool closed = reader.closed();
  StatLook look{reader.header(), monotonic_ns(), closed, reader.camera(), newest_motion(reader)};
  if (!closed) look.told = ask_state(reader, options.name);
  return look;
}

// Shows samples: JSON a line each, tables one below the other, or on a terminal one over the other with their history.
class Display {
 public:
  explicit Display(const StatOptions& options) : options_(options), history_(options.interval_s) {
    if (!options.json && !options.once && StatScreen::is_there()) screen_.emplace();
  }

  void show(const StatLook& look, const StatSample& sample) {
    history_.add(sample);
    if (options_.json) {
      std::puts(stat_json(options_.name, look, sample).dump(-1, ' ', true, kReplace).c_str());
    } else if (screen_) {
      screen_->show(stat_table(options_.name, look, sample), history_);
    } else {
      std::printf("%s%s", shown_ ? "\n" : "", stat_table(options_.name, look, sample).c_str());
    }
    std::fflush(stdout);
    shown_ = true;
  }

  // False when interrupted.
  bool pause() {
    const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(options_.interval_s * kNsPerSecond);
    for (std::int64_t left_ns = end_ns - monotonic_ns(); left_ns > 0; left_ns = end_ns - monotonic_ns()) {
      if (interrupted().load(std::memory_order_relaxed)) return false;
      std::this_thread::sleep_for(std::chrono::nanoseconds(std::min<std::int64_t>(left_ns, 50'000'000)));
      if (screen_) screen_->follow_size(history_);
    }
    return !interrupted().load(std::memory_order_relaxed);
  }

 private:
  // Texts in shared memory may be cut within a letter.
  static constexpr auto kReplace = nlohmann::ordered_json::error_handler_t::replace;

  const StatOptions& options_;
  StatHistory history_;
  std::optional<StatScreen> screen_;
  bool shown_ = false;
};

// Shows a sample an interval, of whichever daemon has the name.
int follow(const StatOptions& options, shm::FollowedStream stream) {
  Display display(options);
  StatLook before = look_at(stream.reader(), options);
  while (display.pause()) {
    const StatLook now = look_at(stream.reader(), options);
    display.show(now, compare(before, now));
    if (options.once) break;
    before = stream.follow() ? look_at(stream.reader(), options) : now;
  }
  return kExitDone;
}

}  // namespace

int stat_main(int argc, char** argv) {
  cxxopts::Options cli("bolo stat", "Show what a running daemon does: rates, losses, latency.");
  StatOptions options;
  cli.add_options()("name", "The daemon's name", cxxopts::value(options.name))(
      "interval", "Seconds from sample to sample", cxxopts::value(options.interval_s)->default_value("1"), "S")(
      "once", "One sample over one interval, and end", cxxopts::value(options.once))("json", "One JSON object a line",
                                                                                     cxxopts::value(options.json));
  cli.parse_positional({"name"});
  cli.positional_help("NAME");
  cxxopts::ParseResult parsed;
  if (const auto code = parse(cli, argc, argv, parsed)) return *code;
  if (options.name.empty()) {
    return report("stat", {ErrorKind::kBadInput, "NAME is missing: bolo stat NAME"});
  }
  if (!(options.interval_s >= kMinInterval && options.interval_s <= kMaxInterval)) {
    return report("stat", {ErrorKind::kBadInput, "--interval is out of range: 0.05 to 3600 s"});
  }
  auto stream = shm::FollowedStream::open(options.name, 0);
  if (!stream) return report("stat", stream.error());
  catch_interrupts();
  return follow(options, std::move(*stream));
}

}  // namespace bolo::tools
