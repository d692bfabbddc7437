#include "drivers/usb/frame_numbers.hpp"

#include <utility>

#include "src/core/clock.hpp"

namespace bolo::usb {
namespace {

// A jump ahead of up to this many frames is believed without looking at the clock; beyond that, no more frames can be
// lost than fit into the time that has passed, with a margin.
constexpr double kBelievedFrames = 200.0;
constexpr double kTimeMargin = 2.0;

std::uint64_t read(std::span<const std::byte> bytes, bool big_endian) noexcept {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const std::byte next = bytes[big_endian ? i : bytes.size() - 1 - i];
    value = value << 8 | std::to_integer<std::uint64_t>(next);
  }
  return value;
}

}  // namespace

FrameNumbers::FrameNumbers(std::optional<CounterField> counter, double period_s) noexcept
    : counter_(counter), period_ns_(period_s * kNsPerSecond) {}

void FrameNumbers::interrupted(bool camera_began_anew) noexcept {
  began_anew_ = began_anew_ || camera_began_anew || !counter_;
}

FrameNumbers::Place FrameNumbers::place(std::span<const std::byte> frame, std::int64_t arrival_ns) noexcept {
  const std::uint64_t raw = counter_ ? read(frame.subspan(counter_->offset, counter_->bytes), counter_->big_endian) : 0;
  const std::int64_t steps = steps_to(raw);
  const double possible = kBelievedFrames + kTimeMargin * static_cast<double>(arrival_ns - last_ns_) / period_ns_;
  Place place;
  if (!started_) {
    place.frame_id = raw;
    lost_ = 0;
  } else if (began_anew_ || steps < 0 || static_cast<double>(steps) > possible) {
    place = follow(lost_ + 1);
    place.restarted = true;
  } else if (counter_ && steps == 0) {
    return {.frame_id = last_, .repeated = true};
  } else {
    place = follow(counter_ ? static_cast<std::uint64_t>(steps) : lost_ + 1);
  }
  started_ = true;
  began_anew_ = false;
  last_ = place.frame_id;
  last_raw_ = raw;
  last_ns_ = arrival_ns;
  return place;
}

FrameNumbers::Place FrameNumbers::follow(std::uint64_t steps) noexcept {
  const std::uint64_t told = std::exchange(lost_, 0);
  return {.frame_id = last_ + steps, .missing = steps > told + 1 ? steps - 1 - told : 0};
}

// Forward or back, whichever is nearer on the counter's circle.
std::int64_t FrameNumbers::steps_to(std::uint64_t raw) const noexcept {
  constexpr unsigned kBits = 64;
  const unsigned unused = counter_ ? kBits - 8 * static_cast<unsigned>(counter_->bytes) : 0;
  return static_cast<std::int64_t>((raw - last_raw_) << unused) >> unused;
}

}  // namespace bolo::usb
