#include "tools/gstreamer/stream_deblur.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "src/core/clock.hpp"

namespace bolo::tools {

Result<std::unique_ptr<StreamDeblur>> StreamDeblur::create(const deblur::Settings& settings, const StreamFormat& format,
                                                           int workers) {
  if (Status good = deblur::validate(settings); !good) return tl::unexpected<Error>(good.error());
  auto solver = deblur::Solver::create(settings, format, PixelType::kUint16);
  if (!solver) return tl::unexpected<Error>(solver.error());
  return std::unique_ptr<StreamDeblur>(new StreamDeblur(settings, format, workers, std::move(*solver)));
}

StreamDeblur::StreamDeblur(const deblur::Settings& settings, const StreamFormat& format, int workers,
                           std::unique_ptr<deblur::Solver> solver)
    : format_(format),
      period_s_(settings.period_s),
      window_(settings),
      solver_(std::move(solver)),
      team_(workers, {.name = "bolo-deblur"}),
      planes_(static_cast<std::size_t>(window_.slots()) * format.geometry.pixels()) {
  for (int slot = 0; slot < window_.slots(); ++slot) free_.push_back(static_cast<std::uint32_t>(slot));
}

void StreamDeblur::push(std::int64_t time_ns, bool restart) noexcept {
  FrameMeta meta{.camera_ns = time_ns, .receive_ns = time_ns};
  // Nobody counts these frames but the clock.
  const double periods = static_cast<double>(time_ns - last_.camera_ns) / (period_s_ * kNsPerSecond);
  const double most = 2.0 * static_cast<double>(window_.slots());  // more of a jump empties the window anyway
  const double step = std::clamp(std::round(periods), 1.0, most);
  if (any_) meta.frame_id = last_.frame_id + static_cast<std::uint64_t>(step);
  const std::uint32_t slot = free_.back();
  free_.pop_back();
  window_.push({meta, plane_of(slot), slot}, restart || !any_);
  collected_ = false;
  last_ = meta;
  any_ = true;
}

void StreamDeblur::finish() noexcept {
  window_.finish();
  collected_ = any_ = false;
}

bool StreamDeblur::next(Ready& ready, std::uint16_t* out) noexcept {
  deblur::Window::Ready frame;
  if (!window_.next(frame)) {
    if (!std::exchange(collected_, true)) {
      free_.insert(free_.end(), window_.released().begin(), window_.released().end());
    }
    return false;
  }
  ready = {frame.frame.meta.camera_ns, frame.full};
  if (frame.full) {
    solve(frame.view, out);
  } else {
    std::memcpy(out, frame.frame.plane, plane_bytes(format_.geometry, PixelType::kUint16));
  }
  return true;
}

void StreamDeblur::solve(const deblur::WindowView& view, std::uint16_t* out) noexcept {
  rt::TeamCrew crew(team_);
  solver_->prepare(view, crew);
  for_parts(crew, format_.geometry.height, [&](int begin, int end) {
    solver_->solve(view, {0, begin, format_.geometry.width, end - begin}, out);
  });
}

}  // namespace bolo::tools
