// Files as other programs write them: all widths, byte orders and string types that HDF5 converts.
#include "src/capture/frame_store.hpp"
#include "tests/capture/hdf5_edit.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/refusal.hpp"

namespace bolo::capture::capture_variants_test {

using CaptureVariantsOther = ScratchTest;
using StillImage = ScratchTest;
using MatlabCapture = ScratchTest;

using namespace bolo::capture::testing;

// A file written with plain HDF5 calls; `change` may replace items.
std::filesystem::path foreign_file(const Scratch& scratch, const Change& change) {
  const auto file = scratch / "foreign.h5";
  H5Fclose(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  edit(file, [&](hid_t f) {
    set_variable_string(f, "/", "format", "bolo-capture");
    set_number(f, "/", "version", 1, H5T_STD_I64LE);
    set_variable_string(f, "/", "unit", "kelvin");
    set_number(f, "/", "scale", 0.01);
    set_number(f, "/", "offset", 1.5);
    set_number(f, "/", "frame_period_s", 0.005);
    set_dataset(f, "/frames", H5T_STD_U16LE, {3, 3, 7}, H5T_NATIVE_UINT16, all_planes(3).data());
    set_doubles(f, "/t", {0.0, 0.005, 0.01});
    set_doubles(f, "/frame_id", {4, 5, 9}, H5T_STD_U64LE);
    change(f);
  });
  return file;
}

void expect_same_content(const std::filesystem::path& file) {
  const auto reader = must(CaptureReader::open(file));
  EXPECT_EQ(reader->frame_id(), (std::vector<std::uint64_t>{4, 5, 9}));
  EXPECT_NEAR(reader->t().at(2), 0.01, 1e-9);
  EXPECT_EQ(reader->info().format.scale.unit, Unit::kKelvin);
  EXPECT_NEAR(reader->info().format.scale.scale, 0.01, 1e-9);
  EXPECT_EQ(reader->info().format.scale.offset, 1.5);
  EXPECT_EQ(reader->info().format.row_step, 1);
  ASSERT_EQ(reader->info().format.type, PixelType::kUint16);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(frame_values(*reader, i), plane_of<std::uint16_t>(i, 21)) << "frame " << i;
  }
}

auto frames_as(hid_t type, std::vector<hsize_t> chunk = {}, unsigned deflate = 0) {
  return [=](hid_t f) {
    set_dataset(f, "/frames", type, {3, 3, 7}, H5T_NATIVE_UINT16, all_planes(3).data(), chunk, deflate);
  };
}

void one_element_number(hid_t f) {
  const double value = 0.01;
  set_attribute(f, "/", "scale", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value, {1});
}

TEST(CaptureVariants, Open) {
  const std::pair<const char*, Change> variants[]{
      {"h5py_plain", [](hid_t) {}},
      {"fixed_string", with_text("unit", "kelvin")},
      {"null_padded_string", with_text("unit", "kelvin", H5T_STR_NULLPAD)},
      {"space_padded_string", with_text("unit", "kelvin", H5T_STR_SPACEPAD)},
      {"string_array_of_one", [](hid_t f) { set_variable_string(f, "/", "unit", "kelvin", {1}); }},
      {"number_array_of_one", one_element_number},
      {"version_int32", with("version", 1, H5T_STD_I32BE)},
      {"version_double", with("version", 1)},
      {"scale_float32", with("scale", 0.01, H5T_IEEE_F32BE)},
      {"offset_double_big_endian", with("offset", 1.5, H5T_IEEE_F64BE)},
      {"row_step_double", with("row_step", 1)},
      {"t_float32_big_endian", with_doubles("/t", {0.0, 0.005, 0.01}, H5T_IEEE_F32BE)},
      {"id_int32", with_doubles("/frame_id", {4, 5, 9}, H5T_STD_I32LE)},
      {"id_double", with_doubles("/frame_id", {4, 5, 9})},
      {"frames_big_endian", frames_as(H5T_STD_U16BE)},
      {"frames_one_chunk", frames_as(H5T_STD_U16LE, {3, 3, 7}, 5)},
      {"frames_odd_chunks", frames_as(H5T_STD_U16BE, {2, 2, 4}, 5)}};
  for (const auto& [name, change] : variants) {
    SCOPED_TRACE(name);
    const Scratch scratch;
    expect_same_content(foreign_file(scratch, change));
  }
}

TEST_F(CaptureVariantsOther, CountsNeedNoScale) {
  const auto reader = must(CaptureReader::open(foreign_file(scratch_, [](hid_t f) {
    set_string(f, "/", "unit", "count");
    drop_attribute(f, "/", "scale");
    drop_attribute(f, "/", "offset");
  })));
  EXPECT_EQ(reader->info().format.scale.unit, Unit::kCount);
}

TEST_F(CaptureVariantsOther, ASerialNumberMayBeANumber) {
  const auto reader = must(CaptureReader::open(foreign_file(scratch_, with("camera_serial", 63201234, H5T_STD_I64LE))));
  EXPECT_EQ(reader->info().camera_serial, "63201234");
}

TEST_F(CaptureVariantsOther, OneOfTheHostsTimesAloneIsLeftOut) {
  const auto reader = must(CaptureReader::open(foreign_file(scratch_, [](hid_t f) {
    set_doubles(f, "/t_utc", {1, 2, 3});
  })));
  EXPECT_FALSE(reader->info().has_times);
  ASSERT_EQ(reader->warnings().size(), 1U);
  EXPECT_EQ(reader->warnings()[0], "/t_utc is left out: /t_host is missing beside it");
}

TEST_F(CaptureVariantsOther, EventsOfVariableLengthStrings) {
  struct Row {
    double t;
    const char* kind;
  };
  const auto reader = must(CaptureReader::open(foreign_file(scratch_, [](hid_t f) {
    const std::vector<Row> rows{{0.25, "nuc"}, {0.5, "reconnect"}};
    set_events(f, H5T_VARIABLE, sizeof(Row), rows.size(), rows.data());
  })));
  ASSERT_EQ(reader->events().size(), 2U);
  EXPECT_EQ(reader->events()[0].kind, "nuc");
  EXPECT_EQ(reader->events()[1].kind, "reconnect");
  EXPECT_EQ(reader->events()[1].t_s, 0.5);
}

TEST(CaptureWarnings, PeriodsThatTheTimesContradictAndMilliseconds) {
  const auto times_in_ms = [](hid_t f) {
    set_doubles(f, "/t", {0, 114, 228});
    set_number(f, "/", "frame_period_s", 114);
  };
  const std::pair<Change, const char*> cases[]{{with("frame_period_s", 0.0065), "0.0065"},
                                               {with("frame_period_s", 0.0058), nullptr},
                                               {times_in_ms, "milliseconds"}};
  for (const auto& [change, word] : cases) {
    const Scratch scratch;
    const auto reader = must(CaptureReader::open(foreign_file(scratch, change)));
    ASSERT_EQ(reader->warnings().size(), word == nullptr ? 0U : 1U);
    if (word == nullptr) continue;
    EXPECT_NE(reader->warnings()[0].find(word), std::string::npos) << reader->warnings()[0];
  }
}

TEST_F(StillImage, ReadsAnyWidth) {
  const auto still = must(read_still(
      foreign_file(scratch_, with_dataset("/image_k", H5T_IEEE_F64BE, {2, 3}, {290, 291, 292, 293, 294, 295.5}))));
  EXPECT_EQ(still->width, 3);
  EXPECT_EQ(still->height, 2);
  EXPECT_EQ(still->kelvin, (std::vector<float>{290.0F, 291.0F, 292.0F, 293.0F, 294.0F, 295.5F}));
}

TEST_F(StillImage, RefusesWhatIsNoStill) {
  const auto file = foreign_file(scratch_, [](hid_t) {});
  expect_refused(read_still(file), {"/image_k is missing"});
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  edit(file, with_dataset("/image_k", H5T_IEEE_F32LE, {2, 3}, {290, 291, 292, kInfinity, 294, 295.5}));
  expect_refused(read_still(file), {"column 0, row 1"});
}

// --- The authors' `.mat`, as MATLAB writes it: HDF5 after a 512-byte header, dimensions reversed.

constexpr std::size_t kFrames = 6;
constexpr std::size_t kWidth = 7;
constexpr std::size_t kHeight = 3;
const std::vector<double> kTimes{0.0, 0.005, 0.01, 0.025, 0.03, 0.0351};

// MATLAB's frames(n, x, y), column-major, is (y, x, n) in HDF5.
std::vector<double> matlab_order() {
  std::vector<double> values(kFrames * kWidth * kHeight);
  for (std::size_t n = 0; n < kFrames; ++n) {
    for (std::size_t i = 0; i < kWidth * kHeight; ++i) values[i * kFrames + n] = value_at(n, i);
  }
  return values;
}

struct Layout {
  hid_t type;
  std::vector<hsize_t> t_dims;
  std::vector<hsize_t> chunk;
};

const Layout kDoubles{H5T_IEEE_F64LE, {kFrames, 1}, {}};

std::filesystem::path matlab_file(const Scratch& scratch, const std::string& name, const Layout& layout) {
  const auto file = scratch / name;
  const hid_t creation = H5Pcreate(H5P_FILE_CREATE);
  H5Pset_userblock(creation, 512);
  H5Fclose(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, creation, H5P_DEFAULT));
  H5Pclose(creation);
  edit(file, [&](hid_t f) {
    set_dataset(f, "/t", H5T_NATIVE_DOUBLE, layout.t_dims, H5T_NATIVE_DOUBLE, kTimes.data());
    set_string(f, "/t", "MATLAB_class", "double");
    const auto values = matlab_order();
    set_dataset(f, "/frames", layout.type, {kHeight, kWidth, kFrames}, H5T_NATIVE_DOUBLE, values.data(), layout.chunk,
                layout.chunk.empty() ? 0 : 3);
    set_string(f, "/frames", "MATLAB_class", "single");
  });
  std::fstream(file, std::ios::in | std::ios::out) << "MATLAB 7.3 MAT-file, Platform: GLNXA64";
  return file;
}

template <typename T>
void expect_content(const std::filesystem::path& file) {
  const auto reader = must(CaptureReader::open(file));
  EXPECT_EQ(reader->file_format(), FileFormat::kMatlab);
  EXPECT_EQ(reader->info().format.geometry, (Geometry{7, 3}));
  EXPECT_EQ(reader->info().format.scale, (LinearScale{Unit::kKelvin, 1.0, 0.0}));
  EXPECT_NEAR(reader->info().format.frame_period_s, 0.005, 1e-12);
  EXPECT_EQ(reader->info().frames, kFrames);
  EXPECT_EQ(reader->t(), kTimes);
  EXPECT_EQ(reader->frame_id(), (std::vector<std::uint64_t>{0, 1, 2, 5, 6, 7})) << "two frames were lost before 0.025";
  ASSERT_EQ(bytes_of(reader->info().format.type), sizeof(T));
  for (const std::size_t i : {5U, 0U, 3U}) {
    EXPECT_EQ(frame_values<T>(*reader, i), plane_of<T>(i, kWidth * kHeight)) << "frame " << i;
  }
}

TEST_F(MatlabCapture, DoubleBecomesFloatAndUint16Stays) {
  expect_content<float>(matlab_file(scratch_, "double.mat", kDoubles));
  expect_content<float>(matlab_file(scratch_, "single.mat", {H5T_IEEE_F32LE, {1, kFrames}, {2, 4, 4}}));
  expect_content<std::uint16_t>(matlab_file(scratch_, "uint16.mat", {H5T_STD_U16LE, {kFrames, 1}, {}}));
  expect_content<float>(matlab_file(scratch_, "another_name.h5", {H5T_IEEE_F64LE, {kFrames}, {1, 7, 6}}));
}

TEST_F(MatlabCapture, FramesInTheWrongOrderAndFallingTimesAreRefused) {
  const auto file = matlab_file(scratch_, "a.mat", kDoubles);
  edit(file, with_dataset("/frames", H5T_NATIVE_DOUBLE, {kFrames, kHeight, kWidth}, matlab_order()));
  expect_refused(CaptureReader::open(file), {"t has 6 values but frames"});
  const auto falling = matlab_file(scratch_, "b.mat", kDoubles);
  edit(falling, with_doubles("/t", {0, 0.005, 0.01, 0.009, 0.03, 0.04}));
  expect_refused(CaptureReader::open(falling), {"value 3"});
}

// Blocks of two frames out of six: forwards, backwards and across the edges.
TEST(FrameStore, MatlabOrderByTheBlock) {
  const Scratch scratch;
  const auto file = matlab_file(scratch, "a.mat", kDoubles);
  const h5::Handle handle(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  const std::size_t two_frames = 2 * kWidth * kHeight * sizeof(float);
  auto store = must(
      FrameStore::open(handle.get(), "/frames", FrameOrder::kMatlab, h5::Expect::kWhole, two_frames + sizeof(float)));
  for (const std::size_t i : {0U, 1U, 2U, 5U, 4U, 3U, 0U}) {
    std::vector<float> plane(kWidth * kHeight);
    ASSERT_TRUE(store->read(i, plane.data()));
    EXPECT_EQ(plane, plane_of<float>(i, plane.size())) << "frame " << i;
  }
  std::vector<float> plane(kWidth * kHeight);
  EXPECT_FALSE(store->read(kFrames, plane.data()));
}

}  // namespace bolo::capture::capture_variants_test
