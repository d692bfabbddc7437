// Captures: HDF5 files of raw frames ("bolo-capture" version 1; table in docs/formats.md), and the authors' `.mat`
// version 7.3 files, read through the same interface.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/core/scene_motion.hpp"

namespace bolo::capture {

struct Event {
  double t_s = 0.0;  // on the clock of /t
  std::string kind;  // "nuc", "gap", "reconnect" ...
};

// A frame's time on clocks other than the camera's.
struct FrameTimes {
  double host_s = 0.0;         // CLOCK_MONOTONIC of the host that recorded it
  double utc_s = 0.0;          // UTC, since 1970
  double uncertainty_s = 0.0;  // bound of the error of utc_s; attribute utc_uncertainty_s has the largest; 0: unknown
};

struct Point {
  int x = 0;
  int y = 0;
  bool operator==(const Point&) const = default;
};

// The scene before the camera: the `/stimulus` group. Times in s from `/t[0]`, temperatures in K, lengths in stored
// pixels.
struct NoStimulus {  // a field recording
  bool operator==(const NoStimulus&) const = default;
};

// Accuracy of a bench's temperatures if it states none: standard deviation, K.
inline constexpr double kLevelAccuracyK = 0.5;

struct Uniform {  // closed shutter or flat black body
  double temperature_k = 0.0;
  double level_accuracy_k = kLevelAccuracyK;
  bool operator==(const Uniform&) const = default;
};

struct Chopper {  // the whole field is at level_k[i] from on_s[i] to off_s[i], at cold_k otherwise
  double cold_k = 0.0;
  std::vector<double> on_s;
  std::vector<double> off_s;
  std::vector<double> level_k;
  double level_accuracy_k = kLevelAccuracyK;
  bool operator==(const Chopper&) const = default;
};

struct BarTarget {  // hot bars on cold, moving along +x; velocity 0 is a static target
  double cold_k = 0.0;
  double hot_k = 0.0;
  double period_px = 0.0;
  double bar_width_px = 0.0;
  double slant_px_per_row = 0.0;
  double velocity_px_s = 0.0;
  double level_accuracy_k = kLevelAccuracyK;
  bool operator==(const BarTarget&) const = default;
};

struct SceneStimulus {  // a still panned along a trajectory: the frame's pixel (0, 0) looks at image (x_px, y_px)
  int image_width = 0;
  int image_height = 0;
  std::vector<float> image_k;  // row-major
  std::vector<double> t_s;
  std::vector<double> x_px;
  std::vector<double> y_px;
  bool operator==(const SceneStimulus&) const = default;
};

using Stimulus = std::variant<NoStimulus, Uniform, Chopper, BarTarget, SceneStimulus>;

struct CaptureInfo {
  StreamFormat format;
  std::string camera_model;
  std::string camera_serial;
  std::size_t frames = 0;
  bool has_truth = false;
  bool has_motion = false;
  bool has_times = false;  // /t_host and /t_utc
};

enum class FileFormat {
  kBoloCapture,
  kMatlab,  // the authors' `.mat`: frame_id comes from the times, frame_period_s from their median
};

// Trust in the lengths that a file states.
enum class Trust {
  kWhole,       // all of it must be present
  kUnfinished,  // a ".part": a writer's last commit; lengths may differ by what was left open
  kDamaged,     // anything may be missing
};

// A root attribute beyond the format's own.
struct Attribute {
  std::string name;
  std::variant<double, std::string> value;
};
bool is_own_attribute(std::string_view name);  // one of the format's

// Reads one capture. Every item is checked on open; errors name the file, the item and what is expected there.
// Thread: any one at a time (the HDF5 library is serialised).
class CaptureReader {
 public:
  static Result<CaptureReader> open(const std::filesystem::path& file);
  // Reads the sound part of a damaged file: frames from the first one up to where times, numbers and pixels are all
  // present. Single frames in between may still fail to be read.
  static Result<CaptureReader> salvage(const std::filesystem::path& file);
  CaptureReader(CaptureReader&&) noexcept;
  CaptureReader& operator=(CaptureReader&&) noexcept;
  ~CaptureReader();

  const CaptureInfo& info() const noexcept;
  const std::vector<double>& t() const noexcept;                // s, strictly rising
  const std::vector<std::uint64_t>& frame_id() const noexcept;  // strictly rising
  const std::vector<double>& t_host() const noexcept;           // s, CLOCK_MONOTONIC of the recording host, and
  const std::vector<double>& t_utc() const noexcept;            // s since 1970; both empty unless has_times
  const std::vector<Event>& events() const noexcept;
  // Root attributes beyond the format's own, by name; only numbers and strings.
  Result<std::vector<Attribute>> attributes() const;
  // Odd but readable, one line each: a frame period that contradicts the times, a recording that was cut off.
  const std::vector<std::string>& warnings() const noexcept;
  FileFormat file_format() const noexcept;
  // Errors (kBadInput): what is wrong with /stimulus; warnings() has it too.
  Result<Stimulus> stimulus() const;
  // /points: places of a single-point capture's pixels in the camera's frame; empty for a picture.
  Result<std::vector<Point>> points() const;

  // One frame, row-major, in the stored type: `out` has plane_bytes(info().format.geometry, info().format.type) bytes.
  Status read_frame(std::size_t index, void* out) const;
  // One frame of /truth/frames, K; info().has_truth. `out` has geometry.pixels() values.
  Status read_truth(std::size_t index, float* out) const;
  // One frame of /motion; info().has_motion. `out` has motion_blocks(info().format.geometry).pixels() values.
  Status read_motion(std::size_t index, BlockMotion* out) const;

 private:
  struct Impl;
  static Result<CaptureReader> open_as(const std::filesystem::path& file, Trust trust);
  explicit CaptureReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Nothing if the capture has no such times. Thread: any.
inline std::optional<FrameTimes> times_of(const CaptureReader& reader, std::size_t index) {
  if (!reader.info().has_times) return std::nullopt;
  return FrameTimes{reader.t_host()[index], reader.t_utc()[index]};
}

struct WriterOptions {
  bool truth = false;     // a /truth/frames plane comes with every frame
  int deflate_level = 0;  // 0: no compression; 1..9 gzip with byte shuffle
  // Commits also go to the disk, on a thread of their own: a power cut leaves one of them, a kill always the last.
  bool survives_power_cut = false;
  Replace replace = Replace::kNothing;  // a file of the final name, and a ".part" that was left there
  bool motion = false;                  // /motion is written: the scene's motion in every frame, where known
  bool times = false;                   // /t_host and /t_utc come with every frame
};

// Writes a capture frame by frame, and commits every half second of frames. Frames appended before a failure stay
// readable; a killed process leaves the last commit. The file is written under its final name plus ".part", with its
// commits beside it (".part.journal", ".part.live"), and renamed by close(). Without a frame no file remains.
// Thread: any one at a time.
class CaptureWriter {
 public:
  static Result<CaptureWriter> create(const std::filesystem::path& file, const CaptureInfo& info,
                                      const WriterOptions& options = {});
  CaptureWriter(CaptureWriter&&) noexcept;
  CaptureWriter& operator=(CaptureWriter&&) noexcept;
  ~CaptureWriter();

  // `plane` in info.format.type; `truth` (K) exactly when options.truth; `motion`, motion_blocks() of the frame, only
  // when options.motion: null means unknown, written as 0; `times` exactly when options.times. t_s and frame_id rise.
  Status append(double t_s, std::uint64_t frame_id, const void* plane, const float* truth = nullptr,
                const BlockMotion* motion = nullptr, const FrameTimes* times = nullptr);
  Status write_stimulus(const Stimulus& stimulus);
  Status add_event(const Event& event);
  // Writes /points/x and /points/y, int32: one for each pixel of the frames, which are one row. Once.
  Status write_points(const std::vector<Point>& points);
  // Writes a root attribute beyond the format's own, such as settings of a deblurring run.
  Status write_attribute(const std::string& name, const std::variant<double, std::string>& value);
  Status write_attributes(const std::vector<Attribute>& attributes);
  // Replaces the info's frame period, s, by one found from the frames.
  Status state_period(double period_s);

  // Commits the frames appended since the last commit: for sources that pause.
  Status commit();

  // Ends appending; from here on a killed process leaves the complete capture as a ".part". Does not wait for the disk.
  Status complete();
  // Completes, waits for the disk, renames. Without it the destructor leaves the ".part" file, readable. Thread: any
  // once it is complete, beside other captures; otherwise any one at a time.
  Status close();
  // Closes and removes the file.
  void discard();

 private:
  struct Impl;
  explicit CaptureWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// A single still: dataset `image_k` (H, W) float32, kelvin, as in scene files.
struct StillImage {
  int width = 0;
  int height = 0;
  std::vector<float> kelvin;  // row-major
};
Result<StillImage> read_still(const std::filesystem::path& file);

// --- Recovery of interrupted recordings and damaged files.

struct Recovered {
  std::uint64_t frames = 0;      // saved
  std::uint64_t unreadable = 0;  // between saved ones
  double first_t_s = 0.0;
  double last_t_s = 0.0;
  std::vector<std::string> remarks;  // what is missing, one line each
};

// Copies the readable part of `damaged` (a ".part", or a capture that is cut off or damaged) to the new capture `out`;
// `damaged` stays as it is. `progress` is called with the frames done and their total, and ends the copy by returning
// false. Errors: nothing can be saved (kBadInput), `out` cannot be written. Thread: any one at a time.
Result<Recovered> recover_copy(const std::filesystem::path& damaged, const OutputFile& out,
                               const std::function<bool(std::uint64_t, std::uint64_t)>& progress);

// Finishes a ".part" in place and names it `out`, without a copy: completes its last commit in the file. Errors: it is
// damaged nevertheless (kBadInput; recover_copy() saves the rest). Thread: any one at a time.
Result<Recovered> recover_in_place(const std::filesystem::path& part, const OutputFile& out);

}  // namespace bolo::capture
