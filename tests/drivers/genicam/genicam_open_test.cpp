// GenicamSource::open(): finding the camera, and agreeing with it.
#include <gtest/gtest.h>

#include "tests/drivers/genicam/fake_camera.hpp"
#include "tests/drivers/genicam/swapping_relay.hpp"

namespace bolo::genicam::test {
namespace {

class GenicamOpenTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  }
};

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

bool any_contains(const std::vector<std::string>& texts, const std::string& part) {
  for (const std::string& text : texts) {
    if (contains(text, part)) return true;
  }
  return false;
}

constexpr std::uint32_t kIrFormatAt = 0x1000;
constexpr std::uint32_t kIrWindowingAt = 0x1004;
constexpr std::uint32_t kIrFrameRateAt = 0x1008;
constexpr std::uint32_t kResetAt = 0x100C;

// The nodes of a FLIR A6xx that the driver uses.
std::string flir_nodes() {
  return enumeration_node("IRFormat", kIrFormatAt, {"Radiometric", "TemperatureLinear100mK", "TemperatureLinear10mK"}) +
         enumeration_node("IRWindowing", kIrWindowingAt, {"Off", "Half", "Quarter"}) +
         enumeration_node("IRFrameRate", kIrFrameRateAt, {"Rate50Hz", "Rate25Hz", "Rate12Hz", "Rate6Hz", "Rate3Hz"}) +
         "<Command Name=\"GevTimestampControlReset\"><pValue>ResetRegister</pValue><CommandValue>2</CommandValue>"
         "</Command>" +
         integer_node("Reset", kResetAt);
}

TEST_F(GenicamOpenTest, SaysWhatWillCome) {
  FakeCamera fake;
  GenicamSource source(options_for());
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(info->format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(info->format.type, PixelType::kUint16);
  EXPECT_NEAR(info->format.frame_period_s, 0.005, 1e-9);
  EXPECT_EQ(info->camera_model, "Fake");
  EXPECT_EQ(info->camera_serial, "GV01");
  EXPECT_TRUE(any_contains(source.warnings(), "no IRFormat")) << "the scale could not be checked";
}

TEST_F(GenicamOpenTest, LeavesSizeAndRateOfTheCameraWhenNotAsked) {
  FakeCamera fake;
  CameraOptions options;
  options.address = "127.0.0.1";
  options.metadata_rows = 2;
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(info->format.geometry, (Geometry{512, 510}));
  EXPECT_NEAR(info->format.frame_period_s, 0.04, 1e-9);
}

TEST_F(GenicamOpenTest, SaysWhichAddressDoesNotAnswer) {
  GenicamSource source(options_for("127.0.0.9"));
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "127.0.0.9")) << info.error().message;
}

TEST_F(GenicamOpenTest, SaysThatThereIsNoRoute) {
  GenicamSource source(options_for("192.0.2.1"));  // this network has a loopback only
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "no route")) << info.error().message;
}

TEST_F(GenicamOpenTest, SaysThatAnotherProgramHasTheCamera) {
  FakeCamera fake;
  GenicamSource holder(options_for());
  ASSERT_TRUE(holder.open());
  GenicamSource source(options_for());
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "another program")) << info.error().message;
}

TEST_F(GenicamOpenTest, SaysThatTheCameraHasNoMono16) {
  FakeCamera fake({.address = "127.0.0.1",
                   .xml = write_xml("",
                                    [](std::string& xml) {
                                      const auto entry = xml.find("<EnumEntry Name=\"Mono16\"");
                                      xml.erase(entry, xml.find("</EnumEntry>", entry) + 12 - entry);
                                    }),
                   .big_endian = false,
                   .id = {}});
  GenicamSource source(options_for());
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "Mono16")) << info.error().message;
  EXPECT_TRUE(contains(info.error().message, "Mono8")) << info.error().message;
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
}

TEST_F(GenicamOpenTest, RefusesASizeThatTheCameraRounds) {
  FakeCamera fake(
      {.address = "127.0.0.1",
       .xml = write_xml("<IntConverter Name=\"Width16\"><FormulaTo>(FROM &gt;&gt; 4) &lt;&lt; 4</FormulaTo>"
                        "<FormulaFrom>TO</FormulaFrom><pValue>WidthRegister</pValue></IntConverter>",
                        [](std::string& xml) { replace(xml, "<pValue>WidthRegister<", "<pValue>Width16<"); }),
       .big_endian = false,
       .id = {}});
  CameraOptions options = options_for();
  options.width = 100;
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "Width = 100")) << info.error().message;
  EXPECT_TRUE(contains(info.error().message, "96")) << info.error().message;
}

// A camera that derives its width itself must not be written to when it fits.
TEST_F(GenicamOpenTest, AcceptsAFixedSizeThatFits) {
  FakeCamera fake(
      {.address = "127.0.0.1",
       .xml = write_xml("<IntConverter Name=\"WidthFixed\"><FormulaTo>512</FormulaTo>"
                        "<FormulaFrom>TO</FormulaFrom><pValue>WidthRegister</pValue></IntConverter>",
                        [](std::string& xml) { replace(xml, "<pValue>WidthRegister<", "<pValue>WidthFixed<"); }),
       .big_endian = false,
       .id = {}});
  CameraOptions options = options_for();
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_TRUE(contains(info.error().message, "512")) << info.error().message;
  options.width = 512;
  GenicamSource fitting(options);
  const auto fits = fitting.open();
  EXPECT_TRUE(fits) << fits.error().message;
}

TEST_F(GenicamOpenTest, RefusesPacketsThatTheLinkCannotCarry) {
  FakeCamera fake;
  CameraOptions options = options_for();
  options.packet_size = 70000;
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "MTU")) << info.error().message;
}

TEST_F(GenicamOpenTest, RefusesPacketsTooSmallForAFrame) {
  FakeCamera fake;
  for (const int size : {1, 36, 60, 575}) {
    CameraOptions options = options_for();
    options.packet_size = size;
    GenicamSource source(options);
    const auto info = source.open();
    ASSERT_FALSE(info) << size;
    EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
    EXPECT_TRUE(contains(info.error().message, "576 or more")) << info.error().message;
  }
}

TEST_F(GenicamOpenTest, WarnsWhenTheRateIsAnother) {
  FakeCamera fake({.address = "127.0.0.1",
                   .xml = write_xml("", [](std::string& xml) { replace(xml, "(1000000 / FROM)", "(2000000 / FROM)"); }),
                   .big_endian = false,
                   .id = {}});
  GenicamSource source(options_for());
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_NEAR(info->format.frame_period_s, 0.01, 1e-9);
  EXPECT_TRUE(any_contains(source.warnings(), "asked for 200 Hz, the camera runs at 100 Hz"));
}

TEST_F(GenicamOpenTest, ConfiguresAFlir) {
  FakeCamera fake({.address = "127.0.0.1", .xml = write_xml(flir_nodes()), .big_endian = false, .id = {}});
  CameraOptions options = options_for();
  options.width = 640;
  options.height = 120;
  GenicamSource source(options);
  // The fake's sensor has 2048 rows: 120 of them need the quarter.
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(fake.read_register(kIrFormatAt), 2U);
  EXPECT_EQ(fake.read_register(kIrWindowingAt), 2U);
  EXPECT_EQ(fake.read_register(kIrFrameRateAt), 0U);
  EXPECT_EQ(info->format.scale, (LinearScale{Unit::kKelvin, 0.01, 0.0}));
  EXPECT_NEAR(info->format.frame_period_s, 0.005, 1e-9);

  Collector collector(info->format);
  ASSERT_TRUE(source.start(collector.inlet()));
  ASSERT_TRUE(collector.wait_for(3));
  source.stop();
  EXPECT_EQ(fake.read_register(kResetAt), 2U) << "GevTimestampControlReset";
}

TEST_F(GenicamOpenTest, ComesBackWhenANewWindowingDropsTheConnection) {
  FakeCamera fake({.address = "127.0.0.1", .xml = write_xml(flir_nodes()), .big_endian = false, .id = {}});
  std::thread camera([&] {
    EXPECT_TRUE(eventually([&] { return fake.read_register(kIrWindowingAt) == 2; }));
    fake.take_control_away();
  });
  CameraOptions options = options_for();
  options.windowing_watch_ms = 5000;  // longer than the camera takes to drop
  GenicamSource source(options);
  const auto info = source.open();
  camera.join();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(fake.read_register(kIrFormatAt), 2U) << "the rest was configured after coming back";
  Collector collector(info->format);
  ASSERT_TRUE(source.start(collector.inlet()));
  EXPECT_TRUE(collector.wait_for(3));
  source.stop();
}

TEST_F(GenicamOpenTest, ReadsTheScaleOfEachIrFormat) {
  FakeCamera fake({.address = "127.0.0.1", .xml = write_xml(flir_nodes()), .big_endian = false, .id = {}});
  const std::vector<std::pair<IrFormat, LinearScale>> formats{
      {IrFormat::kRadiometric, {Unit::kCount, 1.0, 0.0}},
      {IrFormat::kTemperatureLinear100mK, {Unit::kKelvin, 0.1, 0.0}},
      {IrFormat::kTemperatureLinear10mK, {Unit::kKelvin, 0.01, 0.0}}};
  for (std::uint32_t value = 0; value < formats.size(); ++value) {
    CameraOptions options = options_for();
    options.ir_format = formats[value].first;
    GenicamSource source(options);
    const auto info = source.open();
    ASSERT_TRUE(info) << info.error().message;
    EXPECT_EQ(info->format.scale, formats[value].second);
    EXPECT_EQ(fake.read_register(kIrFormatAt), value);
  }
  CameraOptions options = options_for();
  options.ir_format = IrFormat::kLeave;
  fake.write_register(kIrFormatAt, 1);
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(info->format.scale, (LinearScale{Unit::kKelvin, 0.1, 0.0}));
}

TEST_F(GenicamOpenTest, SaysWhatRateAFlirRunsAtInstead) {
  FakeCamera fake({.address = "127.0.0.1", .xml = write_xml(flir_nodes()), .big_endian = false, .id = {}});
  CameraOptions options = options_for();
  options.height = 2048;  // the whole sensor: 50 Hz at most
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_NEAR(info->format.frame_period_s, 0.02, 1e-9);
  EXPECT_TRUE(any_contains(source.warnings(), "asked for 200 Hz, the camera runs at 50 Hz"));
}

// A camera that sends its registers in another byte order than its description says, when they are read as memory.
TEST_F(GenicamOpenTest, WorksRoundSwappedRegisters) {
  FakeCamera fake(
      {.address = "127.0.0.1",
       .xml = write_xml("",
                        [](std::string& xml) { replace(xml, "SchemaMinorVersion=\"0\"", "SchemaMinorVersion=\"1\""); }),
       .big_endian = false,
       .id = {}});
  const SwappingRelay relay("127.0.0.2", "127.0.0.1");
  GenicamSource source(options_for("127.0.0.2"));
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_GT(relay.swapped(), 0) << "the detour was not needed";
  EXPECT_EQ(info->format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(fake.read_register(ARV_FAKE_CAMERA_REGISTER_WIDTH), static_cast<std::uint32_t>(kWidth));
}

TEST_F(GenicamOpenTest, ListsTheCamerasWhenThereAreSeveral) {
  FakeCamera one;
  FakeCamera two({.address = "127.0.0.2", .xml = {}, .big_endian = false, .id = {}});
  CameraOptions options = options_for("");
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "several cameras")) << info.error().message;
  EXPECT_TRUE(contains(info.error().message, "127.0.0.2")) << info.error().message;
}

TEST_F(GenicamOpenTest, FindsTheOnlyCamera) {
  FakeCamera fake;
  GenicamSource source(options_for(""));
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(info->camera_serial, "GV01");
  FakeCamera another({.address = "127.0.0.2", .xml = {}, .big_endian = false, .id = {}});
  Collector collector(info->format);
  ASSERT_TRUE(source.start(collector.inlet()));
  source.stop();
  const Status again = source.start(collector.inlet());
  EXPECT_TRUE(again) << "it was known by then which camera is meant: " << again.error().message;
  source.stop();
}

TEST_F(GenicamOpenTest, SaysThatNoCameraAnswersAtAll) {
  GenicamSource source(options_for(""));
  const auto info = source.open();
  ASSERT_FALSE(info);
  EXPECT_EQ(info.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(contains(info.error().message, "no camera answers")) << info.error().message;
}

}  // namespace
}  // namespace bolo::genicam::test
