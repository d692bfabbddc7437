// The C functions of bolo/client.h: arguments checked, exceptions stopped, everything else in Handle.
#include "bolo/client.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <string>

#include "drivers/shm/client/handle.hpp"
#include "drivers/shm/shm_object.hpp"
#include "src/core/threads.hpp"

// The C header's names. NOLINTBEGIN(readability-identifier-naming)
struct bolo_client : bolo::shm::Handle {
  using Handle::Handle;
};
struct bolo_client_hold {
  std::shared_ptr<const void> object;
};
// NOLINTEND(readability-identifier-naming)

// Programs in use rely on these; bolo.py declares the same structures.
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

// Of the thread's last call without a handle.
thread_local ErrorText thread_error;

// The result of `call`, or BOLO_CLIENT_FAILED for what it threw.
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
