// The workers' part of the pipeline: each solves its share of a frame.
#include <algorithm>
#include <span>

#include "src/core/clock.hpp"
#include "src/pipeline/convert.hpp"
#include "src/pipeline/pipeline_impl.hpp"

namespace bolo::pipeline {
namespace {

// Frames are still solved for this long after a stop request. Rows and points between two reads of the clock: enough to
// cost nothing, few enough for half a second even where a pixel takes 0.2 ms (exact).
constexpr std::int64_t kEndNs = 300'000'000;
constexpr int kRowsAtOnce = 64;
constexpr int kExactRowsAtOnce = 1;
constexpr std::size_t kPointsAtOnce = 4096;
constexpr std::size_t kExactPointsAtOnce = 512;

}  // namespace

// A part is a band of rows, the same for every frame: it mostly meets the same worker, whose core has it in its cache.
void Pipeline::Impl::work(int part) noexcept {
  bool& saturation = band_saturated[static_cast<std::size_t>(part)].value;
  saturation = false;
  if (!options.points.empty()) {
    const auto share = [&](int p) { return options.points.size() * static_cast<std::size_t>(p) / workers(); };
    saturation = solve_points(share(part), share(part + 1));
    return;
  }
  const Region all = options.region.value_or(Region{0, 0, info.format.geometry.width, info.format.geometry.height});
  const int first_row = all.height * part / team.size();
  const int end_row = all.height * (part + 1) / team.size();
  if (first_row < end_row) saturation = solve_part({all.x, all.y + first_row, all.width, end_row - first_row});
}

bool Pipeline::Impl::out_of_time() noexcept {
  if (must_give_up()) return true;
  if (stop == nullptr || !stop->load(std::memory_order_relaxed)) return false;
  const std::int64_t now_ns = monotonic_ns();
  std::int64_t seen_ns = 0;  // the first thread to see the stop sets the time for all others
  if (stop_seen_ns.compare_exchange_strong(seen_ns, now_ns, std::memory_order_relaxed)) seen_ns = now_ns;
  return now_ns - seen_ns > kEndNs;
}

// Solves in stretches of `at_once` units, as long as there is time.
template <typename Solve>
void Pipeline::Impl::solve_stretches(std::size_t begin, std::size_t end, std::size_t at_once,
                                     const Solve& solve) noexcept {
  for (; begin < end; begin += at_once) {
    if (out_of_time()) return given_up.store(true, std::memory_order_relaxed);
    solve(begin, std::min(begin + at_once, end));
  }
}

// True if a raw value is at the end of the range.
bool Pipeline::Impl::solve_part(const Region& part) noexcept {
  const auto width = static_cast<std::size_t>(info.format.geometry.width);
  const auto part_width = static_cast<std::size_t>(part.width);
  const int step = part.width == info.format.geometry.width ? part.height : 1;
  bool found = false;
  if (solves()) {
    const auto rows = static_cast<std::size_t>(part.height);
    solve_stretches(0, rows, converges() ? kExactRowsAtOnce : kRowsAtOnce, [&](std::size_t first, std::size_t after) {
      const Region some{part.x, part.y + static_cast<int>(first), part.width, static_cast<int>(after - first)};
      solvers.at(quality).solve(job->view, some, deblurred.data());
    });
  }
  for (int row = part.y; row < part.y + part.height; row += step) {
    const std::size_t begin = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(part.x);
    const PixelRange pixels{begin, begin + static_cast<std::size_t>(step) * part_width};
    if (!solves()) convert(corrections->format(), job->frame.plane, options.output, deblurred.data(), pixels);
    if (corrections->after()) {
      corrections->restore({options.output, deblurred.data(), pixels, job->frame.plane, pixels.begin});
    }
    found = saturated(info.format.type, raw, pixels) || corrections->saturated(raw, pixels) || found;
  }
  return found;
}

bool Pipeline::Impl::solve_points(std::size_t begin, std::size_t end) noexcept {
  const std::span<const std::uint32_t> pixels(options.points.data() + begin, end - begin);
  void* out = static_cast<std::byte*>(deblurred.data()) + begin * bytes_of(options.output);
  if (solves()) {
    const std::size_t at_once = converges() ? kExactPointsAtOnce : kPointsAtOnce;
    solve_stretches(0, pixels.size(), at_once, [&](std::size_t first, std::size_t after) {
      solvers.at(quality).solve_points(job->view, pixels.subspan(first, after - first),
                                       static_cast<std::byte*>(out) + first * bytes_of(options.output));
    });
  } else {
    convert(corrections->format(), job->frame.plane, options.output, out, pixels);
  }
  for (std::size_t i = 0; corrections->after() && i < pixels.size(); ++i) {
    corrections->restore({options.output, out, {i, i + 1}, job->frame.plane, pixels[i]});
  }
  return std::ranges::any_of(pixels, [this](std::uint32_t pixel) {
    const PixelRange one{pixel, pixel + std::size_t{1}};
    return saturated(info.format.type, raw, one) || corrections->saturated(raw, one);
  });
}

}  // namespace bolo::pipeline
