// Contents of a capture file, read from either format, and its items by themselves.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/capture/frame_store.hpp"

namespace bolo::capture {

inline constexpr const char* kNoFrameStored =
    "the recording was cut off before its first frame was stored; nothing can be saved: remove it";

struct Contents {
  CaptureInfo info;
  FileFormat file_format = FileFormat::kBoloCapture;
  std::vector<double> t;
  std::vector<std::uint64_t> frame_id;
  std::vector<double> t_host;  // both empty, or one for each frame
  std::vector<double> t_utc;
  std::vector<Event> events;
  Result<Stimulus> stimulus = Stimulus{};  // an error is for callers that need it: frames are good without
  std::vector<std::string> warnings;
  std::optional<FrameStore> frames;  // always there after open
  std::optional<FrameStore> truth;
  std::optional<FrameStore> motion;
};

// "bolo-capture" version 1. Unless it is trusted whole its datasets may differ in length; the frames that all of them
// have are taken. Errors (kBadInput) name the item. Thread: any one at a time.
Result<Contents> read_bolo_capture(hid_t file, Trust trust);

// Root attributes beyond the format's own, which are for people: what cannot be read as number or string is left out,
// and what is beyond the first thousand, for HDF5 takes a time to write them that grows by the square.
inline constexpr std::size_t kMostOtherAttributes = 1000;
std::vector<Attribute> other_attributes(hid_t file);

// Rules that both formats, and those who make captures of other files, share. Thread: any.
inline constexpr double kLastTime_s = 9e9;  // on any clock: what keeps times within nanoseconds
Status check_times(const std::vector<double>& t);
double median_step(const std::vector<double>& t);  // s; 0 for a single time

// Plausibility of the frame period: adds one line a doubt to `warnings`.
void check_plausible(Contents& contents);

// /events: compound (t float64, kind string). Reading: empty when it is absent; `kind` may be of fixed or variable
// length; errors (kBadInput) name the item. Appending creates it when it is absent; false on failure. Thread: any one
// at a time.
inline constexpr std::size_t kLongestEventKind = 63;  // bytes; stored in 64 with the closing zero
Result<std::vector<Event>> read_events(hid_t file);
bool append_events(hid_t file, const std::vector<Event>& events);

// /stimulus. Reading: NoStimulus when the group is absent; errors (kBadInput) name the field. Writing: only what passed
// check_stimulus(); errors: kFailed with the library's cause. Thread: any one at a time.
Result<Stimulus> read_stimulus(hid_t file);
Status write_stimulus(hid_t file, const Stimulus& stimulus);
// The rules that read_stimulus() holds a file to; writers refuse the same. Thread: any.
Status check_stimulus(const Stimulus& stimulus);

// A 2-dimensional dataset of numbers as float32. Errors (kBadInput) name it. Thread: any one at a time.
Result<StillImage> read_image(hid_t file, const std::string& path);

// The rules for the attributes in StreamFormat (scale, offset, frame_period_s, row_step) that reader and writer share;
// messages name the root attribute. Thread: any.
Status check_format_values(const StreamFormat& format);

}  // namespace bolo::capture
