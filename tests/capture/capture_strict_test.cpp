// One corruption per row: open() refuses the file in one line that names the file, the item and what is expected.
#include "src/capture/h5.hpp"
#include "tests/capture/hdf5_edit.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/refusal.hpp"

namespace bolo::capture::capture_strict_test {

using CaptureStrictFile = ScratchTest;

using namespace bolo::capture::testing;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Corruption {
  const char* name;
  Change change;
  std::vector<std::string> named;  // substrings of the message
};

// Three frames of 7x3, uint16, with truth.
std::filesystem::path valid_file(const Scratch& scratch) {
  const auto file = scratch / "a.h5";
  write_small(file, 3, {.truth = true});
  return file;
}

Change of_kind(const char* kind) {
  return [kind](hid_t f) {
    add_group(f, "/stimulus");
    set_string(f, "/stimulus", "kind", kind);
  };
}

void chopper(hid_t f) {
  of_kind("chopper")(f);
  set_number(f, "/stimulus", "cold_k", 293.0);
  set_doubles(f, "/stimulus/on_s", {0.1, 0.3});
  set_doubles(f, "/stimulus/off_s", {0.2, 0.4});
  set_doubles(f, "/stimulus/level_k", {303.0, 308.0});
}

void bars(hid_t f) {
  of_kind("bar_target")(f);
  for (const char* name : {"cold_k", "hot_k", "period_px", "bar_width_px", "slant_px_per_row", "velocity_px_s"}) {
    set_number(f, "/stimulus", name, 20.0);
  }
}

void scene(hid_t f) {
  of_kind("scene")(f);
  with_dataset("/stimulus/image_k", H5T_NATIVE_FLOAT, {4, 6})(f);
  set_doubles(f, "/stimulus/t_s", {0.0, 0.1});
  set_doubles(f, "/stimulus/x_px", {0.0, 1.0});
  set_doubles(f, "/stimulus/y_px", {0.0, 1.0});
}

Change both(Change first, Change second) {
  return [=](hid_t f) {
    first(f);
    second(f);
  };
}
auto without_field(const char* name) {
  return [name](hid_t f) { drop_attribute(f, "/stimulus", name); };
}
auto with_field(const char* name, double value) {
  return [=](hid_t f) { set_number(f, "/stimulus", name, value); };
}

void two_values(hid_t f) {
  const std::vector<double> values{0.005, 0.005};
  set_attribute(f, "/", "frame_period_s", H5T_NATIVE_DOUBLE, H5T_NATIVE_DOUBLE, values.data(), {2});
}

// A shape of 2^40 frames without data.
void forged_frames(hid_t f) {
  set_dataset(f, "/frames", H5T_NATIVE_UINT16, {hsize_t{1} << 40, 3, 7}, H5T_NATIVE_UINT16, nullptr, {1, 3, 7});
}
void forged_times(hid_t f) {
  set_dataset(f, "/t", H5T_NATIVE_DOUBLE, {hsize_t{1} << 50}, H5T_NATIVE_DOUBLE, nullptr, {1024}, 1);
}

// A dataset of `rows` rows without data: no block on disk is allocated.
void room(hid_t f, const char* path, hid_t type, hsize_t rows) {
  if (H5Lexists(f, path, H5P_DEFAULT) > 0) drop(f, path);
  const h5::Handle space(H5Screate_simple(1, &rows, nullptr));
  const h5::Handle properties(H5Pcreate(H5P_DATASET_CREATE));
  H5Pset_alloc_time(properties.get(), H5D_ALLOC_TIME_EARLY);
  H5Pset_fill_time(properties.get(), H5D_FILL_TIME_NEVER);
  const h5::Handle id(H5Dcreate2(f, path, type, space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT));
  EXPECT_TRUE(id);
}
void times_without_end(hid_t f) { room(f, "/t", H5T_NATIVE_DOUBLE, hsize_t{1} << 28); }
void events_without_end(hid_t f) {
  const h5::Handle type(event_type(8, 16));
  room(f, "/events", type.get(), hsize_t{1} << 25);
}

// Recreates /frames (3, 3, 7) with the properties set by `set`.
template <typename Set>
h5::Handle frames_with(hid_t f, Set set) {
  drop(f, "/frames");
  const std::vector<hsize_t> dims{3, 3, 7};
  const h5::Handle space(H5Screate_simple(3, dims.data(), nullptr));
  const h5::Handle properties(H5Pcreate(H5P_DATASET_CREATE));
  EXPECT_GE(set(properties.get(), space.get()), 0);
  h5::Handle id(H5Dcreate2(f, "/frames", H5T_NATIVE_UINT16, space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT));
  EXPECT_TRUE(id);
  return id;
}

void frames_of_any_file(hid_t f) {
  frames_with(f, [](hid_t properties, hid_t) { return H5Pset_external(properties, "/proc/self/exe", 0, 126); });
}

// A virtual dataset that maps to itself.
void frames_of_themselves(hid_t f) {
  frames_with(f,
              [](hid_t properties, hid_t space) { return H5Pset_virtual(properties, space, ".", "/frames", space); });
}

void events_without_kind(hid_t f) {
  const hid_t type = H5Tcreate(H5T_COMPOUND, 8);
  H5Tinsert(type, "t", 0, H5T_NATIVE_DOUBLE);
  const double t = 0.0;
  set_dataset(f, "/events", type, {1}, type, &t);
  H5Tclose(type);
}

void events_at_nan(hid_t f) {
  struct Row {
    double t;
    char kind[8];
  };
  const std::vector<Row> rows{{0.0, "nuc"}, {kNan, "gap"}};
  set_events(f, 8, sizeof(Row), rows.size(), rows.data());
}

// One chunk of 256 MiB, compressed to 200,000 bytes.
void one_large_piece(hid_t f) {
  const std::vector<hsize_t> shape{hsize_t{1} << 20, 8, 16};
  const std::vector<hsize_t> first(3, 0);
  const std::vector<char> stored(200'000, 'x');
  set_dataset(f, "/frames", H5T_NATIVE_UINT16, shape, H5T_NATIVE_UINT16, nullptr, shape, 9);
  const hid_t id = H5Dopen2(f, "/frames", H5P_DEFAULT);
  EXPECT_GE(H5Dwrite_chunk(id, H5P_DEFAULT, 0, first.data(), stored.size(), stored.data()), 0);
  H5Dclose(id);
}

void events_with_long_kinds(hid_t f) {
  const std::vector<char> row(8 + 65'537, '\0');
  set_events(f, 65'537, row.size(), 1, row.data());
}

// A filter that is registered only while the file is written.
void unknown_filter(hid_t f) {
  const auto same = [](unsigned, std::size_t, const unsigned*, std::size_t bytes, std::size_t*, void**) {
    return bytes;
  };
  const H5Z_class2_t filter{H5Z_CLASS_T_VERS, 555, 1, 1, "nobody's", nullptr, nullptr, same};
  ASSERT_GE(H5Zregister(&filter), 0);
  const std::vector<std::uint16_t> values(63);
  {
    const h5::Handle frames = frames_with(f, [](hid_t properties, hid_t) {
      H5Pset_chunk(properties, 3, std::array<hsize_t, 3>{3, 3, 7}.data());
      return H5Pset_filter(properties, 555, 0, 0, nullptr);
    });
    H5Dwrite(frames.get(), H5T_NATIVE_UINT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  }
  ASSERT_GE(H5Zunregister(555), 0);
}

const std::vector<Corruption>& corruptions() {
  static const std::vector<Corruption> kAll{
      {"format_missing", without("format"), {"'format' is missing", "bolo-capture"}},
      {"format_other", with_text("format", "other"), {"'format' is 'other'", "bolo-capture"}},
      {"format_number", with("format", 1), {"'format'", "float64", "string"}},
      {"version_missing", without("version"), {"'version' is missing", "1"}},
      {"version_2", with("version", 2), {"'version' is 2", "version 1"}},
      {"unit_missing", without("unit"), {"'unit' is missing", "kelvin"}},
      {"unit_unknown", with_text("unit", "celsius"), {"'celsius'", "'kelvin' or 'count'"}},
      {"scale_missing", without("scale"), {"'scale' is missing"}},
      {"scale_0", with("scale", 0), {"'scale' is 0"}},
      {"scale_of_no_camera", with("scale", 1e308), {"'scale' is 1e+308", "up to 1e+09"}},
      {"scale_next_to_0", with("scale", -5e-324), {"'scale' is -4.9", "other than 0"}},
      {"offset_of_no_camera", with("offset", -1e308), {"'offset' is -1e+308", "up to 1e+09"}},
      {"scale_nan", with("scale", kNan), {"'scale'", "finite"}},
      {"scale_text", with_text("scale", "0.01"), {"'scale'", "string", "number"}},
      {"offset_missing", without("offset"), {"'offset' is missing"}},
      {"offset_infinite", with("offset", kInfinity), {"'offset'", "finite"}},
      {"period_missing", without("frame_period_s"), {"'frame_period_s' is missing"}},
      {"period_0", with("frame_period_s", 0), {"'frame_period_s' is 0", "1e-06 to 1000000"}},
      {"period_of_no_camera", with("frame_period_s", 5e-324), {"'frame_period_s' is 4.9", "1e-06 to 1000000"}},
      {"period_of_weeks", with("frame_period_s", 1e7), {"'frame_period_s' is 1", "1e-06 to 1000000"}},
      {"period_negative", with("frame_period_s", -0.005), {"'frame_period_s' is -0.005"}},
      {"period_nan", with("frame_period_s", kNan), {"'frame_period_s'", "finite"}},
      {"period_two_values", two_values, {"'frame_period_s'", "one value"}},
      {"row_step_0", with("row_step", 0), {"'row_step' is 0"}},
      {"row_step_half", with("row_step", 1.5), {"'row_step' is 1.5", "whole"}},
      {"model_number", with("camera_model", 1), {"'camera_model'", "string"}},

      {"frames_missing", without_item("/frames"), {"/frames is missing"}},
      {"frames_group", both(without_item("/frames"), [](hid_t f) { add_group(f, "/frames"); }), {"/frames", "dataset"}},
      {"frames_flat", with_dataset("/frames", H5T_NATIVE_UINT16, {3, 21}), {"/frames", "(3, 21)", "three dimensions"}},
      {"frames_int16", with_dataset("/frames", H5T_NATIVE_INT16, {3, 3, 7}), {"/frames", "int16", "uint16 or float32"}},
      {"frames_double", with_dataset("/frames", H5T_NATIVE_DOUBLE, {3, 3, 7}), {"/frames", "float64"}},
      {"frames_none", with_dataset("/frames", H5T_NATIVE_UINT16, {0, 3, 7}), {"/frames is empty", "(0, 3, 7)"}},
      {"frames_no_width", with_dataset("/frames", H5T_NATIVE_UINT16, {3, 3, 0}), {"/frames is empty", "(3, 3, 0)"}},
      {"frames_forged", forged_frames, {"/frames", "1099511627776", "cut off"}},
      {"frames_of_any_file", frames_of_any_file, {"/frames", "in other files"}},
      {"frames_of_themselves", frames_of_themselves, {"/frames", "in other files"}},
      {"frames_unknown_filter", unknown_filter, {"/frames", "555", "nobody's", "h5repack"}},
      {"frames_in_one_large_piece", one_large_piece, {"/frames", "128 MiB", "h5repack"}},
      {"events_with_long_kinds", events_with_long_kinds, {"/events", "64 KiB"}},
      {"model_too_long",
       [](hid_t f) { set_variable_string(f, "/", "camera_model", std::string((1U << 20U) + 1, 'x').c_str()); },
       {"camera_model", "65000 bytes"}},

      {"t_missing", without_item("/t"), {"/t is missing"}},
      {"t_cube", with_dataset("/t", H5T_NATIVE_DOUBLE, {1, 3, 1}), {"/t", "(1, 3, 1)"}},
      {"t_short", with_doubles("/t", {0, 1}), {"/t has 2 values", "3 frames"}},
      {"t_nan", with_doubles("/t", {0, 1, kNan}), {"/t: value 2", "finite"}},
      {"t_equal", with_doubles("/t", {0, 0.005, 0.005}), {"/t: value 2 (0.005)", "rise"}},
      {"t_falling", with_doubles("/t", {0, -0.005, 0.005}), {"/t: value 1 (-0.005)", "rise"}},
      {"t_steps_of_no_camera", with_doubles("/t", {0, 5e-324, 1e-323}), {"/t rises by 4.9", "1e-06 to 1000000 s"}},
      {"t_steps_of_weeks", with_doubles("/t", {0, 1e8, 2e8}), {"/t rises by 1", "1e-06 to 1000000 s"}},
      {"t_beyond_nanoseconds", with_doubles("/t", {0, 1, 1e300}), {"/t: value 2", "expected seconds"}},
      {"t_forged", forged_times, {"/t", "cut off"}},
      {"t_without_end", times_without_end, {"/t", "268435456", "more than any recording"}},
      {"id_missing", without_item("/frame_id"), {"/frame_id is missing"}},
      {"id_long", with_dataset("/frame_id", H5T_NATIVE_UINT64, {4}), {"/frame_id has 4 values", "3 frames"}},
      {"id_equal", with_dataset("/frame_id", H5T_NATIVE_UINT64, {3}), {"/frame_id: value 1 (0)", "rise"}},

      {"truth_empty", without_item("/truth/frames"), {"/truth/frames is missing"}},
      {"truth_shape", with_dataset("/truth/frames", H5T_NATIVE_FLOAT, {3, 7, 3}), {"/truth/frames", "3x7", "7x3"}},
      {"truth_short", with_dataset("/truth/frames", H5T_NATIVE_FLOAT, {2, 3, 7}), {"/truth/frames has 2", "3 frames"}},
      {"motion_shape", with_dataset("/motion", H5T_NATIVE_FLOAT, {3, 1, 2, 3}), {"/motion", "1x1 blocks"}},
      {"motion_flat", with_dataset("/motion", H5T_NATIVE_FLOAT, {3, 1, 3}), {"/motion has the shape", "3)"}},
      {"motion_values", with_dataset("/motion", H5T_NATIVE_FLOAT, {3, 1, 1, 2}), {"/motion has the shape", "3)"}},
      {"motion_short", with_dataset("/motion", H5T_NATIVE_FLOAT, {2, 1, 1, 3}), {"/motion has 2", "3 frames"}},
      {"motion_double", with_dataset("/motion", H5T_NATIVE_DOUBLE, {3, 1, 1, 3}), {"/motion", "float64"}},
      {"truth_double", with_dataset("/truth/frames", H5T_NATIVE_DOUBLE, {3, 3, 7}), {"/truth/frames", "float64"}},

      {"events_numbers", with_doubles("/events", {1.0}), {"/events", "float64", "compound"}},
      {"events_no_kind", events_without_kind, {"/events", "'kind'"}},
      {"events_without_end", events_without_end, {"/events", "33554432", "more than any recording"}},
      {"events_nan", events_at_nan, {"/events", "event 1", "finite"}},

      {"stimulus_dataset", with_doubles("/stimulus", {1.0}), {"/stimulus is not a group"}},
      {"stimulus_no_kind", [](hid_t f) { add_group(f, "/stimulus"); }, {"/stimulus attribute 'kind' is missing"}},
      {"stimulus_other", of_kind("laser"), {"/stimulus", "'laser'", "uniform, chopper, bar_target or scene"}},
      {"uniform_no_field", of_kind("uniform"), {"/stimulus attribute 'temperature_k' is missing"}},
      {"chopper_no_cold", both(chopper, without_field("cold_k")), {"'cold_k' is missing"}},
      {"chopper_celsius", both(chopper, with_field("cold_k", -5)), {"'cold_k' is -5", "kelvin"}},
      {"chopper_hot", both(chopper, with_doubles("/stimulus/level_k", {300, 1e300})), {"level_k: value 1", "1e+300"}},
      {"chopper_late", both(chopper, with_doubles("/stimulus/off_s", {0.2, 1e300})), {"off_s: value 1", "1e+300"}},
      {"chopper_sure", both(chopper, with_field("level_accuracy_k", 1e-300)), {"'level_accuracy_k' is 1e-300"}},
      {"chopper_no_on", both(chopper, without_item("/stimulus/on_s")), {"/stimulus/on_s is missing"}},
      {"chopper_no_off", both(chopper, without_item("/stimulus/off_s")), {"/stimulus/off_s is missing"}},
      {"chopper_no_level", both(chopper, without_item("/stimulus/level_k")), {"/stimulus/level_k is missing"}},
      {"chopper_short", both(chopper, with_doubles("/stimulus/level_k", {300})), {"level_k has 1", "on_s has 2"}},
      {"chopper_nan", both(chopper, with_doubles("/stimulus/level_k", {300, kNan})), {"level_k: value 1", "finite"}},
      {"chopper_back", both(chopper, with_doubles("/stimulus/off_s", {0.2, 0.3})), {"off_s: value 1", "after"}},
      {"bars_no_hot", both(bars, without_field("hot_k")), {"'hot_k' is missing"}},
      {"bars_no_cold", both(bars, without_field("cold_k")), {"'cold_k' is missing"}},
      {"bars_no_period", both(bars, without_field("period_px")), {"'period_px' is missing"}},
      {"bars_no_width", both(bars, without_field("bar_width_px")), {"'bar_width_px' is missing"}},
      {"bars_no_slant", both(bars, without_field("slant_px_per_row")), {"'slant_px_per_row' is missing"}},
      {"bars_no_velocity", both(bars, without_field("velocity_px_s")), {"'velocity_px_s' is missing"}},
      {"bars_hot", both(bars, with_field("hot_k", 1e300)), {"'hot_k' is 1e+300", "kelvin"}},
      {"bars_fine", both(bars, with_field("period_px", 1e-300)), {"'period_px' is 1e-300", "pixels"}},
      {"bars_fast", both(bars, with_field("velocity_px_s", -1e300)), {"'velocity_px_s'", "finite"}},
      {"bars_period_0", both(bars, with_field("period_px", 0)), {"'period_px' is 0"}},
      {"bars_wide", both(bars, with_field("bar_width_px", 21)), {"'bar_width_px' is 21", "period_px (20)"}},
      {"scene_no_image", both(scene, without_item("/stimulus/image_k")), {"/stimulus/image_k is missing"}},
      {"scene_flat", both(scene, with_doubles("/stimulus/image_k", {1})), {"image_k", "(1)", "(height, width)"}},
      {"scene_no_t", both(scene, without_item("/stimulus/t_s")), {"/stimulus/t_s is missing"}},
      {"scene_no_x", both(scene, without_item("/stimulus/x_px")), {"/stimulus/x_px is missing"}},
      {"scene_no_y", both(scene, without_item("/stimulus/y_px")), {"/stimulus/y_px is missing"}},
      {"scene_short_y", both(scene, with_doubles("/stimulus/y_px", {1})), {"y_px has 1", "t_s has 2"}},
      {"scene_far", both(scene, with_doubles("/stimulus/x_px", {0, 1e300})), {"x_px: value 1", "1e+300"}},
      {"scene_still_time", both(scene, with_doubles("/stimulus/t_s", {1, 1})), {"t_s: value 1", "rise"}},
  };
  return kAll;
}

class CaptureStrict : public ::testing::TestWithParam<Corruption> {};

TEST_P(CaptureStrict, IsRefusedByName) {
  const Scratch scratch;
  const auto file = valid_file(scratch);
  ASSERT_TRUE(CaptureReader::open(file)) << "the file must be good before it is spoilt";
  edit(file, GetParam().change);
  const auto reader = CaptureReader::open(file);
  const auto stimulus = reader ? reader->stimulus() : tl::unexpected(reader.error());  // not needed to read frames
  ASSERT_FALSE(stimulus);
  EXPECT_TRUE(stimulus.error().message.starts_with(file.string() + ": ")) << stimulus.error().message;
  for (const std::string& word : GetParam().named) expect_refused(stimulus, {word});
}

INSTANTIATE_TEST_SUITE_P(Rules, CaptureStrict, ::testing::ValuesIn(corruptions()),
                         [](const auto& row) { return row.param.name; });

void expect_no_capture(const std::filesystem::path& file, const std::string& word) {
  const auto reader = CaptureReader::open(file);
  expect_refused(reader, {word});
  EXPECT_TRUE(!reader && reader.error().message.starts_with(file.string() + ": "));
}

TEST_F(CaptureStrictFile, WhatIsNoCaptureIsToldApart) {
  expect_no_capture(scratch_ / "absent.h5", "No such file");
  expect_no_capture(scratch_ / "", "not a regular file");
  std::ofstream(scratch_ / "empty.h5").close();
  expect_no_capture(scratch_ / "empty.h5", "is empty");
  expect_no_capture("/proc/self/status", "made by the kernel");
  const std::filesystem::path unreadable = "/sys/class/net/lo/speed";  // as a disk that fails
  if (std::filesystem::exists(unreadable)) expect_no_capture(unreadable, "cannot be read: Invalid argument");
  expect_no_capture(scratch_.text("text.h5", "hello, this is no HDF5 file"), "not an HDF5 file");
  const std::string old = "MATLAB 5.0 MAT-file, Platform: GLNXA64" + std::string(200, ' ');
  expect_no_capture(scratch_.text("old.mat", old), "-v7.3");
}

// salvage(), too, does not read values from other files.
TEST_F(CaptureStrictFile, ValuesOfOtherFilesAreNotReadOfADamagedOneEither) {
  const auto file = valid_file(scratch_);
  edit(file, frames_of_themselves);
  expect_refused(CaptureReader::salvage(file), {"in other files"});
}

TEST_F(CaptureStrictFile, TruncatedFileIsCutOff) {
  const auto file = valid_file(scratch_);
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - 100);
  expect_no_capture(file, "cut off");
}

// A recorder that starts the file again truncates it: the missing frames must not read as zeros.
TEST_F(CaptureStrictFile, OneThatIsCutWhileItIsReadIsAnError) {
  const auto file = valid_file(scratch_);
  const auto reader = must(CaptureReader::open(file));
  std::filesystem::resize_file(file, 1000);
  std::vector<std::uint16_t> plane(21);
  const Status status = reader->read_frame(2, plane.data());
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message.rfind(file.string() + ": ", 0), 0U) << status.error().message;
}

}  // namespace bolo::capture::capture_strict_test
