// Outputs of `bolo convert`: a capture, pictures, or a film.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "src/core/output_file.hpp"
#include "tools/convert/footage.hpp"

namespace bolo::tools {

// Black and white of 8-bit pictures, K (counts without kelvin); none: they follow the scene.
using EyeRange = std::optional<std::pair<double, double>>;

struct Target {
  OutputFile file;       // its extension says what is written: .h5, .mcap, .png, .tif, .tiff, .mp4
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
  // Meaning of the files' values, in words; empty when they state it themselves.
  virtual std::string meaning() const { return {}; }
  // The files written, where they are not the one named; empty: they are.
  virtual std::string files() const { return {}; }
};

// Errors: an output that may not be written (kBadInput), an extension that is none of these (kBadInput), files that
// cannot be created. Thread: any one at a time.
Result<std::unique_ptr<FootageSink>> open_sink(const Target& target, const Footage& footage);
Result<std::unique_ptr<FootageSink>> open_mcap_sink(const Target& target, const Footage& footage);

}  // namespace bolo::tools
