// Inputs and outputs of `bolo convert`, frame by frame.
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
  std::optional<capture::FrameTimes> times{};  // present if Footage::info().has_times
  std::size_t part = 0;                        // index in Footage::parts()
};

// Contents of a capture besides frames.
struct Extras {
  std::vector<capture::Event> events;
  std::vector<capture::Attribute> attributes;
  capture::Stimulus stimulus;
};

class Footage {
 public:
  virtual ~Footage() = default;
  const capture::CaptureInfo& info() const noexcept { return info_; }
  // Reads frame `index` (below info().frames); indices must rise.
  virtual Status read(std::size_t index, Frame& frame) = 0;
  // Empty for pictures.
  virtual Result<Extras> extras() const { return Extras{}; }
  // The parts that Frame::part refers to; they live as long as this. Usually this footage itself.
  virtual std::vector<const Footage*> parts() const { return {this}; }

 protected:
  capture::CaptureInfo info_;
};

// Properties that the user states for files that lack them.
struct StatedFormat {
  double rate_hz = 30.0;
  std::optional<LinearScale> scale;  // of integers; nothing: counts
};

struct RawLayout {
  Geometry geometry;
  PixelType type = PixelType::kUint16;
  bool big_endian = false;
  std::uint64_t skip_bytes = 0;  // before the first frame
};

using Files = std::vector<std::filesystem::path>;

// Errors (kBadInput) name the file and its fault. Thread: any one at a time.
// A capture, or several of one camera, their frames merged in order of time.
Result<std::unique_ptr<Footage>> open_captures(const Files& files);
// The images of one topic in a recording of ROS 2; empty: of the only topic with images.
Result<std::unique_ptr<Footage>> open_mcap(const std::filesystem::path& file, const std::string& topic,
                                           const StatedFormat& stated);
// PNG (16-bit grey), TIFF (uint16 or float32, with pages) and radiometric JPEG by extension, all of one size and type.
Result<std::unique_ptr<Footage>> open_pictures(const Files& files, const StatedFormat& stated);
Result<std::unique_ptr<Footage>> open_raw(const Files& files, const RawLayout& layout, const StatedFormat& stated);

// --- CPTV version 2: films of Lepton cameras as The Cacophony Project records them, gzipped. A frame is its difference
// from the one before, stored as successive differences along a snake through the rows, in as few bits as they need
// (github.com/TheCacophonyProject/go-cptv, SPECv2.md; compression scheme 1 of its reader).

// Values are counts unless `stated` has a scale: the file has none. Skips background frames, which a device computes.
// Reads the file once for its structure, then for the frames. Errors (kBadInput) name the file. Thread: any one at a
// time.
Result<std::unique_ptr<Footage>> open_cptv(const std::filesystem::path& file, const StatedFormat& stated);

// --- Outputs of `bolo convert`: a capture, pictures, or a film.

// Black and white level of 8-bit pictures, K (counts if not radiometric); none: they follow the scene.
using EyeRange = std::optional<std::pair<double, double>>;

struct Target {
  OutputFile file;       // its extension selects the format: .h5, .mcap, .png, .tif, .tiff, .mp4
  Files inputs;          // must differ from `file`
  bool preview = false;  // PNG: 8 bits for the eye instead of linear 16 bits
  EyeRange range{};      // of preview pictures and films
  LinearScale picture_scale{Unit::kKelvin, 0.01, 0.0};  // of 16-bit pictures from floating-point footage
  std::string name = "thermal";                         // MCAP: camera name in topics
};

class FootageSink {
 public:
  virtual ~FootageSink() = default;
  virtual Status write(const Frame& frame) = 0;
  virtual Status finish() = 0;
  // Describes the values in the files; empty when the files state it themselves.
  virtual std::string meaning() const { return {}; }
  // The files written, if not the one named; else empty.
  virtual std::string files() const { return {}; }
};

// Errors (kBadInput): an output that may not be written, an unknown extension; also files that cannot be created.
// Thread: any one at a time.
Result<std::unique_ptr<FootageSink>> open_sink(const Target& target, const Footage& footage);
Result<std::unique_ptr<FootageSink>> open_mcap_sink(const Target& target, const Footage& footage);

}  // namespace bolo::tools
