// Reads Bolo's shared memory: the newest frame, or every frame in order. Never disturbs the writer.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bolo/core/frame.hpp"
#include "bolo/core/result.hpp"
#include "bolo/shm_layout.h"

namespace bolo::shm {

struct ReadFrame {
  std::uint64_t number = 0;  // publication order
  FrameMeta meta;
  std::int64_t publish_ns = 0;
  std::vector<std::uint16_t> raw;
  std::vector<std::uint16_t> deblurred;
};

class ShmReader {
 public:
  // Maps "/bolo." + name read-only and checks magic, version and every offset against the object's size. Thread: setup.
  static Result<ShmReader> open(const std::string& name);
  // The names that exist now, sorted: "cam" for the object "/bolo.cam", whether its writer lives or not. Thread: any.
  static std::vector<std::string> names();

  ShmReader(ShmReader&&) noexcept;
  ShmReader& operator=(ShmReader&&) noexcept;
  ~ShmReader();

  // A copy of the header: geometry and texts as checked by open(), counters and histogram as they are now. Thread: any.
  bolo_shm_header header() const noexcept;

  enum class Outcome {
    kFrame,        // `frame` holds the frame asked for
    kOverwritten,  // the writer was faster: it is gone
    kTimeout,      // not published in time
    kClosed,       // the writer ended, or its heartbeat stopped
  };
  // Copies frame `number` (publication order), waiting for it up to timeout_ms. The vectors of `frame` are reused, and
  // worth nothing after any outcome but kFrame. Frames that are still in the ring can be read after the writer's end.
  // Thread: one at a time.
  Outcome read(std::uint64_t number, ReadFrame& frame, int timeout_ms) noexcept;

  // The head of frame `number` and the raw values of single pixels of it, row-major indices inside the frame; `out` has
  // as many values. False when the ring does not hold it, any more or yet. Thread: any.
  bool read_samples(std::uint64_t number, std::span<const std::uint32_t> pixels, bolo_shm_slot& head,
                    std::uint16_t* out) const noexcept;

  // What the writer solves frames with; nothing when it does not tell. Thread: any.
  std::optional<bolo_shm_settings> settings() const noexcept;

  // What the writer knows of its camera, as it is now; nothing when it does not tell. Thread: any.
  std::optional<bolo_shm_camera> camera() const noexcept;

  // Frames published so far: the newest is published() - 1. Thread: any.
  std::uint64_t published() const noexcept;

  // The writer ended, or its heartbeat stopped; open() finds its successor. Thread: any.
  bool closed() const noexcept;

 private:
  struct Impl;
  explicit ShmReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::shm
