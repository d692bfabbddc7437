// GenicamSource::open(): finding and configuring the camera.
#include <poll.h>
#include <sys/resource.h>

#include "drivers/genicam/connection.hpp"
#include "drivers/genicam/network.hpp"
#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"
#include "src/core/unique_fd.hpp"
#include "tests/drivers/genicam/fake_camera.hpp"
#include "tests/no_threads.hpp"

namespace bolo::genicam::test::genicam_open_test {

using GenicamOpenTest = CameraTest;

constexpr std::uint32_t kIrFormatAt = 0x1000;
constexpr std::uint32_t kIrWindowingAt = 0x1004;
constexpr std::uint32_t kIrFrameRateAt = 0x1008;
constexpr std::uint32_t kResetAt = 0x100C;

// The FLIR A6xx nodes that the driver uses.
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
  open({.address = "127.0.0.1", .metadata_rows = 2});
  EXPECT_EQ(info_.format.geometry, (Geometry{512, 510}));
  EXPECT_NEAR(info_.format.frame_period_s, 0.04, 1e-9);
}

TEST_F(GenicamOpenTest, SaysWhoDoesNotAnswerAndThatThereIsNoRoute) {
  expect_not_opened(options_for("127.0.0.9"), {"127.0.0.9"});
  expect_not_opened(options_for("192.0.2.1"), {"no route"});  // the private network has only a loopback
  expect_not_opened(options_for(""), {"no camera answers"});
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

// A camera whose width passes through these formulas when its register is written and read.
std::string xml_of_width(const std::string& written, const std::string& read) {
  return write_xml("<IntConverter Name=\"Made\"><FormulaTo>" + written + "</FormulaTo><FormulaFrom>" + read +
                       "</FormulaFrom><pValue>WidthRegister</pValue></IntConverter>",
                   [](std::string& xml) { replace(xml, "<pValue>WidthRegister<", "<pValue>Made<"); });
}

TEST_F(GenicamOpenTest, RefusesASizeThatTheCameraRounds) {
  add_camera({.xml = xml_of_width("(FROM &gt;&gt; 4) &lt;&lt; 4", "TO")});
  expect_not_opened(with({.width = 100}), {"Width = 100", "96", "source.width = 0 takes the camera's own"});
}

// Buffers for a hundred frames are allocated: the frame size a camera claims must be limited.
TEST_F(GenicamOpenTest, RefusesFramesLargerThanAnyCameraHas) {
  add_camera({.xml = xml_of_width("400000", "400000")});
  expect_not_opened({.address = "127.0.0.1"}, {"400000x", "pixels at most are taken"});
}

TEST_F(GenicamOpenTest, RefusesPayloadsFarLargerThanTheirImage) {
  add_camera({.xml = write_xml("", [](std::string& xml) {
                replace(xml, "WIDTH * HEIGHT * ((PIXELFORMAT", "60000000 + 0 * ((PIXELFORMAT");
              })});
  open();
  pipeline::FrameInlet inlet(info_.format, 4, 4);
  expect_error(source_->start(inlet), {"60000000 bytes (PayloadSize)"});
}

// Aravis would go on with sockets it could not open, and crash.
TEST_F(GenicamOpenTest, OutlivesWantOfFileDescriptors) {
  const auto without_descriptors = [](int left) {
    const int next = dup(STDIN_FILENO);
    close(next);
    const rlimit limit{static_cast<rlim_t>(next + left), static_cast<rlim_t>(next + left)};
    setrlimit(RLIMIT_NOFILE, &limit);
    const bool found = !find_cameras().empty();
    const auto opened = GenicamSource(options_for()).open();
    const bool reported = !opened && opened.error().message.find("no file descriptors are left") != std::string::npos;
    _exit(!found && reported ? 7 : 1);
  };
  for (const int left : {0, 1, 2, 4, 8}) {
    EXPECT_EXIT(without_descriptors(left), testing::ExitedWithCode(7), "") << left;
  }
}

// GLib aborts a program when it gets no thread for Aravis.
TEST_F(GenicamOpenTest, OutlivesWantOfThreads) {
  add_camera();
  const NoThreads none;
  EXPECT_TRUE(find_cameras().empty());
  expect_error(GenicamSource(options_for()).open(), {"no thread can be started"});
}

// A width that the camera derives itself must not be written if it already fits.
TEST_F(GenicamOpenTest, AcceptsAFixedSizeThatFits) {
  add_camera({.xml = xml_of_width("512", "TO")});
  expect_not_opened(options_for(), {"512"});
  open(with({.width = 512}));
}

TEST_F(GenicamOpenTest, RefusesPacketsTooLargeForTheLinkOrTooSmallForAFrame) {
  add_camera();
  expect_not_opened(with({.packet_size = 70000}), {"MTU"});
  for (const int size : {1, 36, 60, 575}) expect_not_opened(with({.packet_size = size}), {"576 or more"});
}

TEST_F(GenicamOpenTest, WarnsWhenTheRateIsAnother) {
  add_camera({.xml = write_xml("", [](std::string& xml) { replace(xml, "(1000000 / FROM)", "(2000000 / FROM)"); })});
  open();
  EXPECT_NEAR(info_.format.frame_period_s, 0.01, 1e-9);
  EXPECT_TRUE(warned("asked for 200 Hz, the camera runs at 100 Hz"));
}

TEST_F(GenicamOpenTest, ConfiguresAFlir) {
  FakeCamera& fake = add_camera({.xml = write_xml(flir_nodes())});
  open(with({.width = 640, .height = 120}));  // of 2048 sensor rows: 120 need the quarter window
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
  open(with({.windowing_watch_ms = 5000}));  // the camera drops the connection within this time
  camera.join();
  ASSERT_FALSE(HasFatalFailure());
  EXPECT_EQ(fake.read_register(kIrFormatAt), 2U) << "the rest was configured after coming back";
  collect();
  EXPECT_TRUE(collector_->wait_for(3));
}

TEST_F(GenicamOpenTest, ReadsTheScaleOfEachIrFormat) {
  FakeCamera& fake = add_camera({.xml = write_xml(flir_nodes())});
  const std::vector<std::pair<IrFormat, LinearScale>> formats{
      {IrFormat::kRadiometric, {Unit::kCount, 1.0, 0.0}},
      {IrFormat::kTemperatureLinear100mK, {Unit::kKelvin, 0.1, 0.0}},
      {IrFormat::kTemperatureLinear10mK, {Unit::kKelvin, 0.01, 0.0}}};
  for (std::uint32_t value = 0; value < formats.size(); ++value) {
    open(with({.ir_format = formats[value].first}));
    EXPECT_EQ(info_.format.scale, formats[value].second);
    EXPECT_EQ(fake.read_register(kIrFormatAt), value);
  }
  fake.write_register(kIrFormatAt, 1);
  open(with({.ir_format = IrFormat::kLeave}));
  EXPECT_EQ(info_.format.scale, (LinearScale{Unit::kKelvin, 0.1, 0.0}));
}

TEST_F(GenicamOpenTest, SaysWhatRateAFlirRunsAtInstead) {
  add_camera({.xml = write_xml(flir_nodes())});
  open(with({.height = 2048}));  // the whole sensor: 50 Hz at most
  EXPECT_NEAR(info_.format.frame_period_s, 0.02, 1e-9);
  EXPECT_TRUE(warned("asked for 200 Hz, the camera runs at 50 Hz: fewer rows allow more"));
  auto slow = with({.height = 2048});
  slow.rate_hz = 30.0;
  open(slow);
  EXPECT_TRUE(warned("asked for 30 Hz, the camera runs at 25 Hz: it has no rate that is nearer"));
  slow.rate_hz = 1.0;
  open(slow);
  EXPECT_FALSE(warned("asked for 1 Hz, the camera runs at 3.125 Hz: fewer rows"));
  EXPECT_TRUE(warned("asked for 1 Hz, the camera runs at 3.125 Hz: it has no rate that is nearer"));
}

// Relay on a camera's control channel. It reverses the bytes of registers accessed as memory, like some FLIR cameras;
// or it is busy and only ever answers that it needs another minute.
class SwappingRelay {
 public:
  // Listens at `own` for one program at a time and forwards to the camera at `camera`; both IPv4, port 3956.
  SwappingRelay(const std::string& own, const std::string& camera) {
    const sockaddr_in front = address_of(own, kGvcpPort);
    const sockaddr_in back = address_of(camera, kGvcpPort);
    EXPECT_EQ(bind(front_.get(), reinterpret_cast<const sockaddr*>(&front), sizeof front), 0);
    EXPECT_EQ(connect(back_.get(), reinterpret_cast<const sockaddr*>(&back), sizeof back), 0);
    thread_ = std::jthread([this](const std::stop_token& end) { run(end); });
  }
  // Number of byte-swapped register accesses.
  int swapped() const { return swapped_.load(); }
  void be_busy() { busy_ = true; }

 private:
  using Packet = std::array<unsigned char, 2048>;

  // READMEM_ACK and WRITEMEM_CMD: 8 bytes of header, an address, then the data.
  void swap_register(Packet& packet, ssize_t bytes, unsigned char command) {
    if (bytes != 16 || packet[2] != 0x00 || packet[3] != command) return;
    std::reverse(packet.begin() + 12, packet.begin() + 16);
    ++swapped_;
  }
  void run(const std::stop_token& end) {
    constexpr unsigned char kReadMemoryAck = 0x85;
    constexpr unsigned char kWriteMemory = 0x86;
    sockaddr_in program{};
    auto* const to = reinterpret_cast<sockaddr*>(&program);
    Packet packet{};
    while (!end.stop_requested()) {
      std::array<pollfd, 2> events{{{front_.get(), POLLIN, 0}, {back_.get(), POLLIN, 0}}};
      if (poll(events.data(), events.size(), 20) <= 0) continue;
      if ((events[0].revents & POLLIN) != 0) {
        socklen_t size = sizeof program;
        const ssize_t bytes = recvfrom(front_.get(), packet.data(), packet.size(), 0, to, &size);
        swap_register(packet, bytes, kWriteMemory);
        if (busy_ && bytes > 0) {
          constexpr std::array<unsigned char, 12> kPendingAck{0, 0, 0, 0x89, 0, 4, 0, 1, 0, 0, 0xea, 0x60};
          sendto(front_.get(), kPendingAck.data(), kPendingAck.size(), 0, to, sizeof program);
          continue;
        }
        if (bytes > 0) send(back_.get(), packet.data(), static_cast<std::size_t>(bytes), 0);
      }
      if ((events[1].revents & POLLIN) != 0) {
        const ssize_t bytes = recv(back_.get(), packet.data(), packet.size(), 0);
        swap_register(packet, bytes, kReadMemoryAck);
        if (bytes > 0) sendto(front_.get(), packet.data(), static_cast<std::size_t>(bytes), 0, to, sizeof program);
      }
    }
  }

  const UniqueFd front_{socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)};  // towards programs
  const UniqueFd back_{socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)};   // towards the camera
  std::atomic<int> swapped_{0};
  std::atomic<bool> busy_{false};
  std::jthread thread_;
};

// Registers read as memory have another byte order than the description says.
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

// bolod's watchdog takes a source that does not return for half a minute as hung.
TEST_F(GenicamOpenTest, ACameraThatIsBusyForEverHoldsNobodyUp) {
  add_camera();
  SwappingRelay relay("127.0.0.2", "127.0.0.1");
  const auto connection = must(connect(options_for("127.0.0.2"), false));
  EXPECT_TRUE(is_controlled(*connection));
  relay.be_busy();
  const std::int64_t since_ns = monotonic_ns();
  EXPECT_FALSE(is_controlled(*connection));
  EXPECT_LT(monotonic_ns() - since_ns, 20'000'000'000);
}

TEST_F(GenicamOpenTest, ASearchEndsWhoeverAnswersWithoutAnEnd) {
  const UniqueFd search(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const sockaddr_in everybody = address_of("255.255.255.255", kGvcpPort);
  ASSERT_EQ(bind(search.get(), reinterpret_cast<const sockaddr*>(&everybody), sizeof everybody), 0);
  std::jthread stranger([&](const std::stop_token& end) {
    sockaddr_in from{};
    socklen_t size = sizeof from;
    auto* const peer = reinterpret_cast<sockaddr*>(&from);
    std::array<unsigned char, 256> packet{};
    recvfrom(search.get(), packet.data(), packet.size(), 0, peer, &size);
    const UniqueFd answer(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    const std::int64_t until_ns = monotonic_ns() + 15'000'000'000;
    while (!end.stop_requested() && monotonic_ns() < until_ns) {
      sendto(answer.get(), packet.data(), 8, 0, peer, size);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const std::int64_t since_ns = monotonic_ns();
  EXPECT_TRUE(find_cameras().empty());
  EXPECT_LT(monotonic_ns() - since_ns, 10'000'000'000);
}

TEST_F(GenicamOpenTest, ListsTheCamerasWhenThereAreSeveral) {
  add_camera();
  add_camera({.address = "127.0.0.2"});
  expect_not_opened(options_for(""), {"several cameras", "127.0.0.2"});
}

// Answers a discovery with this many cameras that do not exist.
void forge_cameras(const UniqueFd& search, std::uint32_t cameras) {
  std::array<unsigned char, 256> packet{};
  sockaddr_in from{};
  socklen_t size = sizeof from;
  auto* const peer = reinterpret_cast<sockaddr*>(&from);
  ASSERT_GT(recvfrom(search.get(), packet.data(), packet.size(), 0, peer, &size), 0);
  packet = {0, 0, 0, 3, 0, 248, 0xff, 0xff};  // DISCOVERY_ACK
  const sockaddr_in own = address_of("127.0.0.1", kGvcpPort);
  const UniqueFd answer(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ASSERT_EQ(bind(answer.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own), 0);
  for (std::uint32_t i = 0; i < cameras; ++i) {
    for (const std::size_t at : {std::size_t{8 + 12}, std::size_t{8 + 0x24}}) store_u32(packet, at, (127U << 24U) + i);
    sendto(answer.get(), packet.data(), packet.size(), 0, peer, size);
  }
}

TEST_F(GenicamOpenTest, ListsTheFirstOfManyCameras) {
  const UniqueFd search(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const timeval patience{5, 0};
  setsockopt(search.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  const sockaddr_in everybody = address_of("255.255.255.255", kGvcpPort);
  ASSERT_EQ(bind(search.get(), reinterpret_cast<const sockaddr*>(&everybody), sizeof everybody), 0);
  std::thread forger([&] { forge_cameras(search, 100); });
  const auto opened = GenicamSource(options_for("")).open();
  forger.join();
  expect_refused(opened, {"several cameras answer", "more)"});
  EXPECT_LT(opened.error().message.size(), 700U);
}

TEST_F(GenicamOpenTest, FindsTheOnlyCamera) {
  FakeCamera& fake = add_camera();
  start_and_take(3, options_for(""));
  EXPECT_EQ(info_.camera_serial, "GV01");
  add_camera({.address = "127.0.0.2"});
  fake.take_control_away();
  EXPECT_TRUE(eventually([&] { return source_->reconnects() >= 1; })) << "it is known by then which camera is meant";
}

// --- GenicamSource: what arrives, and stopping.

using GenicamStreamTest = CameraTest;

void expect_pixels(const Received& frame, Geometry geometry) {
  const std::uint64_t n = number_of(frame);
  for (int y = 0; y < geometry.height; ++y) {
    for (int x = 0; x < geometry.width; ++x) {
      const std::size_t i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(geometry.width) + static_cast<std::size_t>(x);
      ASSERT_EQ(frame.pixels[i], pixel(n, x, y)) << "frame " << n << " at " << x << "," << y;
    }
  }
}

TEST_F(GenicamStreamTest, DeliversEachPixelIdAndTime) {
  add_camera();
  const std::int64_t before_ns = monotonic_ns();
  start();
  ASSERT_TRUE(collector_->wait_for(100)) << "past the wrap of the 16-bit counter at frame 36";
  EXPECT_EQ(source_->state(), SourceState::kStreaming);
  source_->stop();
  EXPECT_EQ(source_->state(), SourceState::kIdle);

  const auto& frames = collector_->finish();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    expect_pixels(frames[i], info_.format.geometry);
    EXPECT_EQ(frames[i].meta.frame_id, kFirstId + number_of(frames[i]));
    EXPECT_GE(frames[i].meta.receive_ns, i == 0 ? before_ns : frames[i - 1].meta.receive_ns);
    EXPECT_LE(frames[i].meta.receive_ns, monotonic_ns());
    EXPECT_FALSE(frames[i].restart_window);
  }
  const auto& losses = collector_->inlet().losses();
  EXPECT_EQ(frames.back().meta.frame_id - frames.front().meta.frame_id + 1, frames.size() + losses.total());
  EXPECT_GE(source_->status()->received_packets.value(), 3 * frames.size()) << "leader, data, trailer";
}

TEST_F(GenicamStreamTest, SwapsBigEndianPixelsAndDropsMetadataRows) {
  FakeCamera& fake = add_camera({.big_endian = true});
  start_and_take(5, with({.pixel_order = PixelOrder::kBigEndian, .metadata_rows = 3}));
  EXPECT_EQ(info_.format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(fake.read_register(ARV_FAKE_CAMERA_REGISTER_HEIGHT), static_cast<std::uint32_t>(kHeight + 3));
  source_->stop();
  for (const Received& frame : collector_->finish()) expect_pixels(frame, info_.format.geometry);
}

TEST_F(GenicamStreamTest, WithoutAThreadToReceiveThereIsAnError) {
  add_camera();
  open();
  Collector collector(info_.format);
  const NoThreads none;
  expect_error(source_->start(collector.inlet()), {"no thread can be started"});
}

TEST_F(GenicamStreamTest, HandsInNothingAfterStopAndLeavesTheCameraToOthers) {
  add_camera();
  start_and_take(3);
  source_->stop();
  const std::uint64_t received = collector_->inlet().received();
  const std::uint64_t lost = collector_->inlet().losses().total();
  source_->stop();
  GenicamSource second(options_for());
  must(second.open());
  EXPECT_EQ(collector_->inlet().received(), received);
  EXPECT_EQ(collector_->inlet().losses().total(), lost);
}

}  // namespace bolo::genicam::test::genicam_open_test
