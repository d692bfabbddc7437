// The `/stimulus` group: one row of the table in ARCHITECTURE.md a kind.
#pragma once

#include "src/capture/h5.hpp"
#include "src/capture/stimulus.hpp"

namespace bolo::capture {

// NoStimulus when the group is absent. Errors (kBadInput) name the field. Thread: any one at a time.
Result<Stimulus> read_stimulus(hid_t file);

// The rules that read_stimulus() holds a file to; writers refuse the same. Thread: any.
Status check_stimulus(const Stimulus& stimulus);

// `stimulus` has passed check_stimulus(). Errors: kFailed with the library's cause. Thread: any one at a time.
Status write_stimulus(hid_t file, const Stimulus& stimulus);

// A 2-dimensional dataset of numbers as float32, row-major. Thread: any one at a time.
struct Image {
  int width = 0;
  int height = 0;
  std::vector<float> values;
};
Result<Image> read_image(hid_t file, const std::string& path);

}  // namespace bolo::capture
