// Recordings of real cameras (BOLO_TEST_DATA) open with the shapes that their README states.
#include "tests/capture/small_captures.hpp"

namespace bolo::capture::real_captures_test {

std::filesystem::path test_data() {
  const char* folder = std::getenv("BOLO_TEST_DATA");
  return folder == nullptr ? "" : folder;
}

struct Recording {
  const char* name;
  std::size_t frames;
  Geometry geometry;
  bool milliseconds;  // its /t is in ms: opens, with a warning that says so
};

class RealCaptures : public ::testing::TestWithParam<Recording> {};

TEST_P(RealCaptures, OpenAndRead) {
  if (test_data().empty()) GTEST_SKIP() << "BOLO_TEST_DATA is not set: no recordings of real cameras";
  const auto& expected = GetParam();
  const auto reader = must(CaptureReader::open(test_data() / "captures" / (std::string(expected.name) + ".h5")));
  EXPECT_EQ(reader->info().frames, expected.frames);
  EXPECT_EQ(reader->info().format.geometry, expected.geometry);
  EXPECT_EQ(reader->info().format.type, PixelType::kUint16);
  EXPECT_EQ(reader->info().format.scale.unit, Unit::kCount);
  ASSERT_EQ(reader->warnings().size(), expected.milliseconds ? 1U : 0U);
  if (expected.milliseconds) {
    EXPECT_NE(reader->warnings()[0].find("milliseconds"), std::string::npos);
  }
  std::vector<std::uint16_t> plane(expected.geometry.pixels());
  for (std::size_t i = 0; i < expected.frames; ++i) ASSERT_TRUE(reader->read_frame(i, plane.data()));
  const auto [low, high] = std::minmax_element(plane.begin(), plane.end());
  EXPECT_LT(*low, *high) << "a real scene is not flat";
}

INSTANTIATE_TEST_SUITE_P(Recordings, RealCaptures,
                         ::testing::Values(Recording{"a65_drive_a", 30, {640, 512}, false},
                                           Recording{"atto320_blackbody_20C", 60, {320, 240}, false},
                                           Recording{"atto320_blackbody_25C", 60, {320, 240}, false},
                                           Recording{"lepton_cat", 133, {160, 120}, true},
                                           Recording{"lepton_hand_fast", 100, {160, 120}, false},
                                           Recording{"lepton_noise_01", 177, {160, 120}, true},
                                           Recording{"lepton_possum", 160, {160, 120}, false}),
                         [](const auto& row) { return row.param.name; });

TEST(RealStimulus, BlackBody) {
  if (test_data().empty()) GTEST_SKIP() << "BOLO_TEST_DATA is not set: no recordings of real cameras";
  const auto reader = must(CaptureReader::open(test_data() / "captures/atto320_blackbody_25C.h5"));
  const Stimulus stimulus = reader->stimulus().value();
  ASSERT_TRUE(std::holds_alternative<Uniform>(stimulus));
  EXPECT_DOUBLE_EQ(std::get<Uniform>(stimulus).temperature_k, 298.15);
}

TEST(RealStill, RadiometricSceneIsInKelvin) {
  if (test_data().empty()) GTEST_SKIP() << "BOLO_TEST_DATA is not set: no stills of real cameras";
  const auto still = must(read_still(test_data() / "scenes/radiometric_02.h5"));
  EXPECT_EQ(still->width, 640);
  EXPECT_EQ(still->height, 480);
  ASSERT_EQ(still->kelvin.size(), 640U * 480U);
  EXPECT_GT(*std::min_element(still->kelvin.begin(), still->kelvin.end()), 200.0F);
  EXPECT_LT(*std::max_element(still->kelvin.begin(), still->kelvin.end()), 1000.0F);
}

}  // namespace bolo::capture::real_captures_test
