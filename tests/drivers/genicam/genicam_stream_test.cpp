// A streaming camera: a FLIR's corrections, ranges and clock; lost packets, wrong frames, resets, disappearing cameras.
#include "drivers/genicam/connection.hpp"
#include "drivers/genicam/nodes.hpp"
#include "drivers/genicam/radiometry.hpp"
#include "drivers/genicam/settings.hpp"
#include "src/core/clock.hpp"
#include "tests/drivers/genicam/fake_camera.hpp"

namespace bolo::genicam::test::genicam_stream_test {

enum Register : std::uint32_t {
  kIrFormatAt = 0x1000,
  kNucModeAt = 0x1010,
  kNucActionAt = 0x1014,
  kNumCasesAt = 0x1020,
  kQueryCaseAt = 0x1024,
  kCurrentCaseAt = 0x1028,
  kEmissivityAt = 0x1040,
  kReflectedAt = 0x1044,
  kRAt = 0x1060,
  kBAt = 0x1064,
  kFAt = 0x1068,
  kJ0At = 0x106C,
  kJ1At = 0x1070
};

std::string float_node(const std::string& name, std::uint32_t address) {
  return "<Float Name=\"" + name + "\"><pValue>" + name + "Register</pValue></Float><FloatReg Name=\"" + name +
         "Register\"><Address>" + std::to_string(address) +
         "</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>"
         "<Endianess>BigEndian</Endianess></FloatReg>";
}

std::string command_node(const std::string& name, std::uint32_t address) {
  return "<Command Name=\"" + name + "\"><pValue>" + name + "Value</pValue><CommandValue>1</CommandValue></Command>" +
         integer_node(name + "Value", address);
}

// Measurement ranges: case n covers 200 + 100 n to 400 + 200 n K.
std::string case_nodes() {
  const auto limit = [](const std::string& name, const std::string& formula) {
    return "<SwissKnife Name=\"" + name + "\"><pVariable Name=\"N\">QueryCase</pVariable><Formula>" + formula +
           "</Formula></SwissKnife>";
  };
  return integer_node("NumCases", kNumCasesAt) + integer_node("QueryCase", kQueryCaseAt) +
         integer_node("CurrentCase", kCurrentCaseAt) + limit("QueryCaseLowLimit", "200.0 + 100.0 * N") +
         limit("QueryCaseHighLimit", "400.0 + 200.0 * N");
}

std::string flir_xml() {
  static const std::string kFile = write_xml(
      enumeration_node("IRFormat", kIrFormatAt, {"Radiometric", "TemperatureLinear100mK", "TemperatureLinear10mK"}) +
      enumeration_node("NUCMode", kNucModeAt, {"Off", "Automatic"}) + command_node("NUCAction", kNucActionAt) +
      case_nodes() + float_node("ObjectEmissivity", kEmissivityAt) + float_node("ReflectedTemperature", kReflectedAt) +
      integer_node("R", kRAt) + integer_node("J0", kJ0At) + float_node("B", kBAt) + float_node("F", kFAt) +
      float_node("J1", kJ1At));
  return kFile;
}

class GenicamFlirTest : public CameraTest {
 protected:
  void SetUp() override {
    CameraTest::SetUp();
    if (!IsSkipped()) fake_ = make_fake("127.0.0.1");
  }

  static std::unique_ptr<FakeCamera> make_fake(const std::string& address, const std::string& serial = {}) {
    auto fake = std::make_unique<FakeCamera>(FakeOptions{.address = address, .xml = flir_xml(), .serial = serial});
    fake->write_register(kNumCasesAt, 3);
    fake->write_register(kRAt, 17000);
    fake->write_register(kJ0At, 4000);
    fake->write_register(kBAt, std::bit_cast<std::uint32_t>(1428.0F));
    fake->write_register(kFAt, std::bit_cast<std::uint32_t>(1.0F));
    fake->write_register(kJ1At, std::bit_cast<std::uint32_t>(60.0F));
    return fake;
  }

  bool noticed(const std::string& part) {
    for (pipeline::Notice& notice : source_->take_notices()) notices_.push_back(std::move(notice.text));
    return std::any_of(notices_.begin(), notices_.end(),
                       [&](const std::string& text) { return text.find(part) != std::string::npos; });
  }
  float read_float(std::uint32_t address) const { return std::bit_cast<float>(fake_->read_register(address)); }

  std::unique_ptr<FakeCamera> fake_;
  std::vector<std::string> notices_;
};

TEST_F(GenicamFlirTest, CorrectsOnDemandAndKeepsThoseFramesApart) {
  start_and_take(20, with({.nuc = {.policy = NucPolicy::kManual, .hold_ms = 150}}));
  EXPECT_EQ(fake_->read_register(kNucModeAt), 0U);
  EXPECT_EQ(fake_->read_register(kNucActionAt), 0U) << "not asked for yet";
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  must(source_->trigger_nuc());
  EXPECT_EQ(fake_->read_register(kNucActionAt), 1U);
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  ASSERT_TRUE(wait_for_more(20));
  EXPECT_EQ(source_->status()->corrections.value(), 1U);
  EXPECT_NE(source_->status()->correction_ns.value(), 0);
  EXPECT_TRUE(noticed("NUC (asked for)"));
  EXPECT_EQ(source_->status()->stalls.value(), 0U);
  source_->stop();

  int flagged = 0;
  int changes = 0;
  const auto& frames = collector_->finish();
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const bool nuc = (frames[i].meta.flags & kFlagNuc) != 0;
    const bool nuc_before = (frames[i - 1].meta.flags & kFlagNuc) != 0;
    flagged += nuc ? 1 : 0;
    changes += nuc != nuc_before ? 1 : 0;
    EXPECT_EQ(frames[i].restart_window, nuc != nuc_before) << i;
  }
  EXPECT_GT(flagged, 0);
  EXPECT_EQ(changes, 2) << "one run of frames";
}

TEST_F(GenicamFlirTest, CorrectsByTheClock) {
  start(with({.nuc = {.policy = NucPolicy::kTimed, .interval_s = 0.2, .hold_ms = 50}}));
  EXPECT_TRUE(eventually([&] { return source_->status()->corrections.value() >= 3; }));
}

TEST_F(GenicamFlirTest, CorrectsWhenNothingMoves) {
  start_and_take(60, with({.nuc = {.policy = NucPolicy::kStill, .interval_s = 0.2, .still_s = 0.3, .hold_ms = 50}}));
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_EQ(source_->status()->corrections.value(), 0U) << "the picture moves";
  EXPECT_EQ(fake_->read_register(kNucActionAt), 0U);
  fake_->stand_still();
  EXPECT_TRUE(eventually([&] { return source_->status()->corrections.value() >= 2; }));
  EXPECT_EQ(fake_->read_register(kNucActionAt), 1U);
  EXPECT_TRUE(noticed("NUC (nothing moves)"));
}

TEST_F(GenicamFlirTest, DoesNotTakeARefusalForAMissingFeature) {
  const auto connection = must(connect(options_for(), false));
  fake_->kill();
  Nodes nodes(connection->device.get());
  std::vector<std::string> warnings;
  configure_nuc(nodes, {.policy = NucPolicy::kTimed}, warnings);
  EXPECT_FALSE(nodes.ok());
  EXPECT_TRUE(warnings.empty()) << warnings.front();
}

TEST_F(GenicamFlirTest, LeavesCorrectionsToTheCamera) {
  start_and_take(20);
  EXPECT_EQ(fake_->read_register(kNucModeAt), 1U);
  EXPECT_EQ(source_->status()->corrections.value(), 0U);
  source_->stop();
  EXPECT_FALSE(source_->trigger_nuc()) << "stopped";
}

TEST_F(GenicamFlirTest, ChoosesTheNarrowestRangeThatHoldsWhatIsAskedFor) {
  start(with({.range_low_k = 320.0, .range_high_k = 560.0}));
  EXPECT_EQ(fake_->read_register(kCurrentCaseAt), 1U) << "300 to 600 K, not 400 to 800 K";
  EXPECT_TRUE(noticed("the camera measures 300 to 600 K; it offers: 200 to 400 K, 300 to 600 K, 400 to 800 K"));
  source_->stop();
  expect_not_opened(with({.range_low_k = 320.0, .range_high_k = 900.0}), {"it offers: 200 to 400 K"});
}

TEST_F(GenicamFlirTest, SetsOnlyTheObjectParametersThatItHas) {
  fake_->write_register(kEmissivityAt, std::bit_cast<std::uint32_t>(0.95F));
  open(with({.object = {.reflected_k = 281.5, .humidity = 0.4}}));
  EXPECT_EQ(read_float(kEmissivityAt), 1.0F) << "unity unless told otherwise";
  EXPECT_EQ(read_float(kReflectedAt), 281.5F);
  EXPECT_TRUE(warned("no RelativeHumidity"));
}

TEST_F(GenicamFlirTest, RadiometricCountsArriveAsKelvin) {
  start_and_take(3, with({.ir_format = IrFormat::kRadiometric}));
  EXPECT_EQ(fake_->read_register(kIrFormatAt), 0U);
  EXPECT_EQ(info_.format.scale, (LinearScale{Unit::kKelvin, 0.01, 0.0}));
  EXPECT_TRUE(noticed("R = 17000, B = 1428, F = 1, J0 = 4000, J1 = 60"));
  source_->stop();
  const Planck planck{17000.0, 1428.0, 1.0, 4000.0, 60.0};
  for (const Received& frame : collector_->finish()) {
    const double kelvin = kelvin_of(pixel(number_of(frame), 5, 7), planck, {});
    EXPECT_NEAR(frame.pixels[7 * kWidth + 5] * 0.01, std::min(kelvin, 655.35), 0.006);
  }
}

TEST_F(GenicamFlirTest, TellsAPictureThatIsNoTemperature) {
  // The fake's counts are arbitrary: the middle is 3,277 K.
  start(with({.ir_format = IrFormat::kTemperatureLinear100mK}));
  EXPECT_TRUE(eventually([&] { return noticed("no temperature of a scene"); }));
}

TEST_F(GenicamFlirTest, MapsTheCamerasTimeToTheHosts) {
  start_and_take(60);
  source_->stop();
  const auto& frames = collector_->finish();
  for (const Received& frame : frames) {
    EXPECT_LE(frame.meta.host_ns, frame.meta.receive_ns);
    EXPECT_NE(frame.meta.host_ns, 0);
  }
  EXPECT_NE(source_->status()->clock_offset_ns.value(), 0);
}

TEST_F(GenicamFlirTest, MeasuresThePeriodByTheCamerasClock) {
  start(with({.true_rate_hz = 185.0}));
  EXPECT_NEAR(info_.format.frame_period_s, 1.0 / 185.0, 1e-9);
  EXPECT_TRUE(eventually([&] { return source_->status()->measured_period_s.value() > 0.0; }));
  EXPECT_NEAR(source_->status()->measured_period_s.value(), 0.005, 1e-6);
}

// Also if another camera has taken its address meanwhile.
TEST_F(GenicamFlirTest, FindsALostCameraUnderAnotherAddress) {
  for (const bool taken : {false, true}) {
    source_ = nullptr;
    fake_ = nullptr;
    fake_ = make_fake("127.0.0.1", "WANDERER");
    start_and_take(10);
    fake_ = nullptr;
    const auto stranger = taken ? make_fake("127.0.0.1", "STRANGER") : nullptr;
    fake_ = make_fake("127.0.0.2", "WANDERER");
    ASSERT_TRUE(eventually([&] { return source_->reconnects() >= 1; }));
    EXPECT_TRUE(wait_for_more(10));
    EXPECT_TRUE(noticed("found again at 127.0.0.2, before at 127.0.0.1"));
    EXPECT_EQ(taken ? stranger->sent() : 0U, 0U);
    source_->stop();
    notices_.clear();
  }
}

TEST_F(GenicamFlirTest, DoesNotTakeAnotherCameraForTheLostOne) {
  start_and_take(10, with({.nuc = {.policy = NucPolicy::kManual}, .object = {.emissivity = 0.5}}));
  fake_ = nullptr;
  fake_ = make_fake("127.0.0.1", "STRANGER");
  fake_->write_register(kNucModeAt, 1);
  fake_->write_register(kIrFormatAt, 0);
  fake_->write_register(kEmissivityAt, std::bit_cast<std::uint32_t>(0.75F));
  ASSERT_TRUE(eventually([&] { return noticed("has the serial number 'STRANGER', not 'GV01'"); }));
  EXPECT_EQ(source_->reconnects(), 0U);
  source_->stop();
  EXPECT_EQ(fake_->read_register(kNucModeAt), 1U) << "it was not configured";
  EXPECT_EQ(fake_->read_register(kIrFormatAt), 0U);
  EXPECT_EQ(read_float(kEmissivityAt), 0.75F);
}

using pipeline::LostCause;

class GenicamLossTest : public CameraTest {
 protected:
  std::uint64_t lost_by(LostCause cause) const {
    return source_->status()->lost[static_cast<std::size_t>(cause)].value();
  }
  // Starts of the notices; "!" marks warnings. Notices about the host's limits are left out.
  std::vector<std::string> changes() {
    std::vector<std::string> texts;
    for (const pipeline::Notice& notice : source_->take_notices()) {
      for (const std::string kind : {"camera stalled", "camera lost (no answer)", "camera lost (control lost)",
                                     "camera lost (stalled)", "camera opened again", "frames arrive again"}) {
        if (notice.text.rfind(kind, 0) == 0) texts.push_back((notice.warning ? "!" : "") + kind);
      }
    }
    return texts;
  }
};

TEST_F(GenicamLossTest, CountsEachFrameOfALossyLinkOnce) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.packet_size = 576}));  // several packets a frame: leaders, data and trailers get lost
  fake.set_lost_packets(0.05);
  ASSERT_TRUE(eventually([&] { return fake.sent() >= 300; }));
  fake.set_lost_packets(0.0);
  ASSERT_TRUE(eventually([&] { return collector_->count() + lost(LossCause::kIncomplete) >= 300; }));
  source_->stop();

  const auto& frames = collector_->finish();
  const std::uint64_t span = frames.back().meta.frame_id - frames.front().meta.frame_id + 1;
  EXPECT_EQ(frames.front().meta.frame_id, kFirstId);
  EXPECT_EQ(span, frames.size() + collector_->inlet().losses().total());
  EXPECT_GT(lost(LossCause::kIncomplete), 20U);
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 0U);
  EXPECT_EQ(lost(LossCause::kDriver), 0U);
  EXPECT_GE(source_->status()->missing_packets.value(), lost(LossCause::kIncomplete));
  for (const Received& frame : frames) {
    const std::uint64_t n = number_of(frame);
    ASSERT_EQ(frame.pixels[0], pixel(n, 0, 0));
    ASSERT_EQ(frame.pixels.back(), pixel(n, kWidth - 1, kHeight - 1));
  }
}

TEST_F(GenicamLossTest, StartsANewWindowWhenTheCounterIsReset) {
  add_camera({.id = [](std::uint64_t n) { return static_cast<std::uint16_t>(n < 20 ? 30000 + n : n - 19); }});
  start_and_take(60);
  source_->stop();
  const auto& frames = collector_->finish();
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_GT(frames[i].meta.frame_id, frames[i - 1].meta.frame_id);
    EXPECT_EQ(frames[i].restart_window, number_of(frames[i - 1]) < 20 && number_of(frames[i]) >= 20) << i;
  }
  EXPECT_EQ(frames.back().meta.frame_id - frames.front().meta.frame_id + 1,
            frames.size() + collector_->inlet().losses().total());
}

TEST_F(GenicamLossTest, CountsFramesThatThePipelineCannotTake) {
  add_camera();
  open();
  pipeline::FrameInlet inlet(info_.format, 1, 4);  // never emptied
  ASSERT_TRUE(source_->start(inlet));
  const rt::LossCounters& losses = inlet.losses();
  EXPECT_TRUE(
      eventually([&] { return losses.value(LossCause::kPoolExhausted) + losses.value(LossCause::kQueueFull) >= 10; }));
  source_->stop();
  EXPECT_EQ(inlet.received(), 1U + 4U + 2U);  // all slots: window, queue, one on each side of the queue
}

TEST_F(GenicamLossTest, RefusesFramesOfAnotherSize) {
  FakeCamera& fake = add_camera();
  open();
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_HEIGHT, kHeight / 2);
  collect();
  ASSERT_TRUE(eventually([&] { return lost(LossCause::kBadFrame) >= 10; }));
  source_->stop();
  EXPECT_EQ(collector_->count(), 0U);
}

TEST_F(GenicamLossTest, ReopensACameraThatComesBack) {
  FakeCamera& fake = add_camera();
  start_and_take(20, with({.reconnect_after_ms = 300}));
  fake.kill();
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kLost; }));
  EXPECT_EQ(lost_by(LostCause::kNoAnswer), 1U);
  EXPECT_EQ(source_->status()->stalls.value(), 1U) << "the silence was noticed before the absence";
  const std::uint64_t before = collector_->count();
  add_camera();
  ASSERT_TRUE(eventually([&] { return source_->reconnects() == 1; }));
  ASSERT_TRUE(collector_->wait_for(before + 20));
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_GT(source_->status()->outage_frames.value(), 20U) << "it was away for a fifth of a second at least";
  EXPECT_EQ(changes(),
            (std::vector<std::string>{"!camera stalled", "!camera lost (no answer)", "camera opened again"}));
  source_->stop();
  const auto& frames = collector_->finish();
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_GT(frames[i].meta.frame_id, frames[i - 1].meta.frame_id);
    EXPECT_EQ(frames[i].restart_window, i == before) << i;
  }
}

// Rebooted within the watchdog timeout: it answers, but has lost its state.
TEST_F(GenicamLossTest, ReopensACameraThatRebootedAtOnce) {
  FakeCamera& fake = add_camera();
  start_and_take(20);
  fake.kill();
  add_camera();
  ASSERT_TRUE(eventually([&] { return source_->reconnects() == 1; }));
  EXPECT_TRUE(wait_for_more(20));
  EXPECT_EQ(lost_by(LostCause::kControlLost) + lost_by(LostCause::kNoAnswer), 1U);
}

// Set-up is done, and the daemon is about to start the acquisition.
TEST_F(GenicamLossTest, StartsWithACameraThatRebootedSinceItWasOpened) {
  FakeCamera& fake = add_camera();
  open();
  fake.kill();
  add_camera();
  ASSERT_NO_FATAL_FAILURE(collect());
  EXPECT_TRUE(collector_->wait_for(20));
  EXPECT_EQ(source_->reconnects(), 1U);
  EXPECT_EQ(lost_by(LostCause::kControlLost), 1U);
}

constexpr std::int64_t kSoon_ns = 2'000'000'000;  // Aravis asks a silent camera for seconds, at every call

TEST_F(GenicamLossTest, StartsWithoutTheCameraThatWentAwaySinceItWasOpened) {
  FakeCamera& fake = add_camera();
  open();
  fake.kill();
  const std::int64_t began_ns = monotonic_ns();
  ASSERT_NO_FATAL_FAILURE(collect());
  EXPECT_LT(monotonic_ns() - began_ns, kSoon_ns) << "no signal ends bolod meanwhile";
  EXPECT_EQ(source_->state(), SourceState::kLost);
  EXPECT_EQ(lost_by(LostCause::kNoAnswer), 1U);
  add_camera();
  ASSERT_TRUE(collector_->wait_for(20));
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_LT(source_->status()->outage_frames.value(), 10'000U) << "it was away for seconds";
  EXPECT_EQ(changes(), (std::vector<std::string>{"!camera lost (no answer)", "camera opened again"}));
}

TEST_F(GenicamLossTest, DoesNotStartWithoutTheCameraThatIsNotToBeReopened) {
  FakeCamera& fake = add_camera();
  open(with({.reconnect_after_ms = 0}));
  fake.kill();
  Collector collector(info_.format);
  const std::int64_t began_ns = monotonic_ns();
  expect_error(source_->start(collector.inlet()), {"camera 127.0.0.1"});
  EXPECT_LT(monotonic_ns() - began_ns, kSoon_ns);
}

TEST_F(GenicamLossTest, ReopensACameraThatAnswersButSendsNothing) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.reconnect_after_ms = 400}));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);
  ASSERT_TRUE(eventually([&] { return source_->reconnects() == 1; }));
  EXPECT_TRUE(wait_for_more(10)) << "it was told to send again";
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_EQ(changes(), (std::vector<std::string>{"!camera stalled", "!camera lost (stalled)", "camera opened again"}));
}

TEST_F(GenicamLossTest, TellsThatFramesComeAgainAfterAStall) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.reconnect_after_ms = 60'000}));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kStalled; }));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 1);
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_EQ(changes(), (std::vector<std::string>{"!camera stalled", "frames arrive again"}));
  EXPECT_EQ(source_->reconnects(), 0U);
}

TEST_F(GenicamLossTest, SaysThatItStallsWithoutReopeningWhenToldSo) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.reconnect_after_ms = 0}));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);  // connected, but silent
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStalled; }));
  EXPECT_EQ(source_->reconnects(), 0U);
}

TEST_F(GenicamLossTest, TakesControlBackWhenItWasTakenAway) {
  FakeCamera& fake = add_camera();
  start_and_take(10);
  fake.take_control_away();
  ASSERT_TRUE(eventually([&] { return source_->reconnects() >= 1; }));
  EXPECT_TRUE(wait_for_more(10));
  EXPECT_EQ(lost_by(LostCause::kControlLost), 1U);
}

TEST_F(GenicamLossTest, StopsInBoundedTimeWhenTheCameraIsGone) {
  FakeCamera& fake = add_camera();
  start_and_take(10);
  fake.kill();
  const std::int64_t before_ns = monotonic_ns();
  source_->stop();
  EXPECT_LT(monotonic_ns() - before_ns, 2'500'000'000) << "the limit is 0.8 s";
  const std::uint64_t received = collector_->inlet().received();
  source_.reset();
  EXPECT_EQ(collector_->inlet().received(), received);
}

}  // namespace bolo::genicam::test::genicam_stream_test
