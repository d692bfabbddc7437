// Shared memory tests: a writer driven by the test, and frames identified by their content.
#pragma once

#include <unistd.h>

#include "drivers/shm/shm_reader.hpp"
#include "drivers/shm/shm_sink.hpp"
#include "src/core/clock.hpp"
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/stats.hpp"
#include "tests/test.hpp"

namespace bolo::shm {

// Unique among tests that run in parallel.
inline std::string unique_name(const std::string& test) { return "test-" + test + "-" + std::to_string(getpid()); }

inline std::uint16_t pattern(std::uint64_t frame, std::size_t plane, std::size_t pixel) {
  return static_cast<std::uint16_t>(frame * 7919 + plane * 12345 + pixel);
}

inline void fill(std::vector<std::uint16_t>& plane, std::uint64_t frame, std::size_t which) {
  for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = pattern(frame, which, i);
}

// UTC of a frame; its first byte arrived at 1000 + number ns of the host's clock.
inline std::int64_t utc_of(std::uint64_t frame) {
  return 1'763'926'262'000'000'000 + static_cast<std::int64_t>(1000 + frame);
}

// Motion pattern of a frame; every seventh frame has none.
inline bool moves(std::uint64_t frame) { return frame % 7 != 3; }
inline float motion_pattern(std::uint64_t frame, std::size_t block, std::size_t value) {
  return static_cast<float>(frame % 1000) + 0.25F * static_cast<float>(block) + 1000.0F * static_cast<float>(value);
}

// A sink with its format and the statistics of a pipeline.
struct Writer {
  explicit Writer(const std::string& name, Geometry geometry = {33, 7}, int slots = 0) : sink({name, slots, 0644, ""}) {
    format.source.format.geometry = geometry;
    format.source.format.scale = {Unit::kKelvin, 0.01, 5.0};
    format.source.camera_model = "Model";
    format.source.camera_serial = "1234";
    format.deblur = deblur::Settings();
    format.isa = "auto";
    format.solver_text = "admm";
  }

  Status open() { return sink.open(format); }

  // Publishes the next frame; its frame id is twice its number.
  void publish() {
    const std::size_t pixels = format.source.format.geometry.pixels();
    raw.resize(pixels);
    deblurred.resize(pixels);
    fill(raw, next, 0);
    fill(deblurred, next, 1);
    const auto n = static_cast<std::int64_t>(next);
    FrameMeta meta{2 * next, n * 5'000'000, received_from_ns + n,
                   flags | (next % 5 == 0 ? std::uint32_t{kFlagGap} : 0U)};
    meta.utc_ns = utc_of(next) + clock_set_by_ns;
    meta.utc_uncertainty_ns = 1'500'001;
    pipeline::PublishedFrame frame{meta, 2000 + n, raw.data(), deblurred.data()};
    if (format.motion && moves(next)) frame.motion = &move();
    sink.publish(frame, stats);
    ++next;
  }

  // Publishes about 500 frames a second until `enough`, for at most a minute.
  template <typename Enough>
  void publish_until(Enough enough) {
    const std::int64_t begin_ns = monotonic_ns();
    while (!enough() && monotonic_ns() - begin_ns < 60'000'000'000) {
      publish();
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

  // The next frame's motion pattern.
  const SceneMotion& move() {
    if (motion.blocks.empty()) motion = SceneMotion(format.source.format.geometry);
    for (std::size_t i = 0; i < motion.blocks.size(); ++i) {
      motion.blocks[i] = {motion_pattern(next, i, 0), motion_pattern(next, i, 1), motion_pattern(next, i, 2)};
    }
    motion.affine = {static_cast<double>(next), 1, 2, 3, 4, 5};
    return motion;
  }

  pipeline::SinkFormat format;  // with motion, frames carry its pattern
  SceneMotion motion;
  pipeline::FrameInlet inlet{StreamFormat{{1, 1}, PixelType::kUint16, {}, 0.005, 1}, 1, 1};
  pipeline::PipelineStats stats{inlet};
  ShmSink sink;
  std::uint64_t next = 0;
  std::uint32_t flags = 0;  // of all frames; every fifth has a gap, too
  std::int64_t received_from_ns = 1000;
  std::int64_t clock_set_by_ns = 0;  // step of the host's UTC since the first frame
  std::vector<std::uint16_t> raw;
  std::vector<std::uint16_t> deblurred;
};

// An open stream of a unique name, with an open reader. `change` is applied to the writer before it opens.
struct Stream {
  explicit Stream(
      const std::string& test, Geometry geometry = {33, 7}, void (*change)(Writer&) = [](Writer&) {})
      : name(unique_name(test)), writer(name, geometry) {
    change(writer);
    const Status opened = writer.open();
    if (!opened) throw std::runtime_error(opened.error().message);
    reader = ShmReader::open(name);
    if (!reader) throw std::runtime_error(reader.error().message);
  }

  std::string name;
  Writer writer;
  Result<ShmReader> reader = failed("");
};

// True if every value of the frame belongs to frame `number`.
inline bool intact(const ReadFrame& frame, std::uint64_t number) {
  if (frame.number != number || frame.meta.frame_id != 2 * number) return false;
  for (std::size_t i = 0; i < frame.raw.size(); ++i) {
    if (frame.raw[i] != pattern(number, 0, i) || frame.deblurred[i] != pattern(number, 1, i)) return false;
  }
  for (std::size_t i = 0; i < frame.motion.size(); ++i) {
    const bool same = frame.motion[i].x == motion_pattern(number, i, 0) &&
                      frame.motion[i].y == motion_pattern(number, i, 1) &&
                      frame.motion[i].confidence == motion_pattern(number, i, 2);
    if (!same || frame.affine[0] != static_cast<double>(number)) return false;
  }
  return !frame.raw.empty();
}

}  // namespace bolo::shm
