// Shared by the laboratory's verbs: tables, random draws, parallel jobs.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/core/splitmix.hpp"
#include "src/report/text.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/process.hpp"

namespace bolo::tools {

// Parses a size such as "640x480". Thread: any.
Result<Geometry> size_of(const std::string& text, const char* option, Geometry least, Geometry most);

// Joins the words. Thread: any.
std::string joined(const std::vector<std::string>& words, const char* between = ", ");

using Json = nlohmann::ordered_json;

// A JSON list with the object json_of(item) for each item. Thread: any.
template <typename Range, typename Of>
Json list_of(const Range& items, Of json_of) {
  Json list = Json::array();
  for (const auto& item : items) list.push_back(json_of(item));
  return list;
}

// A report as text: values under their JSON names; lists of objects and objects of objects as tables, or, if too wide,
// line by line. Thread: any.
std::string report_text(const Json& report);

// Prints to stdout, as JSON or as text. Thread: one at a time.
void print_report(const Json& report, bool json);

// Bicubic interpolation (Catmull and Rom); pixels repeat beyond the border. Thread: any.
inline float sample(std::span<const float> plane, Geometry g, double x, double y) noexcept {
  const auto weights = [](double f) {
    return std::array{((2.0 - f) * f - 1.0) * f / 2.0, ((3.0 * f - 5.0) * f * f + 2.0) / 2.0,
                      ((4.0 - 3.0 * f) * f + 1.0) * f / 2.0, (f - 1.0) * f * f / 2.0};
  };
  const double left = std::floor(x);
  const double top = std::floor(y);
  const auto wx = weights(x - left);
  const auto wy = weights(y - top);
  double sum = 0.0;
  for (std::size_t j = 0; j < wy.size(); ++j) {
    const auto row = static_cast<std::size_t>(std::clamp(top - 1.0 + static_cast<double>(j), 0.0, g.height - 1.0));
    const float* from = plane.data() + row * static_cast<std::size_t>(g.width);
    for (std::size_t i = 0; i < wx.size(); ++i) {
      const double column = std::clamp(left - 1.0 + static_cast<double>(i), 0.0, g.width - 1.0);
      sum += wy[j] * wx[i] * static_cast<double>(from[static_cast<std::size_t>(column)]);
    }
  }
  return static_cast<float>(sum);
}

struct SquareSum {
  double sum = 0.0;
  std::size_t count = 0;

  void add(double a, double b) {
    sum += (a - b) * (a - b);
    ++count;
  }
  void add(float a, float b) { add(static_cast<double>(a), static_cast<double>(b)); }
  double mean() const { return sum / static_cast<double>(count); }  // NaN if empty
  double root_mean() const { return std::sqrt(mean()); }
};

// Random draws that depend on a key only: SplitMix64's words from number `first` on.
class Dice {
 public:
  explicit Dice(std::uint64_t key, std::uint64_t first = 0) noexcept : key_(key), count_(first) {}
  std::uint64_t word() noexcept { return splitmix::key(key_, count_++); }
  double unit() noexcept { return splitmix::unit(word()); }  // in [0, 1)
  double between(double low, double high) noexcept { return low + (high - low) * unit(); }
  std::size_t below(std::size_t count) noexcept { return static_cast<std::size_t>(word() % count); }
  // Uniform magnitude between both, of either sign.
  double signed_between(double low, double high) noexcept {
    const double size = between(low, high);
    return unit() < 0.5 ? -size : size;
  }

 private:
  std::uint64_t key_;
  std::uint64_t count_;
};

// Independent jobs on several threads; each writes its result to its own place. Thread: one at a time.
class Jobs {
 public:
  using Job = std::function<Status()>;
  void add(Job job) { jobs_.push_back(std::move(job)); }

  // Runs all added jobs and clears the list. Returns the error of the first failed job, in the order they were added;
  // an interrupt skips jobs that have not begun. `done` counts on, for `progress`.
  Status run(int threads, Progress& progress, std::uint64_t& done);

 private:
  std::vector<Job> jobs_;
};

// A job that calls `make` and stores its value in `place`.
template <typename T, typename Make>
Jobs::Job keep(T& place, Make make) {
  return [&place, make]() -> Status {
    ASSIGN_OR_RETURN(place, make());
    return {};
  };
}

}  // namespace bolo::tools
