// Inputs and outputs of `bolo convert`: frames one after the other.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/output_file.hpp"
#include "tools/convert/picture.hpp"

namespace bolo::tools {

// One frame, in the footage's pixel type.
struct Frame : Plane {
  double t_s = 0.0;
  std::uint64_t id = 0;
  std::optional<capture::FrameTimes> times{};  // exactly where Footage::info().has_times
  std::size_t part = 0;                        // of Footage::parts()
};

// Beyond frames.
struct Extras {
  std::vector<capture::Event> events;
  std::vector<capture::Attribute> attributes;
  capture::Stimulus stimulus;
};

class Footage {
 public:
  virtual ~Footage() = default;
  const capture::CaptureInfo& info() const noexcept { return info_; }
  // Frame `index` below info().frames, in rising order.
  virtual Status read(std::size_t index, Frame& frame) = 0;
  // Nothing for pictures.
  virtual Result<Extras> extras() const { return Extras{}; }
  // Its parts, which it outlives: by Frame::part. Usually itself.
  virtual std::vector<const Footage*> parts() const { return {this}; }

 protected:
  capture::CaptureInfo info_;
};

// Properties that the user states for files without them.
struct StatedFormat {
  double rate_hz = 30.0;
  std::optional<LinearScale> scale;  // of whole numbers; nothing: counts
};

struct RawLayout {
  Geometry geometry;
  PixelType type = PixelType::kUint16;
  bool big_endian = false;
  std::uint64_t skip_bytes = 0;  // before the first frame
};

using Files = std::vector<std::filesystem::path>;

// Errors (kBadInput) name the file and what is wrong in it. Thread: any one at a time.
Result<std::unique_ptr<Footage>> open_capture(const std::filesystem::path& file);
// Several captures of one camera, frame by frame in the order of their times.
Result<std::unique_ptr<Footage>> open_captures(const Files& files);
// The images of one topic of a recording of ROS 2; empty: of the only one that has images.
Result<std::unique_ptr<Footage>> open_mcap(const std::filesystem::path& file, const std::string& topic,
                                           const StatedFormat& stated);
// PNG (16-bit grey), TIFF (uint16 or float32, any number of pages) and radiometric JPEG, by their extensions; all of
// one size and type.
Result<std::unique_ptr<Footage>> open_pictures(const Files& files, const StatedFormat& stated);
Result<std::unique_ptr<Footage>> open_raw(const Files& files, const RawLayout& layout, const StatedFormat& stated);

// --- CPTV version 2: films of Lepton cameras as The Cacophony Project records them. The whole file is gzip's; each
// frame is the difference from the one before, and of that the differences along a snake through the rows, in as few
// bits as they need (github.com/TheCacophonyProject/go-cptv, SPECv2.md; the compression is scheme 1 of its reader).

// Values are counts unless `stated` has a scale: the file has none. Background frames, which a device computes, are
// skipped. Reads the file once for its structure, and again for the frames. Errors (kBadInput) name the file. Thread:
// any one at a time.
Result<std::unique_ptr<Footage>> open_cptv(const std::filesystem::path& file, const StatedFormat& stated);

// --- Outputs of `bolo convert`: a capture, pictures, or a film.

// Black and white of 8-bit pictures, K (counts without kelvin); none: they follow the scene.
using EyeRange = std::optional<std::pair<double, double>>;

struct Target {
  OutputFile file;       // its extension is the format: .h5, .mcap, .png, .tif, .tiff, .mp4
  Files inputs;          // that it must not be
  bool preview = false;  // PNG: 8 bit for the eye instead of 16 linear ones
  EyeRange range{};      // of these, and of films
  LinearScale picture_scale{Unit::kKelvin, 0.01, 0.0};  // of 16-bit pictures of footage in floating point
  std::string name = "thermal";                         // MCAP: the camera's, in its topics
};

class FootageSink {
 public:
  virtual ~FootageSink() = default;
  virtual Status write(const Frame& frame) = 0;
  virtual Status finish() = 0;
  // Description of the files' values; empty when they state it themselves.
  virtual std::string meaning() const { return {}; }
  // The files written, where they are not the one named; empty: they are.
  virtual std::string files() const { return {}; }
};

// Errors: an output that may not be written (kBadInput), an extension that is none of these (kBadInput), files that
// cannot be created. Thread: any one at a time.
Result<std::unique_ptr<FootageSink>> open_sink(const Target& target, const Footage& footage);
Result<std::unique_ptr<FootageSink>> open_mcap_sink(const Target& target, const Footage& footage);

}  // namespace bolo::tools
