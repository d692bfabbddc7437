// Frames: their size and the meaning of their values, their metadata, and their planes.
#pragma once

#include <cstddef>
#include <cstdint>

namespace bolo {

// Planes are stored row-major without padding: pixel (x, y) is element y * width + x.
struct Geometry {
  int width = 0;
  int height = 0;

  constexpr std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  constexpr bool operator==(const Geometry&) const = default;
};

// A rectangle of pixels: columns [x, x + width), rows [y, y + height).
struct Region {
  int x = 0;
  int y = 0;
  int width = 0;
  int height = 0;

  constexpr bool operator==(const Region&) const = default;
  constexpr bool inside(Geometry g) const {
    return x >= 0 && y >= 0 && width > 0 && height > 0 && x <= g.width - width && y <= g.height - height;
  }
};

enum class Unit {
  kKelvin,  // temperature: kelvin = scale * value + offset
  kCount,   // uncalibrated camera counts: scale and offset carry no meaning
};

struct LinearScale {
  Unit unit = Unit::kKelvin;
  double scale = 0.01;  // K a count; 10 mK is the A655sc's TemperatureLinear10mK
  double offset = 0.0;  // K

  // kelvin from a stored value; for kCount the value itself. Thread: any.
  constexpr double to_physical(double value) const { return unit == Unit::kKelvin ? scale * value + offset : value; }
  constexpr bool operator==(const LinearScale&) const = default;
};

// State of a frame. The values are part of the shared-memory layout (shm_layout.h).
enum FrameFlag : std::uint32_t {
  kFlagNone = 0,
  kFlagGap = 1U << 0,        // at least one frame of this frame's window was lost
  kFlagWarmUp = 1U << 1,     // no full window reaches back yet: the deblurred plane is the raw one
  kFlagNuc = 1U << 2,        // the camera was correcting (shutter closed) while this frame was taken
  kFlagSaturated = 1U << 3,  // raw values at the end of the 16-bit range
  kFlagJitter = 1U << 4,     // the camera's timestamp is off the frame grid; bits 5 to 7: pipeline/quality_level.hpp
};

struct FrameMeta {
  std::uint64_t frame_id = 0;   // the camera's counter, unwrapped; a jump is a lost frame
  std::int64_t camera_ns = 0;   // the camera's clock
  std::int64_t receive_ns = 0;  // host CLOCK_MONOTONIC, when the frame's first byte arrived
  std::uint32_t flags = kFlagNone;
  std::int64_t host_ns = 0;  // camera_ns on the host's CLOCK_MONOTONIC, estimated for monitored cameras; 0: not known
  // UTC of host_ns, or of receive_ns if that is 0; filled in by the pipeline. ns since 1970; 0: not known.
  std::int64_t utc_ns = 0;
  std::int64_t utc_uncertainty_ns = 0;  // bound of the error of utc_ns; see bolo_shm_slot
};

// Time of the frame on the host's CLOCK_MONOTONIC: its arrival if the camera's clock is not mapped. Thread: any.
inline std::int64_t host_time_ns(const FrameMeta& meta) noexcept {
  return meta.host_ns != 0 ? meta.host_ns : meta.receive_ns;
}

// Pixels [begin, end) of a frame, row-major.
struct PixelRange {
  std::size_t begin = 0;
  std::size_t end = 0;
};

enum class PixelType {
  kUint16,   // cameras and shared memory
  kFloat32,  // captures converted to kelvin, and offline results
};

// Bytes of one value. Thread: any.
constexpr std::size_t bytes_of(PixelType type) { return type == PixelType::kUint16 ? 2 : 4; }

// Bytes of one whole plane. Thread: any.
constexpr std::size_t plane_bytes(Geometry g, PixelType type) { return g.pixels() * bytes_of(type); }

// Format of a stream's frames; fixed from open to close.
struct StreamFormat {
  Geometry geometry;
  PixelType type = PixelType::kUint16;
  LinearScale scale;
  double frame_period_s = 0.005;
  int row_step = 1;  // sensor rows that one stored row stands for

  constexpr bool operator==(const StreamFormat&) const = default;
};

}  // namespace bolo
