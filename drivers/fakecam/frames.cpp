#include "drivers/fakecam/frames.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::size_t kStoredValues = 65536;

double counts_of_kelvin(double kelvin, IrFormat format) {
  if (format != IrFormat::kRadiometric) return kelvin * counts_per_kelvin(format);
  if (kelvin <= 0.0) return kPlanck.j0;
  return kPlanck.j0 + kPlanck.j1 * kPlanck.r / (std::exp(kPlanck.b / kelvin) - kPlanck.f);
}

// Counter step between consecutive frames: 1, or more in a decimated capture.
std::uint64_t smallest_step(std::span<const std::uint64_t> ids) {
  std::uint64_t step = ids.size() < 2 ? 1 : ids[1] - ids[0];
  for (std::size_t i = 1; i < ids.size(); ++i) step = std::min(step, ids[i] - ids[i - 1]);
  return std::max<std::uint64_t>(step, 1);
}

}  // namespace

FrameRing::FrameRing(std::size_t ahead, std::size_t keep, std::size_t pixels)
    : frames_(ahead + keep), pins_(ahead + keep, 0), ahead_(ahead) {
  for (auto& frame : frames_) frame.counts.resize(pixels);
}

WireFrame* FrameRing::begin_write() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return closed_ || (written_ < sent_ + ahead_ && pins_[slot(written_)] == 0); });
  if (closed_) return nullptr;
  if (written_ >= frames_.size()) oldest_ = written_ - frames_.size() + 1;
  return &frames_[slot(written_)];
}

void FrameRing::end_write() {
  change([this] {
    frames_[slot(written_)].sequence = written_;
    ++written_;
  });
}

void FrameRing::finish() {
  change([this] { finished_ = true; });
}

const WireFrame* FrameRing::begin_send() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return closed_ || finished_ || sent_ < written_; });
  if (closed_ || sent_ == written_) return nullptr;
  visible_ = sent_ + 1;
  return &frames_[slot(sent_)];
}

void FrameRing::end_send() {
  change([this] { ++sent_; });
}

FrameRing::Pin FrameRing::find(std::uint16_t block_id) {
  const std::lock_guard lock(mutex_);
  for (std::uint64_t s = visible_; s > oldest_; --s) {
    if (frames_[slot(s - 1)].block.block_id != block_id) continue;
    ++pins_[slot(s - 1)];
    return Pin(&frames_[slot(s - 1)], {this});
  }
  return nullptr;
}

void FrameRing::Unpin::operator()(const WireFrame* frame) const {
  ring->change([&] { --ring->pins_[ring->slot(frame->sequence)]; });
}

void FrameRing::close() {
  change([this] { closed_ = true; });
}

Status FrameProvider::read(std::size_t index, void* out) const {
  if (planes.empty()) return read_one(index, out);
  const std::size_t stride = plane_bytes(format.geometry, format.type);
  std::memcpy(out, planes.data() + index * stride, stride);
  return {};
}

Result<FrameProvider> open_capture(const std::filesystem::path& file, std::size_t preload_bytes) {
  ASSIGN_OR_RETURN(auto opened, capture::CaptureReader::open(file));
  const auto reader = std::make_shared<const capture::CaptureReader>(std::move(opened));
  const auto& info = reader->info();
  if (info.frames == 0) return bad_input(file.string() + ": /frames is empty; a camera needs at least one frame");
  FrameProvider provider{info.format, reader->frame_id(), reader->t(), info.camera_serial, {}};
  const std::size_t stride = plane_bytes(info.format.geometry, info.format.type);
  if (info.frames * stride > preload_bytes) {
    provider.read_one = [reader](std::size_t index, void* out) { return reader->read_frame(index, out); };
    return provider;
  }
  provider.planes.resize(info.frames * stride);
  for (std::size_t i = 0; i < info.frames; ++i) {
    RETURN_IF_ERROR(reader->read_frame(i, provider.planes.data() + i * stride));
  }
  return provider;
}

CountConverter::CountConverter(const StreamFormat& format, IrFormat ir_format, Region region)
    : format_(format), ir_format_(ir_format), region_(region) {
  if (format.type != PixelType::kUint16) return;
  table_.resize(kStoredValues);
  bool identity = true;
  for (std::size_t v = 0; v < kStoredValues; ++v) {
    table_[v] = count_of(static_cast<double>(v));
    identity = identity && table_[v] == v;
  }
  if (identity) table_.clear();
}

std::uint16_t CountConverter::count_of(double stored) const noexcept {
  const double count =
      format_.scale.unit == Unit::kKelvin ? counts_of_kelvin(format_.scale.to_physical(stored), ir_format_) : stored;
  if (!(count > 0.0)) return 0;  // also for NaN
  return static_cast<std::uint16_t>(std::lround(std::min(count, 65535.0)));
}

void CountConverter::convert(const void* plane, std::uint16_t* out) const noexcept {
  const auto stride = static_cast<std::size_t>(format_.geometry.width);
  const auto columns = static_cast<std::size_t>(region_.width);
  const std::size_t first = static_cast<std::size_t>(region_.y) * stride + static_cast<std::size_t>(region_.x);
  for (std::size_t row = 0; row < static_cast<std::size_t>(region_.height); ++row, out += columns) {
    const std::size_t from = first + row * stride;
    if (format_.type == PixelType::kFloat32) {
      const float* in = static_cast<const float*>(plane) + from;
      std::transform(in, in + columns, out, [this](float v) { return count_of(static_cast<double>(v)); });
    } else if (table_.empty()) {
      std::memcpy(out, static_cast<const std::uint16_t*>(plane) + from, columns * sizeof(std::uint16_t));
    } else {
      const std::uint16_t* in = static_cast<const std::uint16_t*>(plane) + from;
      std::transform(in, in + columns, out, [this](std::uint16_t v) { return table_[v]; });
    }
  }
}

Timeline::Timeline(std::span<const std::uint64_t> frame_ids, std::span<const double> times_s, double period_s,
                   double rate_hz)
    : ids_(frame_ids.begin(), frame_ids.end()) {
  const std::uint64_t step = smallest_step(ids_);
  times_ns_.reserve(ids_.size());
  for (std::size_t i = 0; i < ids_.size(); ++i) {
    const double frames = static_cast<double>(ids_[i] - ids_.front()) / static_cast<double>(step);
    times_ns_.push_back(rate_hz > 0.0 ? to_ns(times_s.front()) + to_ns(frames / rate_hz) : to_ns(times_s[i]));
  }
  lap_ids_ = ids_.back() - ids_.front() + step;
  lap_ns_ = times_ns_.back() - times_ns_.front() + to_ns(rate_hz > 0.0 ? 1.0 / rate_hz : period_s);
}

Moment Timeline::at(std::uint64_t sequence) const {
  const std::uint64_t lap = sequence / ids_.size();
  const auto index = static_cast<std::size_t>(sequence % ids_.size());
  return {index, ids_[index] + lap * lap_ids_,
          static_cast<std::uint64_t>(times_ns_[index] + static_cast<std::int64_t>(lap) * lap_ns_)};
}

}  // namespace bolo::fakecam
