#include "src/pipeline/stream_walk.hpp"

#include <cstddef>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

#include "src/deblur/window.hpp"
#include "src/pipeline/frame_undo.hpp"
#include "src/pipeline/stream_state.hpp"

namespace bolo::pipeline {
namespace {

deblur::Settings settings_for(const PipelineOptions& options, const StreamFormat& format) {
  deblur::Settings settings = options.deblur;
  settings.period_s = format.frame_period_s;
  return settings;
}

bool measures_noise(const deblur::Settings& settings) {
  const bool models = settings.method == deblur::Method::kMmae || settings.method == deblur::Method::kMotion;
  const bool adapts = models || (settings.auto_lambda && settings.method != deblur::Method::kInverse);
  return adapts && settings.noise_k <= 0.0;
}

Result<std::unique_ptr<FrameUndo>> undo_for(const PipelineOptions& options, const deblur::Settings& settings,
                                            const StreamFormat& format) {
  const auto planes = static_cast<std::size_t>(deblur::Window(settings).slots());
  return FrameUndo::create({options.undo, settings, options.maps, options.pixel_noise_k, planes}, format);
}

}  // namespace

// Where the noise is measured, motions that were found with earlier frames' noise are remembered for some frames.
constexpr int kRememberedMotions = 9;

int halo_frames(const PipelineOptions& options) {
  const bool motions = options.deblur.method == deblur::Method::kMotion && measures_noise(options.deblur);
  const int window = options.deblur.window - 1 + (motions ? kRememberedMotions : 0);
  return options.undo.drop_repeated ? 2 * window : window;
}

Result<bool> remembers(const PipelineOptions& options, const StreamFormat& format) {
  const deblur::Settings settings = settings_for(options, format);
  const auto undo = undo_for(options, settings, format);
  if (!undo) return tl::unexpected(undo.error());
  return measures_noise(settings) || (*undo)->remembers();
}

struct StreamWalk::Impl {
  Impl(const StreamFormat& format_in, const deblur::Settings& settings_in, std::unique_ptr<FrameUndo> undo_in,
       std::unique_ptr<deblur::Solver> solver_in)
      : format(format_in),
        settings(settings_in),
        undo(std::move(undo_in)),
        solver(std::move(solver_in)),
        window(settings),
        plane_size(plane_bytes(format.geometry, format.type)),
        planes(undo->before() ? 0 : plane_size * static_cast<std::size_t>(window.slots() + 1)) {}

  const void* taken(const FrameMeta& meta, const void* raw, bool restart);
  void look_for_other(const FrameMeta& meta, bool restart);

  StreamFormat format;
  deblur::Settings settings;
  std::unique_ptr<FrameUndo> undo;
  std::unique_ptr<deblur::Solver> solver;
  deblur::Window window;
  bool restart_next = false;

  std::size_t plane_size;
  std::vector<std::byte> planes;  // a ring of raw planes, where the window gets these
  std::size_t next_plane = 0;

  std::optional<deblur::Window> other;       // the window of the run that begins at the mark, until its first full one
  std::optional<std::uint64_t> other_first;  // the frame that it then shows
  std::string undo_at_mark;
  double noise_at_mark = 0.0;
};

// The plane that the window gets.
const void* StreamWalk::Impl::taken(const FrameMeta& meta, const void* raw, bool restart) {
  if (!undo->before()) {
    std::byte* const plane = planes.data() + next_plane;
    next_plane = (next_plane + plane_size) % planes.size();
    std::memcpy(plane, raw, plane_size);
    return plane;
  }
  const PixelRange all{0, format.geometry.pixels()};
  undo->begin(meta, raw, restart);
  undo->read(all);
  if (undo->needs_settling()) undo->settle();
  undo->write(all);
  undo->finish();
  return undo->plane();
}

// Which frame is the first whose window the other run shows its solver.
void StreamWalk::Impl::look_for_other(const FrameMeta& meta, bool restart) {
  if (!other) return;
  noise_at_mark = solver->noise_state();
  other->push({.meta = meta}, restart);
  deblur::Window::Ready ready;
  while (other && other->next(ready)) {
    if (!ready.full) continue;
    other_first = ready.frame.meta.frame_id;
    other.reset();
  }
}

Result<std::unique_ptr<StreamWalk>> StreamWalk::create(const PipelineOptions& options, const StreamFormat& format) {
  const deblur::Settings settings = settings_for(options, format);
  if (Status status = deblur::validate(settings); !status) return tl::unexpected(status.error());
  auto undo = undo_for(options, settings, format);
  if (!undo) return tl::unexpected(undo.error());
  // Of the solver only what it learns of the noise is needed: motion's is that of mmae, which takes less.
  deblur::Settings cheap = settings;
  if (cheap.method == deblur::Method::kMotion) cheap.method = deblur::Method::kMmae;
  auto solver = deblur::Solver::create(cheap, (*undo)->format(), options.output, options.maps.row_delay_s);
  if (!solver) return tl::unexpected(solver.error());
  auto impl = std::make_unique<Impl>(format, settings, std::move(*undo), std::move(*solver));
  if (!options.resume.empty()) {
    const Status status = restore(options.resume, {*impl->undo, *impl->solver, impl->restart_next});
    if (!status) return tl::unexpected(status.error());
  }
  return std::unique_ptr<StreamWalk>(new StreamWalk(std::move(impl)));
}

void StreamWalk::step(const FrameMeta& meta, const void* raw, bool restart) {
  if (impl_->undo->repeats(raw)) {
    impl_->restart_next = impl_->restart_next || restart;
    return;
  }
  restart = std::exchange(impl_->restart_next, false) || restart;
  impl_->look_for_other(meta, restart);
  impl_->window.push({.meta = meta, .plane = impl_->taken(meta, raw, restart)}, restart);
  deblur::Window::Ready ready;
  while (impl_->window.next(ready)) {
    if (!ready.full) continue;
    if (impl_->other_first == ready.frame.meta.frame_id) impl_->noise_at_mark = impl_->solver->noise_state();
    impl_->solver->prepare(ready.view);
  }
}

void StreamWalk::mark() {
  impl_->undo_at_mark = undo_half(*impl_->undo, impl_->restart_next);
  impl_->noise_at_mark = impl_->solver->noise_state();
  impl_->other.emplace(impl_->settings);
  impl_->other_first.reset();
}

bool StreamWalk::marked() const { return !impl_->undo_at_mark.empty() && !impl_->other; }

std::string StreamWalk::state() const { return joined(impl_->undo_at_mark, impl_->noise_at_mark); }

StreamWalk::StreamWalk(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StreamWalk::~StreamWalk() = default;

}  // namespace bolo::pipeline
