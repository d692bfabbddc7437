// What the laboratory's verbs share: their frame, options, folders, random draws, work on several threads.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "src/core/splitmix.hpp"
#include "src/report/text.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/scratch_folder.hpp"

namespace bolo::tools {

// Parses, does `work(given)`, and reports what went wrong. Returns the exit code. Thread: setup.
template <typename Work>
int run_verb(const char* verb, cxxopts::Options options, int argc, char** argv, Work&& work) {
  cxxopts::ParseResult given;
  if (const auto code = parse(options, argc, argv, given)) return *code;
  catch_interrupts();
  try {
    const Status done = work(given);
    return done ? kExitDone : report(verb, done.error());
  } catch (const std::bad_alloc&) {
    return report(verb, {ErrorKind::kFailed, "not enough memory; ask for less at once"});
  }
}

// kBadInput unless an option's value lies in the range. Thread: any.
inline Status within(double value, const char* option, double low, double high) {
  if (value >= low && value <= high) return {};
  return bad_input(plot::format("--%s %g: expected %g to %g", option, value, low, high));
}

// "640x480". Thread: any.
Result<Geometry> size_of(const std::string& text, const char* option, Geometry least, Geometry most);

// Random draws that depend on nothing but a key: SplitMix64's words from number `first` on.
class Dice {
 public:
  explicit Dice(std::uint64_t key, std::uint64_t first = 0) noexcept : key_(key), count_(first) {}
  std::uint64_t word() noexcept { return splitmix::key(key_, count_++); }
  double unit() noexcept { return splitmix::unit(word()); }  // in [0, 1)
  double between(double low, double high) noexcept { return low + (high - low) * unit(); }
  std::size_t below(std::size_t count) noexcept { return static_cast<std::size_t>(word() % count); }
  // Uniform in size between the two, of either sign.
  double signed_between(double low, double high) noexcept {
    const double size = between(low, high);
    return unit() < 0.5 ? -size : size;
  }

 private:
  std::uint64_t key_;
  std::uint64_t count_;
};

// Independent jobs on some threads; each leaves its result in a place of its own. Thread: one at a time.
class Jobs {
 public:
  using Job = std::function<Status()>;
  void add(Job job) { jobs_.push_back(std::move(job)); }

  // Does all that were added, and forgets them. The error of the first job that failed, in the order they were added;
  // an interrupt ends those that have not begun. `done` counts on, for `progress`.
  Status run(int threads, Progress& progress, std::uint64_t& done);

 private:
  std::vector<Job> jobs_;
};

// Runs a job that makes a Result and keeps its value.
template <typename T, typename Make>
Jobs::Job keep(std::optional<T>& place, Make make) {
  return [&place, make]() -> Status {
    ASSIGN_OR_RETURN(place, make());
    return {};
  };
}

}  // namespace bolo::tools
