// The C functions of bolo/client.h: they check arguments and stop exceptions; the C++ class Handle does the rest.
#include "bolo/client.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/shm/followed_stream.hpp"
#include "drivers/shm/point_reader.hpp"
#include "drivers/shm/shm_object.hpp"
#include "src/core/clock.hpp"
#include "src/core/threads.hpp"

namespace bolo::shm {
namespace {

std::uint32_t microseconds(std::int64_t ns) noexcept {
  constexpr std::int64_t kMost = std::numeric_limits<std::uint32_t>::max();
  return static_cast<std::uint32_t>(std::clamp<std::int64_t>(ns / kNsPerUs + (ns % kNsPerUs > 0 ? 1 : 0), 0, kMost));
}

}  // namespace

// Fixed-size text, so that an out-of-memory message needs no memory.
class ErrorText {
 public:
  // Truncates to fit. Thread: one at a time.
  void set(std::string_view text) noexcept {
    const std::size_t length = std::min(text.size(), text_.size() - 1);
    std::copy_n(text.begin(), length, text_.begin());
    text_[length] = '\0';
  }

  const char* text() const noexcept { return text_.data(); }

 private:
  std::array<char, 512> text_{};
};

// Returns enum bolo_client_result; negative ones and BOLO_CLIENT_ENDED set a message in `error`. Thread: one at a time.
class Handle {
 public:
  explicit Handle(FollowedStream stream) : stream_(std::move(stream)) { fill_info(); }

  // Not copyable: info_ points into this.
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;

  const bolo_client_info& info() const noexcept { return info_; }

  const bolo_client_state& update_state() {
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

  // FollowedStream::next or latest.
  using Take = decltype(&FollowedStream::next);

  int take(Take one, int timeout_ms, bolo_client_frame& frame) {
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
    info_.frame_period_s = stream_.reader().frame_period_s();
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

  int kelvin(std::span<const std::uint16_t> values, float* kelvin) {
    if (header_.unit != BOLO_UNIT_KELVIN) {
      return refuse(BOLO_CLIENT_UNSUPPORTED, "this stream is in counts, which nothing says how to make kelvin of");
    }
    std::transform(values.begin(), values.end(), kelvin,
                   [&](std::uint16_t value) { return static_cast<float>(header_.scale * value + header_.offset); });
    return BOLO_CLIENT_OK;
  }

  int points(std::uint64_t number, std::span<const bolo_client_point> points, float* values) {
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

  std::shared_ptr<const void> hold() const noexcept { return stream_.reader().hold(); }

  ErrorText error;

 private:
  void fill_info() {
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

  int choose_points(std::span<const bolo_client_point> points) {
    std::vector<std::uint32_t> pixels;
    pixels.reserve(points.size());
    for (const bolo_client_point& point : points) {
      if (point.x >= header_.width || point.y >= header_.height) {
        return refuse(BOLO_CLIENT_BAD_ARGUMENT, "the point (" + std::to_string(point.x) + ", " +
                                                    std::to_string(point.y) + ") is not inside the frame of " +
                                                    std::to_string(header_.width) + "x" +
                                                    std::to_string(header_.height));
      }
      pixels.push_back(point.y * header_.width + point.x);
    }
    const double period_s = stream_.reader().frame_period_s();
    if (point_reader_ && pixels == pixels_ && point_reader_->period_s() == period_s) return BOLO_CLIENT_OK;
    Result<PointReader> made = PointReader::over(stream_.reader(), pixels);
    if (!made) return refuse(BOLO_CLIENT_UNSUPPORTED, made.error().message);
    point_reader_.emplace(std::move(*made));
    pixels_ = std::move(pixels);
    solved_.resize(pixels_.size());
    return BOLO_CLIENT_OK;
  }

  int refuse(int result, std::string_view text) {
    error.set(text);
    return result;
  }

  FollowedStream stream_;
  bolo_shm_header header_{};
  std::optional<bolo_shm_settings> settings_;
  std::optional<bolo_shm_camera> camera_;
  std::string control_socket_;
  bolo_client_info info_{};
  bolo_client_state state_{};
  std::vector<std::uint32_t> pixels_;  // of point_reader_
  std::vector<std::uint16_t> solved_;
  std::optional<PointReader> point_reader_;
};

}  // namespace bolo::shm

// The C header's names. NOLINTBEGIN(readability-identifier-naming)
struct bolo_client : bolo::shm::Handle {
  using Handle::Handle;
};
struct bolo_client_hold {
  std::shared_ptr<const void> object;
};
// NOLINTEND(readability-identifier-naming)

// ABI of programs in use; bolo.py declares the same structures.
static_assert(sizeof(bolo_client_info) == 128);
static_assert(sizeof(bolo_client_frame) == 136);
static_assert(sizeof(bolo_client_state) == 216);
static_assert(offsetof(bolo_client_info, camera_model) == 80);
static_assert(offsetof(bolo_client_frame, raw) == 80);
static_assert(offsetof(bolo_client_frame, motion) == 104);
static_assert(offsetof(bolo_client_frame, motion_across) == 120);
static_assert(offsetof(bolo_client_frame, utc_uncertainty_us) == 76);
static_assert(offsetof(bolo_client_frame, utc_ns) == 128);
static_assert(offsetof(bolo_client_state, camera) == 192);

namespace bolo::shm {
namespace {

// Of this thread's last call without a handle.
thread_local ErrorText thread_error;

// Result of `call`, or BOLO_CLIENT_FAILED after an exception.
template <typename Call>
int guarded(ErrorText& error, Call call) noexcept {
  try {
    return call();
  } catch (const std::bad_alloc&) {
    error.set("not enough memory");
  } catch (const std::exception& thrown) {
    error.set(describe_exception(thrown));
  }
  return BOLO_CLIENT_FAILED;
}

int bad_argument(ErrorText& error, const char* text) noexcept {
  error.set(text);
  return BOLO_CLIENT_BAD_ARGUMENT;
}

int result_of(Refusal refusal) {
  switch (refusal) {
    case Refusal::kNone:
      return BOLO_CLIENT_OK;
    case Refusal::kBadName:
      return BOLO_CLIENT_BAD_ARGUMENT;
    case Refusal::kAbsent:
      return BOLO_CLIENT_ABSENT;
    case Refusal::kDenied:
    case Refusal::kForeign:
      return BOLO_CLIENT_DENIED;
    case Refusal::kNotReady:
    case Refusal::kBadLayout:
      return BOLO_CLIENT_BAD_STREAM;
    case Refusal::kFailed:
      return BOLO_CLIENT_FAILED;
  }
  return BOLO_CLIENT_FAILED;
}

int open(const char* name, int timeout_ms, bolo_client** client) {
  Refusal refusal = Refusal::kNone;
  Result<FollowedStream> stream = FollowedStream::open(name, timeout_ms, &refusal);
  if (stream) {
    *client = new bolo_client(std::move(*stream));
    return BOLO_CLIENT_OK;
  }
  thread_error.set(stream.error().message);
  return result_of(refusal);
}

BorrowedFrame borrowed(const bolo_client_frame& frame) {
  BorrowedFrame lent;
  lent.number = frame.number;
  lent.slot = static_cast<const std::byte*>(frame.slot);
  lent.layout.raw_offset = static_cast<std::size_t>(reinterpret_cast<const std::byte*>(frame.raw) - lent.slot);
  lent.layout.deblurred_offset =
      static_cast<std::size_t>(reinterpret_cast<const std::byte*>(frame.deblurred) - lent.slot);
  lent.layout.plane_bytes = std::size_t{2} * frame.width * frame.height;
  if (frame.motion != nullptr) {
    lent.layout.motion_offset = static_cast<std::size_t>(reinterpret_cast<const std::byte*>(frame.motion) - lent.slot);
    lent.layout.motion_blocks = std::size_t{frame.motion_across} * frame.motion_down;
  }
  return lent;
}

int streams(char* text, std::size_t bytes) {
  std::string all;
  for (const std::string& name : object_names()) all += name + "\n";
  if (bytes > 0) {
    const std::size_t length = std::min(all.size(), bytes - 1);
    std::memcpy(text, all.data(), length);
    text[length] = '\0';
  }
  return static_cast<int>(all.size() + 1);
}

}  // namespace
}  // namespace bolo::shm

using bolo::shm::bad_argument;
using bolo::shm::FollowedStream;
using bolo::shm::guarded;
using bolo::shm::thread_error;

const char* bolo_client_version(void) { return BOLO_VERSION; }

int bolo_client_streams(char* text, size_t bytes) {
  if (text == nullptr && bytes > 0) return bad_argument(thread_error, "bolo_client_streams: text is NULL");
  return guarded(thread_error, [&] { return bolo::shm::streams(text, bytes); });
}

int bolo_client_open(const char* name, int timeout_ms, bolo_client** client) {
  if (client == nullptr) return bad_argument(thread_error, "bolo_client_open: client is NULL");
  *client = nullptr;
  if (name == nullptr) return bad_argument(thread_error, "bolo_client_open: name is NULL");
  return guarded(thread_error, [&] { return bolo::shm::open(name, timeout_ms, client); });
}

void bolo_client_close(bolo_client* client) { delete client; }

const char* bolo_client_error(const bolo_client* client) {
  return client != nullptr ? client->error.text() : thread_error.text();
}

const struct bolo_client_info* bolo_client_get_info(const bolo_client* client) { return &client->info(); }

const struct bolo_client_state* bolo_client_get_state(bolo_client* client) { return &client->update_state(); }

int bolo_client_next(bolo_client* client, int timeout_ms, struct bolo_client_frame* frame) {
  if (client == nullptr) return bad_argument(thread_error, "bolo_client_next: client is NULL");
  if (frame == nullptr) return bad_argument(client->error, "bolo_client_next: frame is NULL");
  return guarded(client->error, [&] { return client->take(&FollowedStream::next, timeout_ms, *frame); });
}

int bolo_client_latest(bolo_client* client, int timeout_ms, struct bolo_client_frame* frame) {
  if (client == nullptr) return bad_argument(thread_error, "bolo_client_latest: client is NULL");
  if (frame == nullptr) return bad_argument(client->error, "bolo_client_latest: frame is NULL");
  return guarded(client->error, [&] { return client->take(&FollowedStream::latest, timeout_ms, *frame); });
}

int bolo_client_valid(const struct bolo_client_frame* frame) {
  return frame != nullptr && frame->slot != nullptr && bolo::shm::borrowed(*frame).still_there() ? 1 : 0;
}

int bolo_client_copy(const struct bolo_client_frame* frame, uint16_t* raw, uint16_t* deblurred) {
  if (frame == nullptr || frame->slot == nullptr) {
    return bad_argument(thread_error, "bolo_client_copy: no frame was put into this structure");
  }
  const bolo::shm::BorrowedFrame lent = bolo::shm::borrowed(*frame);
  bolo_shm_slot head{};
  return read_slot(lent.slot, lent.layout, lent.number, head, raw, deblurred) ? BOLO_CLIENT_OK
                                                                              : BOLO_CLIENT_OVERWRITTEN;
}

int bolo_client_copy_motion(const struct bolo_client_frame* frame, struct bolo_shm_motion* motion,
                            struct bolo_shm_block_motion* blocks) {
  if (frame == nullptr || frame->slot == nullptr) {
    return bad_argument(thread_error, "bolo_client_copy_motion: no frame was put into this structure");
  }
  if (frame->motion == nullptr) return BOLO_CLIENT_NO_MOTION;
  const bolo::shm::BorrowedFrame lent = bolo::shm::borrowed(*frame);
  bolo_shm_slot head{};
  return read_slot(lent.slot, lent.layout, lent.number, head, nullptr, nullptr, blocks, motion)
             ? BOLO_CLIENT_OK
             : BOLO_CLIENT_OVERWRITTEN;
}

int bolo_client_kelvin(bolo_client* client, const uint16_t* values, size_t count, float* kelvin) {
  if (client == nullptr) return bad_argument(thread_error, "bolo_client_kelvin: client is NULL");
  if (count > 0 && (values == nullptr || kelvin == nullptr)) {
    return bad_argument(client->error, "bolo_client_kelvin: values or kelvin is NULL");
  }
  return guarded(client->error, [&] { return client->kelvin({values, count}, kelvin); });
}

int bolo_client_points(bolo_client* client, uint64_t number, const struct bolo_client_point* points, size_t count,
                       float* values) {
  if (client == nullptr) return bad_argument(thread_error, "bolo_client_points: client is NULL");
  if (count > 0 && (points == nullptr || values == nullptr)) {
    return bad_argument(client->error, "bolo_client_points: points or values is NULL");
  }
  return guarded(client->error, [&] { return client->points(number, {points, count}, values); });
}

bolo_client_hold* bolo_client_hold_new(const bolo_client* client) {
  return client != nullptr ? new (std::nothrow) bolo_client_hold{client->hold()} : nullptr;
}

void bolo_client_hold_free(bolo_client_hold* hold) { delete hold; }
