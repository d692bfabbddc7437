// What the soak's camera looks at, and what must become of it: every plane that bolod may publish.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <unordered_map>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/pipeline.hpp"

namespace bolo::tools::soak {

// How a camera that fails shows a frame.
struct Manner {
  int offset = 0;         // of all pixels, counts: a shutter's
  bool swapped = false;   // the bytes of each pixel
  bool metadata = false;  // the last rows are no pixels

  bool operator==(const Manner&) const = default;
};

struct Recognised {
  std::size_t index = 0;  // in the capture
  Manner manner;
};

// A plane's checksum (CRC-32 of its values less the first one's, so that an offset of all does not matter), of the
// whole and without the last rows. Thread: any.
struct Fingerprint {
  std::uint32_t whole = 0;
  std::uint32_t upper = 0;
};
Fingerprint fingerprint(const std::uint16_t* plane, Geometry geometry, std::vector<std::uint16_t>& scratch);

inline constexpr int kRowsBelow = 3;
inline constexpr double kShutterOffset_k = 0.5;

class Truth {
 public:
  using Planes = std::vector<std::vector<std::uint16_t>>;
  struct Scratch {
    std::vector<std::uint16_t> differences;
    std::vector<std::uint16_t> unswapped;
  };

  // `deblurred`: of the same frames in an endless loop; empty: not known. Thread: setup.
  Truth(Geometry geometry, const Planes& raw, Planes deblurred);

  // The frame of the capture that this plane is, value by value (by its checksum), however the camera shows it.
  // `scratch`: memory to work in, the caller's. Thread: any.
  std::optional<Recognised> recognise(const std::uint16_t* raw, Scratch& scratch) const;

  // Whether this is what an undisturbed run makes of the capture's frame; with an offset, within its rounding.
  // Thread: any.
  bool right(const std::uint16_t* deblurred, std::size_t index, int offset) const;

  std::size_t frames() const noexcept { return first_.size(); }

 private:
  std::optional<Recognised> find(const std::uint16_t* raw, bool swapped, Scratch& scratch) const;

  Geometry geometry_;
  std::unordered_map<std::uint32_t, std::size_t> by_whole_;
  std::unordered_map<std::uint32_t, std::size_t> by_upper_;
  std::vector<std::uint16_t> first_;  // value of each frame's first pixel
  Planes deblurred_;
};

struct SceneRequest {
  Geometry geometry{640, 120};
  double rate_hz = 200.0;
  std::size_t frames = 240;
  std::uint64_t street = 5;
};

// A street that passes by, written as a capture for the fake camera, and what `pipeline` makes of it in an endless
// loop. Thread: setup.
Result<Truth> make_scene(const SceneRequest& request, const pipeline::PipelineOptions& pipeline,
                         const std::filesystem::path& capture);

}  // namespace bolo::tools::soak
