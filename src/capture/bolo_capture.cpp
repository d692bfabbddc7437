// Reads "bolo-capture" version 1, item by item, in the order of the table in docs/formats.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "src/capture/contents.hpp"
#include "src/core/statistics.hpp"

namespace bolo::capture {
namespace {

using h5::text;

constexpr double kVersion = 1.0;
constexpr double kMostRowStep = 65536.0;
const std::string kFormatName = "bolo-capture";
// Frames that may be missing at the end: more than a writer leaves uncommitted; more than an hour's.
constexpr std::size_t kMostUncommitted = 4096;
constexpr std::size_t kMostDamaged = std::size_t{1} << 20;

constexpr double kPeriodTolerance = 0.2;
constexpr double kLongestPeriod_s = 1.0;  // no thermal camera streams slower than a frame a second
// Bounds that keep counts of periods finite.
constexpr double kLeastPeriod_s = 1e-6;
constexpr double kMostPeriod_s = 1e6;
constexpr double kMostScale = 1e9;

std::string value_at(std::size_t index, double value) {
  return "/t: value " + std::to_string(index) + " (" + text(value) + ")";
}

Status check_identity(const h5::Owner& root) {
  const Result<std::string> format = h5::string_attribute(root, "format");
  if (!format) {
    return bad_input(format.error().message + "; expected '" + kFormatName + "' (this is another kind of HDF5 file)");
  }
  if (*format != kFormatName) {
    return bad_input("root attribute 'format' is '" + *format + "'; expected '" + kFormatName + "'");
  }
  const Result<double> version = h5::number_attribute(root, "version");
  if (!version) return bad_input(version.error().message + "; expected 1");
  if (*version != kVersion) {
    return bad_input("root attribute 'version' is " + text(*version) + "; this program reads version 1");
  }
  return {};
}

Result<double> number_or(const h5::Owner& root, const char* name, double otherwise) {
  return h5::has_attribute(root, name) ? h5::number_attribute(root, name) : Result<double>(otherwise);
}

Result<std::string> string_or_empty(const h5::Owner& root, const char* name) {
  return h5::has_attribute(root, name) ? h5::string_attribute(root, name) : Result<std::string>("");
}

// Serial numbers are often stored as numbers.
Result<std::string> serial_or_empty(const h5::Owner& root, const char* name) {
  const Result<double> number = h5::number_attribute(root, name);
  if (!number) return string_or_empty(root, name);
  const bool whole = *number == std::floor(*number) && std::abs(*number) < 0x1p53;
  return whole ? std::to_string(static_cast<std::int64_t>(*number)) : text(*number);
}

// Counts have no scale, so a file of counts need not state one.
Result<LinearScale> read_scale(const h5::Owner& root) {
  const Result<std::string> unit = h5::string_attribute(root, "unit");
  if (!unit) return bad_input(unit.error().message + "; expected 'kelvin' or 'count'");
  if (*unit != "kelvin" && *unit != "count") {
    return bad_input("root attribute 'unit' is '" + *unit + "'; expected 'kelvin' or 'count'");
  }
  const bool kelvin = *unit == "kelvin";
  const Result<double> scale = kelvin ? h5::number_attribute(root, "scale") : number_or(root, "scale", 1.0);
  const Result<double> offset = kelvin ? h5::number_attribute(root, "offset") : number_or(root, "offset", 0.0);
  const char* meaning = "; expected kelvin = scale * value + offset";
  if (!scale) return bad_input(scale.error().message + meaning);
  if (!offset) return bad_input(offset.error().message + meaning);
  return LinearScale{kelvin ? Unit::kKelvin : Unit::kCount, *scale, *offset};
}

Status read_attributes(const h5::Owner& root, CaptureInfo& info) {
  ASSIGN_OR_RETURN(info.format.scale, read_scale(root));
  ASSIGN_OR_RETURN(info.format.frame_period_s, h5::number_attribute(root, "frame_period_s"));
  ASSIGN_OR_RETURN(const double row_step, number_or(root, "row_step", 1.0));
  if (row_step < 1.0 || row_step > kMostRowStep || row_step != std::floor(row_step)) {
    return bad_input("root attribute 'row_step' is " + text(row_step) + "; expected a whole number of at least 1");
  }
  ASSIGN_OR_RETURN(info.camera_model, string_or_empty(root, "camera_model"));
  ASSIGN_OR_RETURN(info.camera_serial, serial_or_empty(root, "camera_serial"));
  info.format.row_step = static_cast<int>(row_step);
  return {};
}

h5::Expect expect_of(Trust trust) { return trust == Trust::kWhole ? h5::Expect::kWhole : h5::Expect::kPart; }

// `values` per pixel, if they have an axis of their own; 0: a plain picture.
Result<FrameStore> open_frames(hid_t file, const std::string& path, Trust trust, hsize_t values = 0) {
  Result<FrameStore> frames =
      FrameStore::open(file, path, FrameOrder::kFrameMajor, expect_of(trust), FrameStore::kBlockBytes, values);
  if (!frames || trust == Trust::kWhole) return frames;
  RETURN_IF_ERROR(frames->drop_missing_end(trust == Trust::kDamaged ? kMostDamaged : kMostUncommitted));
  return frames;
}

Status read_frames(hid_t file, Trust trust, Contents& contents) {
  ASSIGN_OR_RETURN(FrameStore frames, open_frames(file, "/frames", trust));
  if (frames.stored_type() != "uint16" && frames.stored_type() != "float32") {
    return bad_input("/frames is of type " + frames.stored_type() + "; expected uint16 or float32");
  }
  contents.info.format.geometry = frames.geometry();
  contents.info.format.type = frames.type();
  contents.info.frames = frames.frames();
  contents.frames = std::move(frames);
  return {};
}

// Optional float32 planes; those of a damaged file may be unreadable.
Status open_optional(hid_t file, const char* group, const char* path, Trust trust, hsize_t values,
                     std::vector<std::string>& warnings, std::optional<FrameStore>& store) {
  if (!h5::exists(file, group)) return {};
  Result<FrameStore> planes = open_frames(file, path, trust, values);
  if (!planes && trust == Trust::kDamaged) {
    warnings.push_back(planes.error().message + "; it is left out");
    return {};
  }
  ASSIGN_OR_RETURN(store, std::move(planes));
  if (store->stored_type() == "float32") return {};
  return bad_input(std::string(path) + " is of type " + store->stored_type() + "; expected float32");
}

Status read_truth(hid_t file, Trust trust, Contents& contents) {
  Status good = open_optional(file, "/truth", "/truth/frames", trust, 0, contents.warnings, contents.truth);
  contents.info.has_truth = contents.truth.has_value();
  const Geometry expected = contents.info.format.geometry;
  if (!good || !contents.truth || contents.truth->geometry() == expected) return good;
  const Geometry found = contents.truth->geometry();
  return bad_input("/truth/frames has frames of " + std::to_string(found.width) + "x" + std::to_string(found.height) +
                   " but /frames of " + std::to_string(expected.width) + "x" + std::to_string(expected.height));
}

Status read_motion(hid_t file, Trust trust, Contents& contents) {
  Status good = open_optional(file, "/motion", "/motion", trust, kMotionValues, contents.warnings, contents.motion);
  contents.info.has_motion = contents.motion.has_value();
  const Geometry blocks = motion_blocks(contents.info.format.geometry);
  const Geometry expected{blocks.width * static_cast<int>(kMotionValues), blocks.height};
  if (!good || !contents.motion || contents.motion->geometry() == expected) return good;
  return bad_input("/motion has not the " + std::to_string(blocks.height) + "x" + std::to_string(blocks.width) +
                   " blocks of 8x8 pixels (down x across) that cover /frames");
}

Status read_series(hid_t file, Trust trust, Contents& contents) {
  ASSIGN_OR_RETURN(contents.t, h5::read_doubles(file, "/t", expect_of(trust)));
  ASSIGN_OR_RETURN(contents.frame_id, h5::read_counts(file, "/frame_id", expect_of(trust)));
  return {};
}

// /t_host and /t_utc are useful only together.
Status read_other_times(hid_t file, Trust trust, Contents& contents) {
  const bool has_host = h5::exists(file, "/t_host");
  const bool has_utc = h5::exists(file, "/t_utc");
  contents.info.has_times = has_host && has_utc;
  if (has_host != has_utc) {
    contents.warnings.push_back(has_host ? "/t_host is left out: /t_utc is missing beside it"
                                         : "/t_utc is left out: /t_host is missing beside it");
  }
  if (!contents.info.has_times) return {};
  for (const auto& [path, values] : {std::pair{"/t_host", &contents.t_host}, {"/t_utc", &contents.t_utc}}) {
    Result<std::vector<double>> read = h5::read_doubles(file, path, expect_of(trust));
    if (!read && trust == Trust::kDamaged) {
      contents.warnings.push_back(read.error().message + "; /t_host and /t_utc are left out");
      contents.info.has_times = false;
      return {};
    }
    ASSIGN_OR_RETURN(*values, std::move(read));
  }
  return {};
}

// Neither must rise: the host may have been rebooted, or its clock been set.
Status check_other_times(Contents& contents) {
  if (!contents.info.has_times) {
    contents.t_host.clear();
    contents.t_utc.clear();
    return {};
  }
  for (const auto& [path, values] : {std::pair{"/t_host", &contents.t_host}, {"/t_utc", &contents.t_utc}}) {
    if (std::all_of(values->begin(), values->end(), [](double t) { return std::abs(t) <= kLastTime_s; })) continue;
    return bad_input(std::string(path) + " has a time that is not a number of seconds up to " + text(kLastTime_s));
  }
  return {};
}

Status check_length(const char* path, std::size_t length, std::size_t frames) {
  if (length == frames) return {};
  return bad_input(std::string(path) + " has " + std::to_string(length) + " values but /frames has " +
                   std::to_string(frames) + " frames");
}

Status check_lengths(const Contents& contents) {
  const std::size_t frames = contents.info.frames;
  Status good = check_length("/t", contents.t.size(), frames);
  if (good) good = check_length("/frame_id", contents.frame_id.size(), frames);
  if (good && contents.info.has_times) good = check_length("/t_host", contents.t_host.size(), frames);
  if (good && contents.info.has_times) good = check_length("/t_utc", contents.t_utc.size(), frames);
  if (good && contents.truth) good = check_length("/truth/frames", contents.truth->frames(), frames);
  if (good && contents.motion) good = check_length("/motion", contents.motion->frames(), frames);
  return good;
}

// For a recording that was killed while its lengths were being written: frames that all datasets have are complete.
Status cut_to_shortest(Contents& contents) {
  std::size_t frames = std::min({contents.info.frames, contents.t.size(), contents.frame_id.size()});
  if (contents.info.has_times) frames = std::min({frames, contents.t_host.size(), contents.t_utc.size()});
  if (contents.truth) frames = std::min(frames, contents.truth->frames());
  if (contents.motion) frames = std::min(frames, contents.motion->frames());
  if (frames == 0) return bad_input(kNoFrameStored);
  if (const std::size_t most = std::max(contents.info.frames, contents.t.size()); most > frames) {
    contents.warnings.push_back("the recording was cut off: the last " + std::to_string(most - frames) +
                                " frames are incomplete and left out");
  }
  contents.info.frames = frames;
  contents.t.resize(frames);
  contents.frame_id.resize(frames);
  if (contents.info.has_times) {
    contents.t_host.resize(frames);
    contents.t_utc.resize(frames);
  }
  return {};
}

// For a damaged file: up to the first time or number that does not rise.
void cut_to_rising(Contents& contents) {
  std::size_t frames = 0;
  const auto rises = [&](std::size_t i) {
    if (!std::isfinite(contents.t[i])) return false;
    return i == 0 || (contents.t[i] > contents.t[i - 1] && contents.frame_id[i] > contents.frame_id[i - 1]);
  };
  while (frames < contents.t.size() && rises(frames)) ++frames;
  contents.t.resize(frames);
}

Status check_ids(const std::vector<std::uint64_t>& id) {
  for (std::size_t i = 1; i < id.size(); ++i) {
    if (id[i] <= id[i - 1]) {
      return bad_input("/frame_id: value " + std::to_string(i) + " (" + std::to_string(id[i]) +
                       ") is not above the one before (" + std::to_string(id[i - 1]) + "); frame numbers must rise");
    }
  }
  return {};
}

Status read_extras(hid_t file, Trust trust, Contents& contents) {
  Result<std::vector<Event>> events = read_events(file);
  if (!events && trust != Trust::kWhole) {
    contents.warnings.push_back("the recording was cut off: " + events.error().message + "; they are left out");
    events = std::vector<Event>{};
  }
  ASSIGN_OR_RETURN(contents.events, std::move(events));
  contents.stimulus = read_stimulus(file);
  if (!contents.stimulus) contents.warnings.push_back(contents.stimulus.error().message + "; it is left out");
  return {};
}

herr_t collect_name(hid_t, const char* name, const H5A_info_t*, void* names) {
  static_cast<std::vector<std::string>*>(names)->emplace_back(name);
  return 0;
}

}  // namespace

bool is_own_attribute(std::string_view name) {
  constexpr std::array<std::string_view, 9> kOwn{"format",         "version",      "unit",          "scale",   "offset",
                                                 "frame_period_s", "camera_model", "camera_serial", "row_step"};
  return std::find(kOwn.begin(), kOwn.end(), name) != kOwn.end();
}

std::vector<Attribute> other_attributes(hid_t file) {
  const h5::Handle group(H5Gopen2(file, "/", H5P_DEFAULT));
  const h5::Owner root{group.get(), "root"};
  std::vector<std::string> names;
  H5Aiterate2(root.id, H5_INDEX_NAME, H5_ITER_INC, nullptr, collect_name, &names);
  std::vector<Attribute> out;
  for (const std::string& name : names) {
    if (is_own_attribute(name)) continue;
    if (out.size() == kMostOtherAttributes) break;
    if (Result<double> number = h5::number_attribute(root, name)) {
      out.push_back({name, *number});
    } else if (Result<std::string> string = h5::string_attribute(root, name)) {
      out.push_back({name, std::move(*string)});
    }
  }
  return out;
}

Result<Contents> read_bolo_capture(hid_t file, Trust trust) {
  const h5::Handle group(H5Gopen2(file, "/", H5P_DEFAULT));
  const h5::Owner root{group.get(), "root"};
  Contents contents;
  RETURN_IF_ERROR(check_identity(root));
  RETURN_IF_ERROR(read_attributes(root, contents.info));
  RETURN_IF_ERROR(check_format_values(contents.info.format));
  RETURN_IF_ERROR(read_frames(file, trust, contents));
  RETURN_IF_ERROR(read_series(file, trust, contents));
  RETURN_IF_ERROR(read_other_times(file, trust, contents));
  RETURN_IF_ERROR(read_truth(file, trust, contents));
  RETURN_IF_ERROR(read_motion(file, trust, contents));
  if (trust == Trust::kDamaged) {
    contents.t.resize(std::min(contents.t.size(), contents.frame_id.size()));
    cut_to_rising(contents);
  }
  RETURN_IF_ERROR(trust == Trust::kWhole ? check_lengths(contents) : cut_to_shortest(contents));
  RETURN_IF_ERROR(check_times(contents.t));
  RETURN_IF_ERROR(check_ids(contents.frame_id));
  RETURN_IF_ERROR(check_other_times(contents));
  RETURN_IF_ERROR(read_extras(file, trust, contents));
  check_plausible(contents);
  return contents;
}

Status check_times(const std::vector<double>& t) {
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (!std::isfinite(t[i])) return bad_input(value_at(i, t[i]) + " is not a finite number of seconds");
    if (std::abs(t[i]) > kLastTime_s) {
      return bad_input(value_at(i, t[i]) + " is beyond " + text(kLastTime_s) + " s; expected seconds");
    }
    if (i > 0 && t[i] <= t[i - 1]) {
      return bad_input(value_at(i, t[i]) + " is not above the one before (" + text(t[i - 1]) +
                       "); the frames' times must rise");
    }
  }
  const double step_s = median_step(t);
  if (t.size() < 2 || (step_s >= kLeastPeriod_s && step_s <= kMostPeriod_s)) return {};
  return bad_input("/t rises by " + text(step_s) + " s a frame (median); expected " + text(kLeastPeriod_s) + " to " +
                   text(kMostPeriod_s) + " s");
}

double median_step(const std::vector<double>& t) {
  if (t.size() < 2) return 0.0;
  std::vector<double> step(t.size() - 1);
  for (std::size_t i = 0; i + 1 < t.size(); ++i) step[i] = t[i + 1] - t[i];
  return median(std::move(step));
}

void check_plausible(Contents& contents) {
  const double period_s = contents.info.format.frame_period_s;
  const double median_s = median_step(contents.t);
  if (median_s > kLongestPeriod_s) {
    contents.warnings.push_back("/t rises by " + text(median_s) +
                                " a frame: it looks like milliseconds, not seconds (" + text(median_s) + " ms is " +
                                text(std::round(1e5 / median_s) / 100.0) +
                                " frames a second); divide /t and frame_period_s by 1000");
  } else if (period_s > kLongestPeriod_s) {
    contents.warnings.push_back("frame_period_s is " + text(period_s) + ": it looks like milliseconds, not seconds");
  }
  if (median_s > 0.0 && std::abs(period_s - median_s) > kPeriodTolerance * median_s) {
    contents.warnings.push_back("frame_period_s is " + text(period_s) + " s but /t rises by " + text(median_s) +
                                " s a frame (median); correct the one that is wrong");
  }
}

Status check_format_values(const StreamFormat& format) {
  if (!(format.frame_period_s >= kLeastPeriod_s && format.frame_period_s <= kMostPeriod_s)) {
    return bad_input("root attribute 'frame_period_s' is " + text(format.frame_period_s) + "; expected " +
                     text(kLeastPeriod_s) + " to " + text(kMostPeriod_s) + " s");
  }
  const double scale = std::abs(format.scale.scale);
  if (!(scale >= 1.0 / kMostScale && scale <= kMostScale)) {
    return bad_input("root attribute 'scale' is " + text(format.scale.scale) +
                     "; expected a number other than 0 (kelvin = scale * value + offset), up to " + text(kMostScale));
  }
  if (!(std::abs(format.scale.offset) <= kMostScale)) {
    return bad_input("root attribute 'offset' is " + text(format.scale.offset) + "; expected up to " +
                     text(kMostScale));
  }
  if (format.row_step < 1) {
    return bad_input("root attribute 'row_step' is " + std::to_string(format.row_step) +
                     "; expected a whole number of at least 1");
  }
  return {};
}

}  // namespace bolo::capture
