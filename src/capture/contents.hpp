// Contents of a capture file, read from either format.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/capture/frame_store.hpp"

namespace bolo::capture {

struct Contents {
  CaptureInfo info;
  FileFormat file_format = FileFormat::kBoloCapture;
  std::vector<double> t;
  std::vector<std::uint64_t> frame_id;
  std::vector<Event> events;
  Result<Stimulus> stimulus = Stimulus{};  // an error is for those who ask for it: frames are good without
  std::vector<std::string> warnings;
  std::optional<FrameStore> frames;  // always there after open
  std::optional<FrameStore> truth;
  std::optional<FrameStore> motion;
};

// "bolo-capture" version 1. Unless it is trusted whole its datasets may differ in length; the frames that all of them
// have are taken. Errors (kBadInput) name the item. Thread: any one at a time.
Result<Contents> read_bolo_capture(hid_t file, Trust trust);

// Root attributes beyond the format's own.
std::vector<Attribute> other_attributes(hid_t file);

// The authors' `.mat` version 7.3: `t` and `frames`, kelvin.
bool looks_like_matlab_capture(hid_t file);
Result<Contents> read_matlab_capture(hid_t file);

// Rules that both formats share. Thread: any.
Status check_times(const std::vector<double>& t);
double median_step(const std::vector<double>& t);  // s; 0 for a single time

// Plausibility of the frame period: adds one line a doubt to `warnings`.
void check_plausible(Contents& contents);

// The rules for the attributes in StreamFormat (scale, offset, frame_period_s, row_step) that reader and writer share;
// messages name the root attribute. Thread: any.
Status check_format_values(const StreamFormat& format);

}  // namespace bolo::capture
