// Per-pixel parameter files: round trip, and errors that name the item and the place.
#include "src/capture/pixel_maps_io.hpp"
#include "tests/capture/hdf5_edit.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/refusal.hpp"

namespace bolo::capture::pixel_maps_test {

using namespace bolo::capture::testing;

model::PixelMaps some_maps() {
  model::PixelMaps maps;
  maps.geometry = {3, 2};
  maps.tau_s = {0.010F, 0.011F, 0.012F, 0.009F, 0.010F, 0.011F};
  maps.gain = {1.0F, 1.1F, 0.9F, 1.0F, 1.0F, 1.0F};
  maps.offset = {0.0F, -0.5F, 0.5F, 0.0F, 0.0F, 2.0F};
  maps.dead = {0, 0, 1, 0, 0, 0};
  return maps;
}

class PixelMapsFile : public ScratchTest {
 protected:
  const std::filesystem::path file_ = scratch_ / "maps.h5";
};

TEST_F(PixelMapsFile, IsReadAsWritten) {
  ASSERT_TRUE(write_pixel_maps(file_, some_maps()));
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "maps.h5.part"));
  const auto maps = must(read_pixel_maps(file_));
  EXPECT_EQ(maps->geometry, (Geometry{3, 2}));
  EXPECT_EQ(maps->tau_s, some_maps().tau_s);
  EXPECT_EQ(maps->gain, some_maps().gain);
  EXPECT_EQ(maps->offset, some_maps().offset);
  EXPECT_EQ(maps->dead, some_maps().dead);
  EXPECT_EQ(maps->row_delay_s, 0.0);
}

TEST_F(PixelMapsFile, MapsMayBeLeftOutAndStoredInOtherTypes) {
  model::PixelMaps maps;
  maps.geometry = {3, 2};
  maps.gain = some_maps().gain;
  ASSERT_TRUE(write_pixel_maps(file_, maps));
  edit(file_, with_dataset("/tau_s", H5T_NATIVE_DOUBLE, {2, 3}, std::vector<double>(6, 0.0125)));
  const auto read = must(read_pixel_maps(file_));
  EXPECT_EQ(read->tau_s, std::vector<float>(6, 0.0125F));
  EXPECT_TRUE(read->offset.empty());
  EXPECT_TRUE(read->dead.empty());
}

TEST_F(PixelMapsFile, BelongsToTheProfileThatNamesIt) {
  ASSERT_TRUE(write_pixel_maps(file_, some_maps()));
  const auto profile = must(model::read_profile(scratch_.text("p.toml", "row_delay_s = 3.0e-5\nmaps = \"maps.h5\"\n")));
  const auto maps = must(read_profile_maps(*profile));
  EXPECT_EQ(maps->row_delay_s, 3.0e-5);
  EXPECT_EQ(maps->gain, some_maps().gain);
  EXPECT_TRUE(read_profile_maps(model::CameraProfile())->empty());
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

auto with_floats(const char* path, std::vector<hsize_t> dims, std::vector<double> values) {
  return with_dataset(path, H5T_NATIVE_FLOAT, std::move(dims), std::move(values));
}

TEST_F(PixelMapsFile, DamageIsRefusedByFileDatasetAndPlace) {
  struct Damage {
    const char* name;
    Change spoil;
    const char* message;
  };
  for (const Damage& damage : std::initializer_list<Damage>{
           {"Format", with_text("format", "bolo-capture"), "\"bolo-maps\""},
           {"NoFormat", without("format"), "'format' is missing"},
           {"Version", with("version", 2), "'version' is 2"},
           {"Width", with("width", 2.5), "'width' is 2.5"},
           {"Huge", with("height", 1e9), "'height' is 1e+09"},
           {"Turned", with_floats("/gain", {3, 2}, {}), "/gain has the shape (3, 2); expected (2, 3)"},
           {"Flat", with_floats("/tau_s", {6}, {}), "/tau_s has the shape (6)"},
           {"Nan", with_floats("/offset_k", {2, 3}, {0, 0, 0, 0, kNan}), "/offset_k[1, 1] is nan"},
           {"Tau", with_floats("/tau_s", {2, 3}, {0.01, 0.01, -0.01}), "/tau_s[0, 2] is -0.0"},
           {"HugeGain", with_floats("/gain", {2, 3}, {1, 3e38F}), "/gain[0, 1] is 3"},
           {"HugeOffset", with_floats("/offset_k", {2, 3}, {0, -3e38F}), "/offset_k[0, 1] is -3"},
           {"Gain", with_floats("/gain", {2, 3}, {1, 1, 1, 0, 1, 1}), "/gain[1, 0] is 0; must be"},
           {"Link",
            [](hid_t maps) {
              H5Ldelete(maps, "/gain", H5P_DEFAULT);
              H5Lcreate_soft("/none", maps, "/gain", H5P_DEFAULT, H5P_DEFAULT);
            },
            "/gain is missing"},
           {"Dead", with_dataset("/dead", H5T_NATIVE_UINT8, {2, 3}, {0, 0, 0, 0, 0, 7}),
            "/dead[1, 2] is 7; must be 0 or 1"}}) {
    SCOPED_TRACE(damage.name);
    ASSERT_TRUE(write_pixel_maps({file_, Replace::kExisting}, some_maps()));
    edit(file_, damage.spoil);
    const auto maps = read_pixel_maps(file_);
    expect_refused(maps, {damage.message});
    EXPECT_TRUE(!maps && maps.error().message.starts_with(file_.string() + ": "));
  }
}

TEST_F(PixelMapsFile, NoFileAndNoMapsAreToldApart) {
  EXPECT_NE(read_pixel_maps(scratch_ / "none.h5").error().message.find("none.h5"), std::string::npos);
  EXPECT_NE(read_pixel_maps(scratch_.text("text.h5", "not HDF5\n")).error().message.find("text.h5"), std::string::npos);
  model::PixelMaps wrong = some_maps();
  wrong.gain.pop_back();
  EXPECT_FALSE(write_pixel_maps(file_, wrong));
  EXPECT_FALSE(std::filesystem::exists(file_));
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "maps.h5.part"));
}

}  // namespace bolo::capture::pixel_maps_test
