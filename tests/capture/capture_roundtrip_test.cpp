// Round trip of written captures, value for value; recordings of real cameras (BOLO_TEST_DATA) match their README.
#include "src/capture/capture.hpp"
#include "tests/capture/small_captures.hpp"

namespace bolo::capture::capture_roundtrip_test {

using testing::frame_values;
using testing::plane_of;
using testing::small_info;

constexpr std::size_t kFrames = 5;

using Variant = std::tuple<PixelType, bool, int>;  // type, truth, deflate level

class CaptureRoundTrip : public ::testing::TestWithParam<Variant> {};

template <typename T>
void append_frame(CaptureWriter& writer, std::size_t i, bool truth) {
  const auto plane = plane_of<T>(i, 21);
  const auto truth_plane = plane_of<float>(i + 50, 21);
  must(writer.append(0.005 * static_cast<double>(i), 10 + 2 * i, plane.data(), truth ? truth_plane.data() : nullptr));
}

template <typename T>
void expect_frames(const CaptureReader& reader) {
  for (const std::size_t i : {4U, 0U, 2U, 1U, 3U}) {  // any order
    EXPECT_EQ(frame_values<T>(reader, i), plane_of<T>(i, 21)) << "frame " << i;
  }
}

TEST_P(CaptureRoundTrip, EveryValueComesBack) {
  const auto [type, truth, level] = GetParam();
  const Scratch scratch;
  const auto file = scratch / "a.h5";
  auto writer = must(CaptureWriter::create(file, small_info(type), {truth, level}));
  for (std::size_t i = 0; i < kFrames; ++i) {
    type == PixelType::kUint16 ? append_frame<std::uint16_t>(*writer, i, truth)
                               : append_frame<float>(*writer, i, truth);
  }
  must(writer->close());

  const auto reader = must(CaptureReader::open(file));
  EXPECT_EQ(reader->info().format, small_info(type).format);
  EXPECT_EQ(reader->info().camera_model, "FLIR A655sc");
  EXPECT_EQ(reader->info().camera_serial, "55001234");
  EXPECT_EQ(reader->info().frames, kFrames);
  EXPECT_EQ(reader->info().has_truth, truth);
  EXPECT_EQ(reader->t(), (std::vector<double>{0.0, 0.005, 0.01, 0.015, 0.02}));
  EXPECT_EQ(reader->frame_id(), (std::vector<std::uint64_t>{10, 12, 14, 16, 18}));
  EXPECT_TRUE(reader->warnings().empty());
  type == PixelType::kUint16 ? expect_frames<std::uint16_t>(*reader) : expect_frames<float>(*reader);
  std::vector<float> plane(21);
  EXPECT_EQ(reader->read_truth(3, plane.data()).has_value(), truth);
  if (truth) {
    EXPECT_EQ(plane, plane_of<float>(53, 21));
  }
}

INSTANTIATE_TEST_SUITE_P(Variants, CaptureRoundTrip,
                         ::testing::Combine(::testing::Values(PixelType::kUint16, PixelType::kFloat32),
                                            ::testing::Bool(), ::testing::Values(0, 4)));

// Frames of 20x9 pixels, 3x2 motion blocks, with all data that goes with each frame.
const CaptureInfo kMoving = small_info(PixelType::kUint16, {20, 9});
const std::vector<std::uint16_t> kPlane(20 * 9, 7);

// UTC steps back at frame 4, where the host's clock was set.
FrameTimes times_at(std::size_t i) {
  return {100.0 + 0.005 * static_cast<double>(i), 1.76e9 + (i < 4 ? 0.005 : -0.005) * static_cast<double>(i),
          i == 6 ? 0.2 : 0.1};
}

// Unknown motion in every other frame.
BlockMotion motion_at(std::size_t frame, std::size_t block) {
  const auto value = static_cast<float>(10 * frame + block);
  return frame % 2 == 0 ? BlockMotion{value, -value, 0.5F} : BlockMotion{};
}

void append_beside(CaptureWriter& writer, std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; ++i) {
    std::vector<BlockMotion> motion;
    for (std::size_t b = 0; b < 6; ++b) motion.push_back(motion_at(i, b));
    const FrameTimes times = times_at(i);
    ASSERT_TRUE(writer.append(0.005 * static_cast<double>(i), i, kPlane.data(), nullptr,
                              i % 2 == 0 ? motion.data() : nullptr, &times));
  }
}

void expect_beside(const std::filesystem::path& file) {
  const CaptureReader reader = *must(CaptureReader::open(file));
  ASSERT_TRUE(reader.info().has_times);
  ASSERT_TRUE(reader.info().has_motion);
  ASSERT_EQ(reader.info().frames, 30U);
  for (std::size_t i = 0; i < reader.info().frames; ++i) {
    EXPECT_EQ(reader.t_host()[i], times_at(i).host_s);
    EXPECT_EQ(reader.t_utc()[i], times_at(i).utc_s);
    std::vector<BlockMotion> motion(6);
    ASSERT_TRUE(reader.read_motion(i, motion.data()));
    for (std::size_t b = 0; b < 6; ++b) {
      ASSERT_EQ(motion[b].x, motion_at(i, b).x) << i << ' ' << b;
      ASSERT_EQ(motion[b].y, motion_at(i, b).y);
      ASSERT_EQ(motion[b].confidence, motion_at(i, b).confidence);
    }
  }
  EXPECT_EQ(std::get<double>(reader.attributes()->front().value), 0.2);
}

TEST(CaptureWriterBeside, TimesAndMotionComeBackAlsoFromAnUnfinishedFile) {
  const Scratch scratch;
  for (const bool whole : {false, true}) {
    {
      auto writer = must(CaptureWriter::create(scratch / "a.h5", kMoving,
                                               {.replace = Replace::kExisting, .motion = true, .times = true}));
      append_beside(*writer, 0, 5);
      ASSERT_TRUE(writer->commit()) << "what is worse comes later";
      append_beside(*writer, 5, 30);
      ASSERT_TRUE(!whole || writer->close());
    }
    expect_beside(scratch / (whole ? "a.h5" : "a.h5.part"));
    if (whole) continue;
    ASSERT_TRUE(recover_copy(scratch / "a.h5.part", {scratch / "b.h5"}, {}));
    expect_beside(scratch / "b.h5");
  }
}

TEST(CaptureWriterTimes, ComeWithEveryFrameOrNone) {
  const Scratch folder;
  const std::vector<std::uint16_t> plane(21);
  const FrameTimes times;
  auto without = CaptureWriter::create(folder / "a.h5", small_info());
  EXPECT_FALSE(without->append(0.0, 0, plane.data(), nullptr, nullptr, &times));
  auto with = CaptureWriter::create(folder / "b.h5", small_info(), {.times = true});
  EXPECT_FALSE(with->append(0.0, 0, plane.data()));
}

TEST(CaptureWriterMotion, IsAbsentUnlessAskedFor) {
  const Scratch scratch;
  auto writer = must(CaptureWriter::create(scratch / "a.h5", kMoving));
  std::vector<BlockMotion> motion(6);
  EXPECT_FALSE(writer->append(0.0, 0, kPlane.data(), nullptr, motion.data())) << "it was not begun with it";
  ASSERT_TRUE(writer->append(0.0, 0, kPlane.data()));
  ASSERT_TRUE(writer->close());
  const auto reader = must(CaptureReader::open(scratch / "a.h5"));
  EXPECT_FALSE(reader->info().has_motion);
  EXPECT_FALSE(reader->read_motion(0, motion.data()));
}

// --- Recordings of real cameras.

std::filesystem::path test_data() {
  const char* folder = std::getenv("BOLO_TEST_DATA");
  return folder == nullptr ? "" : folder;
}

struct Recording {
  const char* name;
  std::size_t frames;
  Geometry geometry;
  bool milliseconds;  // /t is in ms: the file opens with a warning
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

}  // namespace bolo::capture::capture_roundtrip_test
