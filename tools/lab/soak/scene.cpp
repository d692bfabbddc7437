#include "tools/lab/soak/scene.hpp"

#include <zlib.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "src/capture/capture.hpp"
#include "src/core/byte_order.hpp"
#include "tools/lab/eval/faults.hpp"
#include "tools/lab/recording.hpp"

namespace bolo::tools::soak {
namespace {

constexpr std::uint64_t kFirstId = 100;
constexpr const char* kSerial = "SOAK";

std::uint32_t checksum(const std::uint16_t* values, std::size_t count) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const unsigned char*>(values), count * sizeof(values[0])));
}

std::size_t upper_pixels(Geometry geometry) {
  const int rows = std::max(1, geometry.height - kRowsBelow);
  return static_cast<std::size_t>(rows) * static_cast<std::size_t>(geometry.width);
}

Status write(const Recording& scene, const std::filesystem::path& file) {
  capture::CaptureInfo info;
  info.format = scene.format;
  info.camera_model = "Soak";
  info.camera_serial = kSerial;
  ASSIGN_OR_RETURN(auto writer, capture::CaptureWriter::create(file, info));
  for (std::size_t k = 0; k < scene.planes.size(); ++k) {
    const double t_s = static_cast<double>(k + 1) * scene.format.frame_period_s;
    if (Status done = writer.append(t_s, kFirstId + k, scene.planes[k].data()); !done) return done;
  }
  return writer.close();
}

// Two laps, of which the second is as every later one: its first windows reach over the seam.
Result<Truth::Planes> deblurred_loop(const Recording& scene, const pipeline::PipelineOptions& pipeline) {
  Recording twice = scene;
  twice.planes.insert(twice.planes.end(), scene.planes.begin(), scene.planes.end());
  pipeline::PipelineOptions unhurried = pipeline;
  unhurried.degrade = false;
  auto planes = faults::undisturbed(twice, unhurried);
  if (!planes) return tl::unexpected<Error>(planes.error());
  planes->erase(planes->begin(), planes->begin() + static_cast<std::ptrdiff_t>(scene.planes.size()));
  return planes;
}

}  // namespace

Fingerprint fingerprint(const std::uint16_t* plane, Geometry geometry, std::vector<std::uint16_t>& scratch) {
  scratch.resize(geometry.pixels());
  const std::uint16_t first = plane[0];
  for (std::size_t i = 0; i < scratch.size(); ++i) scratch[i] = static_cast<std::uint16_t>(plane[i] - first);
  const std::size_t upper = upper_pixels(geometry);
  const std::uint32_t above = checksum(scratch.data(), upper);
  const std::uint32_t below = checksum(scratch.data() + upper, scratch.size() - upper);
  const auto below_bytes = static_cast<long>((scratch.size() - upper) * sizeof(scratch[0]));
  return {static_cast<std::uint32_t>(crc32_combine(above, below, below_bytes)), above};
}

Truth::Truth(Geometry geometry, const Planes& raw, Planes deblurred)
    : geometry_(geometry), deblurred_(std::move(deblurred)) {
  Scratch scratch;
  for (std::size_t k = 0; k < raw.size(); ++k) {
    const Fingerprint print = fingerprint(raw[k].data(), geometry_, scratch.differences);
    by_whole_.emplace(print.whole, k);
    by_upper_.emplace(print.upper, k);
    first_.push_back(raw[k][0]);
  }
}

std::optional<Recognised> Truth::recognise(const std::uint16_t* raw, Scratch& scratch) const {
  if (auto found = find(raw, false, scratch)) return found;
  scratch.unswapped.resize(geometry_.pixels());
  for (std::size_t i = 0; i < scratch.unswapped.size(); ++i) scratch.unswapped[i] = swap_bytes(raw[i]);
  return find(scratch.unswapped.data(), true, scratch);
}

std::optional<Recognised> Truth::find(const std::uint16_t* raw, bool swapped, Scratch& scratch) const {
  const Fingerprint print = fingerprint(raw, geometry_, scratch.differences);
  const auto as = [&](std::size_t index, bool metadata) {
    return Recognised{index, {static_cast<int>(raw[0]) - static_cast<int>(first_[index]), swapped, metadata}};
  };
  if (const auto whole = by_whole_.find(print.whole); whole != by_whole_.end()) return as(whole->second, false);
  if (const auto upper = by_upper_.find(print.upper); upper != by_upper_.end()) return as(upper->second, true);
  return std::nullopt;
}

bool Truth::right(const std::uint16_t* deblurred, std::size_t index, int offset) const {
  if (deblurred_.empty()) return true;
  const std::vector<std::uint16_t>& expected = deblurred_[index];
  if (offset == 0) return std::memcmp(deblurred, expected.data(), expected.size() * sizeof(expected[0])) == 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (std::abs(static_cast<int>(deblurred[i]) - static_cast<int>(expected[i]) - offset) > 1) return false;
  }
  return true;
}

Result<Truth> make_scene(const SceneRequest& request, const pipeline::PipelineOptions& pipeline,
                         const std::filesystem::path& capture) {
  sim::CameraSettings camera;
  camera.geometry = request.geometry;
  camera.rate_hz = request.rate_hz;
  ASSIGN_OR_RETURN(auto scene, record_street(camera, {.street = request.street, .frames = request.frames}));
  scene.truth.clear();
  RETURN_IF_ERROR(write(scene, capture));
  ASSIGN_OR_RETURN(auto deblurred, deblurred_loop(scene, pipeline));
  Truth::Planes raw;
  for (const auto& bytes : scene.planes) {
    raw.emplace_back(request.geometry.pixels());
    std::memcpy(raw.back().data(), bytes.data(), bytes.size());
  }
  return Truth(request.geometry, raw, std::move(deblurred));
}

}  // namespace bolo::tools::soak
