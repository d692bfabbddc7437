// GenicamSource::open(): finding the camera, and agreeing with it.
#include <gtest/gtest.h>

#include "tests/drivers/genicam/fake_camera.hpp"
#include "tests/drivers/genicam/swapping_relay.hpp"

namespace bolo::genicam::test::genicam_open_test {
namespace {

using GenicamOpenTest = CameraTest;

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
  add_camera();
  open();
  EXPECT_EQ(info_.format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(info_.format.type, PixelType::kUint16);
  EXPECT_NEAR(info_.format.frame_period_s, 0.005, 1e-9);
  EXPECT_EQ(info_.camera_model, "Fake");
  EXPECT_EQ(info_.camera_serial, "GV01");
  EXPECT_TRUE(warned("no IRFormat")) << "the scale could not be checked";
}

TEST_F(GenicamOpenTest, LeavesSizeAndRateOfTheCameraWhenNotAsked) {
  add_camera();
  CameraOptions options;
  options.address = "127.0.0.1";
  options.metadata_rows = 2;
  open(options);
  EXPECT_EQ(info_.format.geometry, (Geometry{512, 510}));
  EXPECT_NEAR(info_.format.frame_period_s, 0.04, 1e-9);
}

TEST_F(GenicamOpenTest, SaysWhichAddressDoesNotAnswer) { expect_not_opened(options_for("127.0.0.9"), {"127.0.0.9"}); }

TEST_F(GenicamOpenTest, SaysThatThereIsNoRoute) {
  expect_not_opened(options_for("192.0.2.1"), {"no route"});  // this network has a loopback only
}

TEST_F(GenicamOpenTest, SaysThatAnotherProgramHasTheCamera) {
  add_camera();
  GenicamSource holder(options_for());
  ASSERT_TRUE(holder.open());
  expect_not_opened(options_for(), {"another program"});
}

TEST_F(GenicamOpenTest, SaysThatTheCameraHasNoMono16) {
  add_camera({.xml = write_xml("", [](std::string& xml) {
                const auto entry = xml.find("<EnumEntry Name=\"Mono16\"");
                xml.erase(entry, xml.find("</EnumEntry>", entry) + 12 - entry);
              })});
  expect_not_opened(options_for(), {"Mono16", "Mono8"});
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
}

TEST_F(GenicamOpenTest, RefusesASizeThatTheCameraRounds) {
  add_camera({.xml = write_xml("<IntConverter Name=\"Width16\"><FormulaTo>(FROM &gt;&gt; 4) &lt;&lt; 4</FormulaTo>"
                               "<FormulaFrom>TO</FormulaFrom><pValue>WidthRegister</pValue></IntConverter>",
                               [](std::string& xml) { replace(xml, "<pValue>WidthRegister<", "<pValue>Width16<"); })});
  CameraOptions options = options_for();
  options.width = 100;
  expect_not_opened(options, {"Width = 100", "96"});
}

// A camera that derives its width itself must not be written to when it fits.
TEST_F(GenicamOpenTest, AcceptsAFixedSizeThatFits) {
  add_camera(
      {.xml = write_xml("<IntConverter Name=\"WidthFixed\"><FormulaTo>512</FormulaTo>"
                        "<FormulaFrom>TO</FormulaFrom><pValue>WidthRegister</pValue></IntConverter>",
                        [](std::string& xml) { replace(xml, "<pValue>WidthRegister<", "<pValue>WidthFixed<"); })});
  CameraOptions options = options_for();
  expect_not_opened(options, {"512"});
  options.width = 512;
  open(options);
}

TEST_F(GenicamOpenTest, RefusesPacketsThatTheLinkCannotCarry) {
  add_camera();
  CameraOptions options = options_for();
  options.packet_size = 70000;
  expect_not_opened(options, {"MTU"});
}

TEST_F(GenicamOpenTest, RefusesPacketsTooSmallForAFrame) {
  add_camera();
  for (const int size : {1, 36, 60, 575}) {
    CameraOptions options = options_for();
    options.packet_size = size;
    expect_not_opened(options, {"576 or more"});
  }
}

TEST_F(GenicamOpenTest, WarnsWhenTheRateIsAnother) {
  add_camera({.xml = write_xml("", [](std::string& xml) { replace(xml, "(1000000 / FROM)", "(2000000 / FROM)"); })});
  open();
  EXPECT_NEAR(info_.format.frame_period_s, 0.01, 1e-9);
  EXPECT_TRUE(warned("asked for 200 Hz, the camera runs at 100 Hz"));
}

TEST_F(GenicamOpenTest, ConfiguresAFlir) {
  FakeCamera& fake = add_camera({.xml = write_xml(flir_nodes())});
  CameraOptions options = options_for();
  options.width = 640;
  options.height = 120;
  // The fake's sensor has 2048 rows: 120 of them need the quarter.
  open(options);
  EXPECT_EQ(fake.read_register(kIrFormatAt), 2U);
  EXPECT_EQ(fake.read_register(kIrWindowingAt), 2U);
  EXPECT_EQ(fake.read_register(kIrFrameRateAt), 0U);
  EXPECT_EQ(info_.format.scale, (LinearScale{Unit::kKelvin, 0.01, 0.0}));
  EXPECT_NEAR(info_.format.frame_period_s, 0.005, 1e-9);

  collect();
  ASSERT_TRUE(collector_->wait_for(3));
  source_->stop();
  EXPECT_EQ(fake.read_register(kResetAt), 2U) << "GevTimestampControlReset";
}

TEST_F(GenicamOpenTest, ComesBackWhenANewWindowingDropsTheConnection) {
  FakeCamera& fake = add_camera({.xml = write_xml(flir_nodes())});
  std::thread camera([&] {
    EXPECT_TRUE(eventually([&] { return fake.read_register(kIrWindowingAt) == 2; }));
    fake.take_control_away();
  });
  CameraOptions options = options_for();
  options.windowing_watch_ms = 5000;  // longer than the camera takes to drop
  open(options);
  camera.join();
  ASSERT_FALSE(HasFatalFailure());
  EXPECT_EQ(fake.read_register(kIrFormatAt), 2U) << "the rest was configured after coming back";
  collect();
  EXPECT_TRUE(collector_->wait_for(3));
  source_->stop();
}

TEST_F(GenicamOpenTest, ReadsTheScaleOfEachIrFormat) {
  FakeCamera& fake = add_camera({.xml = write_xml(flir_nodes())});
  const std::vector<std::pair<IrFormat, LinearScale>> formats{
      {IrFormat::kRadiometric, {Unit::kCount, 1.0, 0.0}},
      {IrFormat::kTemperatureLinear100mK, {Unit::kKelvin, 0.1, 0.0}},
      {IrFormat::kTemperatureLinear10mK, {Unit::kKelvin, 0.01, 0.0}}};
  for (std::uint32_t value = 0; value < formats.size(); ++value) {
    CameraOptions options = options_for();
    options.ir_format = formats[value].first;
    open(options);
    EXPECT_EQ(info_.format.scale, formats[value].second);
    EXPECT_EQ(fake.read_register(kIrFormatAt), value);
  }
  CameraOptions options = options_for();
  options.ir_format = IrFormat::kLeave;
  fake.write_register(kIrFormatAt, 1);
  open(options);
  EXPECT_EQ(info_.format.scale, (LinearScale{Unit::kKelvin, 0.1, 0.0}));
}

TEST_F(GenicamOpenTest, SaysWhatRateAFlirRunsAtInstead) {
  add_camera({.xml = write_xml(flir_nodes())});
  CameraOptions options = options_for();
  options.height = 2048;  // the whole sensor: 50 Hz at most
  open(options);
  EXPECT_NEAR(info_.format.frame_period_s, 0.02, 1e-9);
  EXPECT_TRUE(warned("asked for 200 Hz, the camera runs at 50 Hz"));
}

// A camera that sends its registers in another byte order than its description says, when they are read as memory.
TEST_F(GenicamOpenTest, WorksRoundSwappedRegisters) {
  FakeCamera& fake = add_camera({.xml = write_xml("", [](std::string& xml) {
                                   replace(xml, "SchemaMinorVersion=\"0\"", "SchemaMinorVersion=\"1\"");
                                 })});
  const SwappingRelay relay("127.0.0.2", "127.0.0.1");
  open(options_for("127.0.0.2"));
  EXPECT_GT(relay.swapped(), 0) << "the detour was not needed";
  EXPECT_EQ(info_.format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(fake.read_register(ARV_FAKE_CAMERA_REGISTER_WIDTH), static_cast<std::uint32_t>(kWidth));
}

TEST_F(GenicamOpenTest, ListsTheCamerasWhenThereAreSeveral) {
  add_camera();
  add_camera({.address = "127.0.0.2"});
  CameraOptions options = options_for("");
  expect_not_opened(options, {"several cameras", "127.0.0.2"});
}

TEST_F(GenicamOpenTest, FindsTheOnlyCamera) {
  add_camera();
  open(options_for(""));
  EXPECT_EQ(info_.camera_serial, "GV01");
  add_camera({.address = "127.0.0.2"});
  collect();
  source_->stop();
  const Status again = source_->start(collector_->inlet());
  EXPECT_TRUE(again) << "it was known by then which camera is meant: " << again.error().message;
  source_->stop();
}

TEST_F(GenicamOpenTest, SaysThatNoCameraAnswersAtAll) { expect_not_opened(options_for(""), {"no camera answers"}); }

}  // namespace
}  // namespace bolo::genicam::test::genicam_open_test
