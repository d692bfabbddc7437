#include "src/corrections/chain.hpp"

#include <algorithm>
#include <utility>

namespace bolo::corrections {

// Each is defined in the file of its name.
Made repeated_frames(const Setup& setup, const StreamFormat& input);
Made frame_filter(const Setup& setup, const StreamFormat& input);
Made common_offset(const Setup& setup, const StreamFormat& input);
Made radiometry(const Setup& setup, const StreamFormat& input);
Made slow_pole(const Setup& setup, const StreamFormat& input);
Made pixel_correction(const Setup& setup, const StreamFormat& input);
Made scene_nuc(const Setup& setup, const StreamFormat& input);
Made conduction(const Setup& setup, const StreamFormat& input);
Made ceiling(const Setup& setup, const StreamFormat& input);

namespace {

// The reverse of the camera's order. Maps commute with filter and slow pole, and are too small to matter to the curves.
constexpr Made (*kTable[])(const Setup&, const StreamFormat&) = {
    &repeated_frames,  &frame_filter, &common_offset, &radiometry, &slow_pole,
    &pixel_correction, &scene_nuc,    &conduction,    &ceiling,
};

}  // namespace

Result<std::unique_ptr<Chain>> Chain::create(const Setup& setup, const StreamFormat& input, std::size_t planes) {
  std::unique_ptr<Chain> chain(new Chain(input, planes));
  for (const auto make : kTable) {
    ASSIGN_OR_RETURN(auto made, make(setup, input));
    if (made == nullptr) continue;
    const Hooks& hooks = made->hooks();
    chain->beyond_maps_ |= make != &pixel_correction && (hooks.samples || hooks.deblurred);
    chain->add(std::move(made));
  }
  if (!chain->before()) return chain;
  chain->format_.type = PixelType::kFloat32;
  chain->planes_.assign(input.geometry.pixels() * chain->ring_planes_, 0.0F);
  return chain;
}

void Chain::add(std::unique_ptr<Correction> correction) {
  const Hooks& hooks = correction->hooks();
  if (hooks.frames) frames_.push_back(correction.get());
  if (hooks.whole_frame) pass_begin_.push_back(samples_.size());
  if (hooks.samples) samples_.push_back(correction.get());
  if (hooks.deblurred) deblurred_.insert(deblurred_.begin(), correction.get());
  if (hooks.saturation) saturation_.push_back(correction.get());
  all_.push_back(std::move(correction));
}

bool Chain::drops(const void* raw) noexcept {
  return std::ranges::any_of(frames_, [raw](Correction* c) { return c->drops(raw); });
}

void Chain::begin(const FrameMeta& meta, const void* raw, bool restart, std::uint64_t repeats) noexcept {
  raw_ = raw;
  plane_ = planes_.data() + next_ * input_.geometry.pixels();
  next_ = (next_ + 1) % ring_planes_;
  bool off_grid = false;
  const std::int64_t periods = steps_.next(meta, repeats, input_.frame_period_s, off_grid);
  const bool first = restart || !begun_ || periods < 1;
  begun_ = true;
  for (Correction* c : samples_) c->begin(first ? 0 : static_cast<std::uint64_t>(periods));
}

void Chain::begin_pass(std::size_t pass) noexcept {
  if (pass > 0) samples_[pass_begin_[pass]]->measure(plane_);
}

void Chain::apply(std::size_t pass, PixelRange pixels) noexcept {
  const std::size_t first = pass_begin_[pass];
  const std::size_t end = pass + 1 < passes() ? pass_begin_[pass + 1] : samples_.size();
  for (std::size_t begin = pixels.begin; begin < pixels.end; begin += kPixelsAtOnce) {
    const PixelRange some{begin, std::min(begin + kPixelsAtOnce, pixels.end)};
    if (pass == 0) load(some);
    for (std::size_t i = pass == 0 ? 1 : first; i < end; ++i) samples_[i]->apply(plane_, some);
  }
}

// The first correction reads the raw frame itself, unless it measures the whole frame first.
void Chain::load(PixelRange pixels) noexcept {
  if (samples_.front()->hooks().whole_frame) return to_float(raw_, input_.type, plane_, pixels);
  samples_.front()->load(raw_, input_.type, plane_, pixels);
}

void Chain::finish() noexcept {
  for (Correction* c : samples_) c->finish(plane_);
}

void Chain::restore(const Deblurred& frame) const noexcept {
  for (const Correction* c : deblurred_) c->restore(frame, format_.type);
}

bool Chain::saturated(const void* raw, PixelRange pixels) const noexcept {
  return std::ranges::any_of(saturation_, [&](const Correction* c) { return c->saturated(raw, pixels); });
}

}  // namespace bolo::corrections
