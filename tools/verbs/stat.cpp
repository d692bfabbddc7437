// `bolo stat`: what a running daemon does, from its shared memory.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include "bolo/core/clock.hpp"
#include "drivers/shm/shm_reader.hpp"
#include "tools/verbs/cli.hpp"
#include "tools/verbs/stat_sample.hpp"
#include "tools/verbs/verbs.hpp"

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

StatLook look_at(const shm::ShmReader& reader) {
  const bool closed = reader.closed();
  return {reader.header(), monotonic_ns(), closed, reader.camera()};
}

// False when interrupted.
bool pause(double interval_s) {
  const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(interval_s * kNsPerSecond);
  for (std::int64_t left_ns = end_ns - monotonic_ns(); left_ns > 0; left_ns = end_ns - monotonic_ns()) {
    if (interrupted().load(std::memory_order_relaxed)) return false;
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::min<std::int64_t>(left_ns, 50'000'000)));
  }
  return !interrupted().load(std::memory_order_relaxed);
}

// Prints samples one below the other, or on a terminal one over the other.
class Screen {
 public:
  explicit Screen(const StatOptions& options) : options_(options), terminal_(isatty(STDOUT_FILENO) == 1) {}

  void show(const StatLook& look, const StatSample& sample) {
    if (options_.json) {
      std::puts(stat_json(options_.name, look, sample).dump(-1, ' ', true, kReplace).c_str());
    } else {
      table(stat_table(options_.name, look, sample));
    }
    std::fflush(stdout);
  }

 private:
  // Texts in shared memory may be cut within a letter.
  static constexpr auto kReplace = nlohmann::ordered_json::error_handler_t::replace;

  void table(const std::string& text) {
    if (terminal_ && lines_ > 0) std::printf("\x1b[%dA\x1b[J", lines_);
    if (!terminal_ && lines_ > 0) std::putchar('\n');
    std::fputs(text.c_str(), stdout);
    lines_ = static_cast<int>(std::count(text.begin(), text.end(), '\n'));
  }

  const StatOptions& options_;
  bool terminal_;
  int lines_ = 0;
};

// Shows a sample an interval; when the daemon ends, waits for its successor.
int follow(const StatOptions& options, shm::ShmReader reader) {
  Screen screen(options);
  StatLook before = look_at(reader);
  while (pause(options.interval_s)) {
    const StatLook now = look_at(reader);
    screen.show(now, compare(before, now));
    if (options.once) break;
    before = now;
    if (!now.closed) continue;
    if (auto successor = shm::ShmReader::open(options.name); successor) {
      reader = std::move(*successor);
      before = look_at(reader);
    }
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
  auto reader = shm::ShmReader::open(options.name);
  if (!reader) return report("stat", reader.error());
  catch_interrupts();
  return follow(options, std::move(*reader));
}

}  // namespace bolo::tools
