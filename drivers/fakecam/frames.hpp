// Frames of the camera: their source, and the counts, ids and time stamps on the wire.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "drivers/fakecam/fault_script.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "src/capture/capture.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::fakecam {

// --- Output frames: a reader fills slots ahead of time, the sender sends them in order and keeps them for resends.

struct WireFrame {
  gvsp::BlockInfo block;
  std::uint64_t sequence = 0;
  std::int64_t due_ns = 0;            // relative to the stream's first frame
  bool withheld = false;              // never sent
  FaultSet hit = 0;                   // faults that affect it
  FaultSet struck = 0;                // faults that begin with it
  std::vector<std::uint16_t> counts;  // little-endian on the wire, as in host memory

  std::size_t payload_bytes() const { return counts.size() * sizeof(std::uint16_t); }
};

// Frame s lies in slot s % slots; written >= sent, by at most `ahead`. A slot is reused only when its frame was sent,
// is `keep` frames old and is not pinned. One mutex guards the positions; no pixels are touched under it. Thread: one
// writer, one sender, any number of finders.
class FrameRing {
 public:
  FrameRing(std::size_t ahead, std::size_t keep, std::size_t pixels);

  struct Unpin {
    FrameRing* ring = nullptr;
    void operator()(const WireFrame* frame) const;
  };
  // Keeps a recently sent frame unchanged while it exists. Null when the frame is gone or not sent yet.
  using Pin = std::unique_ptr<const WireFrame, Unpin>;

  // Waits for a free slot. nullptr once the ring is closed. Thread: writer.
  WireFrame* begin_write();
  void end_write();
  void finish();  // no more frames follow

  // Waits for the next frame. nullptr once the ring is closed, or finished and empty. Thread: sender.
  const WireFrame* begin_send();
  void end_send();

  // The youngest frame with this block id that is sent or being sent. Thread: any.
  Pin find(std::uint16_t block_id);

  // Wakes all waiting threads; no further wait blocks. Thread: any.
  void close();

 private:
  std::size_t slot(std::uint64_t sequence) const { return static_cast<std::size_t>(sequence % frames_.size()); }
  // Changes the state under the mutex, then wakes all waiting threads.
  void change(auto what) {
    {
      const std::lock_guard lock(mutex_);
      what();
    }
    changed_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<WireFrame> frames_;
  std::vector<int> pins_;
  std::size_t ahead_;
  std::uint64_t written_ = 0;  // frames filled
  std::uint64_t sent_ = 0;     // frames sent
  std::uint64_t visible_ = 0;  // frames sent or being sent
  std::uint64_t oldest_ = 0;   // oldest frame whose slot has not been reused
  bool finished_ = false;
  bool closed_ = false;
};

// A finite sequence of frames with the original camera's counters and times.
struct FrameProvider {
  StreamFormat format;
  std::vector<std::uint64_t> frame_ids;  // rising
  std::vector<double> times_s;           // rising, as many as frame_ids
  std::string serial;                    // of the original camera; empty: unknown
  std::vector<std::byte> planes;         // of all frames; empty: read_one reads each
  std::function<Status(std::size_t index, void* out)> read_one{};

  // Reads a frame in its stored type; `out` has plane_bytes(format.geometry, format.type) bytes. Thread: one at a time.
  Status read(std::size_t index, void* out) const;
};

// Opens a capture. Up to `preload_bytes` it is read completely, so that the stream does not depend on the disk; a
// larger one is read frame by frame. Errors: the reader's; an empty capture. Thread: setup.
Result<FrameProvider> open_capture(const std::filesystem::path& file,
                                   std::size_t preload_bytes = std::size_t{1} << 30U);

// FLIR's IRFormat: the meaning of a count.
enum class IrFormat : std::uint32_t {
  kRadiometric = 0,             // proportional to radiance; the Planck constants lead to a temperature
  kTemperatureLinear100mK = 1,  // kelvin * 10
  kTemperatureLinear10mK = 2,   // kelvin * 100
};

// 1 for radiometric counts, which are not proportional to kelvin. Thread: any.
constexpr double counts_per_kelvin(IrFormat format) {
  if (format == IrFormat::kRadiometric) return 1.0;
  return format == IrFormat::kTemperatureLinear10mK ? 100.0 : 10.0;
}

// Radiance counts of an object with emissivity 1 behind a clear atmosphere: J0 + J1 * R / (exp(B / kelvin) - F).
struct PlanckConstants {
  double r = 17000.0;
  double b = 1428.0;
  double f = 1.0;
  double j0 = 4000.0;
  double j1 = 60.0;
};
inline constexpr PlanckConstants kPlanck;

// Crops planes of one format and converts them to counts. Planes in kelvin become counts of the IrFormat, rounded and
// clamped to 16 bits; planes in counts are sent unchanged. Thread: one at a time.
class CountConverter {
 public:
  // `region` must lie inside format.geometry.
  CountConverter(const StreamFormat& format, IrFormat ir_format, Region region);

  // `plane`: the whole stored plane. `out`: region.width * region.height counts, row-major. noexcept, no allocation.
  void convert(const void* plane, std::uint16_t* out) const noexcept;

 private:
  std::uint16_t count_of(double stored) const noexcept;

  StreamFormat format_;
  IrFormat ir_format_;
  Region region_;
  std::vector<std::uint16_t> table_;  // counts for each 16-bit stored value; empty for the identity
};

struct Moment {
  std::size_t index = 0;  // of the frame in the capture
  std::uint64_t frame_id = 0;
  std::uint64_t timestamp_ns = 0;
};

// GigE Vision 1.2 has nonzero 16-bit block ids; steps of the capture's counter are preserved. Thread: any.
constexpr std::uint16_t block_id_of(std::uint64_t frame_id) { return static_cast<std::uint16_t>(frame_id % 65535 + 1); }

// Replays a capture lap after lap without a break: between laps the id and the time advance by one frame. Times are the
// capture's at its own rate; at another rate R they are spaced 1/R, lost frames included. Thread: any (immutable).
class Timeline {
 public:
  // Both spans have the same size, at least 1, and rise. rate_hz 0: the capture's rate.
  Timeline(std::span<const std::uint64_t> frame_ids, std::span<const double> times_s, double period_s, double rate_hz);

  std::size_t frames() const { return ids_.size(); }
  Moment at(std::uint64_t sequence) const;

 private:
  std::vector<std::uint64_t> ids_;
  std::vector<std::int64_t> times_ns_;
  std::uint64_t lap_ids_ = 0;
  std::int64_t lap_ns_ = 0;
};

}  // namespace bolo::fakecam
