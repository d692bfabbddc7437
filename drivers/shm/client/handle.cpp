#include "drivers/shm/client/handle.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "src/core/clock.hpp"

namespace bolo::shm {

namespace {

// Rounded up, into 32 bits.
std::uint32_t microseconds(std::int64_t ns) noexcept {
  constexpr std::int64_t kMost = std::numeric_limits<std::uint32_t>::max();
  return static_cast<std::uint32_t>(std::clamp<std::int64_t>(ns / kNsPerUs + (ns % kNsPerUs > 0 ? 1 : 0), 0, kMost));
}

}  // namespace

void ErrorText::set(std::string_view text) noexcept {
  const std::size_t length = std::min(text.size(), text_.size() - 1);
  std::copy_n(text.begin(), length, text_.begin());
  text_[length] = '\0';
}

Handle::Handle(FollowedStream stream) : stream_(std::move(stream)) { fill_info(); }

int Handle::refuse(int result, std::string_view text) {
  error.set(text);
  return result;
}

void Handle::fill_info() {
  const ShmReader& reader = stream_.reader();
  header_ = reader.header();
  settings_ = reader.settings();
  camera_ = reader.camera();
  control_socket_ = camera_ ? camera_->control_socket : "";
  info_.width = header_.width;
  info_.height = header_.height;
  info_.unit = header_.unit;
  info_.row_step = header_.row_step;
  info_.scale = header_.scale;
  info_.offset = header_.offset;
  info_.frame_period_s = header_.frame_period_s;
  info_.tau_s = header_.tau_s;
  info_.window = header_.window;
  info_.lookahead = header_.lookahead;
  info_.slot_count = header_.slot_count;
  info_.writer_pid = header_.writer_pid;
  info_.start_ns = header_.start_ns;
  info_.restarts = stream_.restarts();
  info_.camera_model = header_.camera_model;
  info_.camera_serial = header_.camera_serial;
  info_.solver = header_.solver;
  info_.settings = settings_ ? &*settings_ : nullptr;
  info_.control_socket = control_socket_.c_str();
  info_.row_delay_s = header_.row_delay_s;
}

const bolo_client_state& Handle::update_state() {
  const ShmReader& reader = stream_.reader();
  const bolo_shm_header now = reader.header();
  camera_ = reader.camera();
  state_.alive = reader.closed() ? 0 : 1;
  state_.heartbeat_age_ns = static_cast<std::int64_t>(static_cast<std::uint64_t>(monotonic_ns()) - now.heartbeat_ns);
  state_.published = now.published;
  state_.received = now.received;
  state_.restarts = now.restarts;
  state_.warm_up = now.warm_up;
  state_.gap_frames = now.gap_frames;
  std::copy(std::begin(now.lost), std::end(now.lost), std::begin(state_.lost));
  state_.lost_frames = std::accumulate(std::begin(now.lost), std::end(now.lost), std::uint64_t{0});
  state_.camera = camera_ ? &*camera_ : nullptr;
  state_.clock_synchronised = now.clock_synchronised != 0 ? 1 : 0;
  state_.clock_error_ns = now.clock_error_ns;
  state_.clock_steps = now.clock_steps;
  return state_;
}

int Handle::take(Take one, int timeout_ms, bolo_client_frame& frame) {
  BorrowedFrame lent;
  std::uint64_t missed = 0;
  switch ((stream_.*one)(lent, missed, timeout_ms)) {
    case FollowedStream::Outcome::kFrame:
      break;
    case FollowedStream::Outcome::kTimeout:
      return BOLO_CLIENT_TIMEOUT;
    case FollowedStream::Outcome::kEnded:
      return refuse(BOLO_CLIENT_ENDED, stream_.obstacle());
    case FollowedStream::Outcome::kRestarted:
      point_reader_.reset();
      fill_info();
      return BOLO_CLIENT_RESTARTED;
  }
  frame = {};
  frame.number = lent.number;
  frame.missed = missed;
  frame.frame_id = lent.head.frame_id;
  frame.camera_ns = lent.head.camera_ns;
  frame.host_ns = lent.head.host_ns;
  frame.receive_ns = lent.head.receive_ns;
  frame.utc_ns = lent.head.utc_ns;
  frame.utc_uncertainty_us = microseconds(lent.head.utc_uncertainty_ns);
  frame.publish_ns = lent.head.publish_ns;
  frame.noise_k = lent.head.noise_k;
  frame.flags = lent.head.flags;
  frame.width = header_.width;
  frame.height = header_.height;
  frame.raw = lent.raw();
  frame.deblurred = lent.deblurred();
  frame.slot = lent.slot;
  frame.motion = lent.motion();
  frame.motion_blocks = lent.motion_blocks();
  frame.motion_across = frame.motion != nullptr ? header_.motion_across : 0;
  frame.motion_down = frame.motion != nullptr ? header_.motion_down : 0;
  return BOLO_CLIENT_OK;
}

int Handle::kelvin(std::span<const std::uint16_t> values, float* kelvin) {
  if (header_.unit != BOLO_UNIT_KELVIN) {
    return refuse(BOLO_CLIENT_UNSUPPORTED, "this stream is in counts, which nothing says how to make kelvin of");
  }
  std::transform(values.begin(), values.end(), kelvin,
                 [&](std::uint16_t value) { return static_cast<float>(header_.scale * value + header_.offset); });
  return BOLO_CLIENT_OK;
}

int Handle::choose_points(std::span<const bolo_client_point> points) {
  std::vector<std::uint32_t> pixels;
  pixels.reserve(points.size());
  for (const bolo_client_point& point : points) {
    if (point.x >= header_.width || point.y >= header_.height) {
      return refuse(BOLO_CLIENT_BAD_ARGUMENT, "the point (" + std::to_string(point.x) + ", " + std::to_string(point.y) +
                                                  ") is not inside the frame of " + std::to_string(header_.width) +
                                                  "x" + std::to_string(header_.height));
    }
    pixels.push_back(point.y * header_.width + point.x);
  }
  if (point_reader_ && pixels == pixels_) return BOLO_CLIENT_OK;
  Result<PointReader> made = PointReader::over(stream_.reader().share(), pixels);
  if (!made) return refuse(BOLO_CLIENT_UNSUPPORTED, made.error().message);
  point_reader_.emplace(std::move(*made));
  pixels_ = std::move(pixels);
  solved_.resize(pixels_.size());
  return BOLO_CLIENT_OK;
}

int Handle::points(std::uint64_t number, std::span<const bolo_client_point> points, float* values) {
  if (points.empty()) return BOLO_CLIENT_OK;
  if (const int chosen = choose_points(points); chosen != BOLO_CLIENT_OK) return chosen;
  switch (point_reader_->solve(number, solved_)) {
    case PointReader::Outcome::kSolved:
      break;
    case PointReader::Outcome::kNotYet:
      return BOLO_CLIENT_NOT_YET;
    case PointReader::Outcome::kWarmUp:
      return BOLO_CLIENT_WARM_UP;
    case PointReader::Outcome::kOverwritten:
      return BOLO_CLIENT_OVERWRITTEN;
  }
  if (header_.unit == BOLO_UNIT_KELVIN) return kelvin(solved_, values);
  std::copy(solved_.begin(), solved_.end(), values);
  return BOLO_CLIENT_OK;
}

}  // namespace bolo::shm
