// Files as other programs write them: every width, byte order and kind of string that HDF5 converts.
#include <gtest/gtest.h>

#include <limits>

#include "tests/capture/hdf5_edit.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/refusal.hpp"

namespace bolo::capture::capture_variants_test {
namespace {

using namespace bolo::capture::testing;

std::vector<std::uint16_t> all_values() {
  std::vector<std::uint16_t> values;
  for (std::size_t i = 0; i < 3; ++i) {
    for (const std::uint16_t value : plane_of<std::uint16_t>(i, 21)) values.push_back(value);
  }
  return values;
}

// A file from nothing but HDF5 calls; `change` may replace items.
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
    const auto values = all_values();
    set_dataset(f, "/frames", H5T_STD_U16LE, {3, 3, 7}, H5T_NATIVE_UINT16, values.data());
    set_doubles(f, "/t", {0.0, 0.005, 0.01});
    set_doubles(f, "/frame_id", {4, 5, 9}, H5T_STD_U64LE);
    change(f);
  });
  return file;
}

void expect_same_content(const std::filesystem::path& file) {
  const auto reader = CaptureReader::open(file);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->frame_id(), (std::vector<std::uint64_t>{4, 5, 9}));
  EXPECT_NEAR(reader->t().at(2), 0.01, 1e-9);
  EXPECT_EQ(reader->info().format.scale.unit, Unit::kKelvin);
  EXPECT_NEAR(reader->info().format.scale.scale, 0.01, 1e-9);
  EXPECT_EQ(reader->info().format.scale.offset, 1.5);
  EXPECT_EQ(reader->info().format.row_step, 1);
  ASSERT_EQ(reader->info().format.type, PixelType::kUint16);
  for (std::size_t i = 0; i < 3; ++i) {
    std::vector<std::uint16_t> plane(21);
    ASSERT_TRUE(reader->read_frame(i, plane.data()));
    EXPECT_EQ(plane, plane_of<std::uint16_t>(i, 21)) << "frame " << i;
  }
}

struct Variant {
  const char* name;
  Change change;
};
void PrintTo(const Variant& variant, std::ostream* out) { *out << variant.name; }

auto frames_as(hid_t type, std::vector<hsize_t> chunk = {}, unsigned deflate = 0) {
  return [=](hid_t f) {
    set_dataset(f, "/frames", type, {3, 3, 7}, H5T_NATIVE_UINT16, all_values().data(), chunk, deflate);
  };
}

void one_element_number(hid_t f) {
  const double value = 0.01;
  set_attribute(f, "/", "scale", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value, {1});
}

class CaptureVariants : public ::testing::TestWithParam<Variant> {};

TEST_P(CaptureVariants, Opens) {
  const Scratch scratch;
  expect_same_content(foreign_file(scratch, GetParam().change));
}

INSTANTIATE_TEST_SUITE_P(
    Foreign, CaptureVariants,
    ::testing::Values(
        Variant{"h5py_plain", [](hid_t) {}}, Variant{"fixed_string", with_text("unit", "kelvin")},
        Variant{"null_padded_string", with_text("unit", "kelvin", H5T_STR_NULLPAD)},
        Variant{"space_padded_string", with_text("unit", "kelvin", H5T_STR_SPACEPAD)},
        Variant{"string_array_of_one", [](hid_t f) { set_variable_string(f, "/", "unit", "kelvin", {1}); }},
        Variant{"number_array_of_one", one_element_number}, Variant{"version_int32", with("version", 1, H5T_STD_I32BE)},
        Variant{"version_double", with("version", 1)}, Variant{"scale_float32", with("scale", 0.01, H5T_IEEE_F32BE)},
        Variant{"offset_double_big_endian", with("offset", 1.5, H5T_IEEE_F64BE)},
        Variant{"row_step_double", with("row_step", 1)},
        Variant{"t_float32_big_endian", with_doubles("/t", {0.0, 0.005, 0.01}, H5T_IEEE_F32BE)},
        Variant{"id_int32", with_doubles("/frame_id", {4, 5, 9}, H5T_STD_I32LE)},
        Variant{"id_double", with_doubles("/frame_id", {4, 5, 9})},
        Variant{"frames_big_endian", frames_as(H5T_STD_U16BE)},
        Variant{"frames_one_chunk", frames_as(H5T_STD_U16LE, {3, 3, 7}, 5)},
        Variant{"frames_odd_chunks", frames_as(H5T_STD_U16BE, {2, 2, 4}, 5)}),
    [](const auto& row) { return row.param.name; });

TEST(CaptureVariantsOther, CountsNeedNoScale) {
  const Scratch scratch;
  const auto reader = CaptureReader::open(foreign_file(scratch, [](hid_t f) {
    set_string(f, "/", "unit", "count");
    drop_attribute(f, "/", "scale");
    drop_attribute(f, "/", "offset");
  }));
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->info().format.scale.unit, Unit::kCount);
}

TEST(CaptureVariantsOther, EventsOfVariableLengthStrings) {
  struct Row {
    double t;
    const char* kind;
  };
  const Scratch scratch;
  const auto reader = CaptureReader::open(foreign_file(scratch, [](hid_t f) {
    const hid_t text = H5Tcopy(H5T_C_S1);
    H5Tset_size(text, H5T_VARIABLE);
    H5Tset_cset(text, H5T_CSET_UTF8);
    const hid_t type = H5Tcreate(H5T_COMPOUND, sizeof(Row));
    H5Tinsert(type, "t", HOFFSET(Row, t), H5T_NATIVE_DOUBLE);
    H5Tinsert(type, "kind", HOFFSET(Row, kind), text);
    const std::vector<Row> rows{{0.25, "nuc"}, {0.5, "reconnect"}};
    set_dataset(f, "/events", type, {2}, type, rows.data());
    H5Tclose(type);
    H5Tclose(text);
  }));
  ASSERT_TRUE(reader) << reader.error().message;
  ASSERT_EQ(reader->events().size(), 2U);
  EXPECT_EQ(reader->events()[0].kind, "nuc");
  EXPECT_EQ(reader->events()[1].kind, "reconnect");
  EXPECT_EQ(reader->events()[1].t_s, 0.5);
}

TEST(CaptureWarnings, PeriodThatTheTimesContradict) {
  const Scratch scratch;
  const auto reader = CaptureReader::open(foreign_file(scratch, with("frame_period_s", 0.0065)));
  ASSERT_TRUE(reader) << reader.error().message;
  ASSERT_EQ(reader->warnings().size(), 1U);
  EXPECT_NE(reader->warnings()[0].find("0.0065"), std::string::npos) << reader->warnings()[0];
}

TEST(CaptureWarnings, PeriodWithinTolerancePasses) {
  const Scratch scratch;
  const auto reader = CaptureReader::open(foreign_file(scratch, with("frame_period_s", 0.0058)));
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_TRUE(reader->warnings().empty());
}

TEST(CaptureWarnings, TimesInMillisecondsAreNamed) {
  const Scratch scratch;
  const auto reader = CaptureReader::open(foreign_file(scratch, [](hid_t f) {
    set_doubles(f, "/t", {0, 114, 228});
    set_number(f, "/", "frame_period_s", 114);
  }));
  ASSERT_TRUE(reader) << reader.error().message;
  ASSERT_EQ(reader->warnings().size(), 1U);
  EXPECT_NE(reader->warnings()[0].find("milliseconds"), std::string::npos) << reader->warnings()[0];
}

TEST(StillImage, ReadsAnyWidth) {
  const Scratch scratch;
  const auto still = read_still(
      foreign_file(scratch, with_dataset("/image_k", H5T_IEEE_F64BE, {2, 3}, {290, 291, 292, 293, 294, 295.5})));
  ASSERT_TRUE(still) << still.error().message;
  EXPECT_EQ(still->width, 3);
  EXPECT_EQ(still->height, 2);
  EXPECT_EQ(still->kelvin, (std::vector<float>{290.0F, 291.0F, 292.0F, 293.0F, 294.0F, 295.5F}));
}

TEST(StillImage, RefusesWhatIsNoStill) {
  const Scratch scratch;
  const auto file = foreign_file(scratch, [](hid_t) {});
  expect_refused(read_still(file), {"/image_k is missing"});
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  edit(file, with_dataset("/image_k", H5T_IEEE_F32LE, {2, 3}, {290, 291, 292, kInfinity, 294, 295.5}));
  expect_refused(read_still(file), {"column 0, row 1"});
}

}  // namespace
}  // namespace bolo::capture::capture_variants_test
