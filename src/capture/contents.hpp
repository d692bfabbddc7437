// Contents of a capture file in either format, and its items.
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
  Result<Stimulus> stimulus = Stimulus{};  // an error concerns only callers that need it: frames are good without
  std::vector<std::string> warnings;
  std::optional<FrameStore> frames;  // always set after open
  std::optional<FrameStore> truth;
  std::optional<FrameStore> motion;
};

// "bolo-capture" version 1. Unless trusted as whole, its datasets may differ in length; the frames that all of them
// have are used. Errors (kBadInput) name the item. Thread: any one at a time.
Result<Contents> read_bolo_capture(hid_t file, Trust trust);

// Root attributes beyond the format's own, for people: only numbers and strings that can be read, and only the first
// thousand, because HDF5's time to write them grows quadratically.
inline constexpr std::size_t kMostOtherAttributes = 1000;
std::vector<Attribute> other_attributes(hid_t file);

// Rules shared by both formats and by programs that convert other files to captures. Thread: any.
inline constexpr double kLastTime_s = 9e9;  // on any clock: keeps times within 64-bit nanoseconds
Status check_times(const std::vector<double>& t);
double median_step(const std::vector<double>& t);  // s; 0 for a single time

// Plausibility of the frame period: adds one line per doubt to `warnings`.
void check_plausible(Contents& contents);

// /events: compound (t float64, kind string). Reading: empty if absent; `kind` may be of fixed or variable length;
// errors (kBadInput) name the item. Appending creates it if absent; false on failure. Thread: any one at a time.
inline constexpr std::size_t kLongestEventKind = 63;  // bytes; stored in 64 with the terminating zero
Result<std::vector<Event>> read_events(hid_t file);
bool append_events(hid_t file, const std::vector<Event>& events);

// /stimulus. Reading: NoStimulus if the group is absent; errors (kBadInput) name the field. Writing: only after
// check_stimulus(); errors: kFailed with the library's cause. Thread: any one at a time.
Result<Stimulus> read_stimulus(hid_t file);
Status write_stimulus(hid_t file, const Stimulus& stimulus);
// The rules of read_stimulus(), also for writers. Thread: any.
Status check_stimulus(const Stimulus& stimulus);

// A 2-dimensional dataset of numbers as float32. Errors (kBadInput) name it. Thread: any one at a time.
Result<StillImage> read_image(hid_t file, const std::string& path);

// Rules for the attributes in StreamFormat (scale, offset, frame_period_s, row_step), shared by reader and writer;
// messages name the root attribute. Thread: any.
Status check_format_values(const StreamFormat& format);

}  // namespace bolo::capture
