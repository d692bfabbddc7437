#include "drivers/genicam/camera_frame.hpp"
#include "drivers/genicam/frame_receiver.hpp"
#include "drivers/genicam/genicam_source.hpp"
#include "drivers/genicam/network.hpp"
#include "drivers/genicam/radiometry.hpp"
#include "drivers/genicam/session.hpp"
#include "src/core/unique_fd.hpp"
#include "tests/drivers/fakecam/raw_client.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"

namespace bolo::genicam::parts_test {

// Bytes on the wire of the little-endian values 0x0100, 0x0302, ...: byte i holds i.
std::vector<std::byte> counting_bytes(std::size_t count) {
  std::vector<std::byte> bytes(count);
  for (std::size_t i = 0; i < count; ++i) bytes[i] = static_cast<std::byte>(i);
  return bytes;
}

std::uint16_t value_of(std::byte low, std::byte high) {
  return static_cast<std::uint16_t>(std::to_integer<unsigned>(low) | std::to_integer<unsigned>(high) << 8);
}

TEST(CopyRowsTest, SwapsBigEndianOfAnyWidthAndAlignment) {
  for (int width = 1; width < 70; ++width) {
    const auto from = counting_bytes(static_cast<std::size_t>(width) * 2 + 1);
    std::vector<std::uint16_t> to(static_cast<std::size_t>(width));
    copy_rows(from.data() + 1, 0, PixelOrder::kBigEndian, {width, 1}, to.data());
    for (std::size_t i = 0; i < to.size(); ++i) {
      ASSERT_EQ(to[i], value_of(from[2 * i + 2], from[2 * i + 1])) << "width " << width << " pixel " << i;
    }
  }
}

TEST(CopyRowsTest, LeavesOutPaddingAndRowsAfterTheImage) {
  constexpr int kWidth = 5;
  constexpr std::size_t kStride = kWidth * 2 + 3;
  const auto from = counting_bytes(kStride * 4);  // two image rows, two of metadata
  std::vector<std::uint16_t> to(kWidth * 2 + 4, 0xAAAA);
  copy_rows(from.data(), kStride, PixelOrder::kLittleEndian, {kWidth, 2}, to.data());
  for (std::size_t y = 0; y < 2; ++y) {
    for (std::size_t x = 0; x < kWidth; ++x) {
      EXPECT_EQ(to[y * kWidth + x], value_of(from[y * kStride + 2 * x], from[y * kStride + 2 * x + 1]));
    }
  }
  EXPECT_TRUE(std::all_of(to.begin() + kWidth * 2, to.end(), [](std::uint16_t v) { return v == 0xAAAA; }));
}

TEST(FrameReceiverTest, KeepsAnyTimeStampToWhatDifferencesCanBeTakenOf) {
  pipeline::FrameInlet inlet({.geometry = {2, 1}}, 0, 8);
  pipeline::SourceStatus status;
  FrameReceiver receiver(inlet, {}, status);
  const auto bytes = counting_bytes(4);
  CameraFrame frame{
      .end = FrameEnd::kWhole, .id = 0, .receive_ns = monotonic_ns(), .mono16 = true, .width = 2, .height = 1};
  frame.pixels = bytes;
  constexpr std::uint64_t kBelow = std::uint64_t{1} << 61U;
  for (const std::uint64_t stamp :
       {std::uint64_t{1'000'000'000}, kBelow + 3'000'000'000, 4 * kBelow, ~std::uint64_t{0}}) {
    ++frame.id;
    frame.camera_ns = static_cast<std::int64_t>(stamp);
    receiver.take(frame);
    const rt::FrameSlot* slot = inlet.next(0).slot;
    ASSERT_NE(slot, nullptr);
    EXPECT_EQ(slot->meta.camera_ns, static_cast<std::int64_t>(stamp % kBelow));
    EXPECT_EQ(slot->meta.host_ns, frame.receive_ns);
  }
}

// --- Radiance counts to kelvin.

const Planck kPlanck{17000.0, 1428.0, 1.0, 4000.0, 60.0};

double radiance(double kelvin) { return kPlanck.r / (std::exp(kPlanck.b / kelvin) - kPlanck.f); }
double count_of(double signal) { return kPlanck.j0 + kPlanck.j1 * signal; }

TEST(Radiometry, UndoesTheCamerasFormula) {
  for (const double kelvin : {240.0, 295.0, 300.0, 423.0}) {
    EXPECT_NEAR(kelvin_of(count_of(radiance(kelvin)), kPlanck, {}), kelvin, 1e-9);
  }
  EXPECT_EQ(kelvin_of(kPlanck.j0, kPlanck, {}), 0.0);
  EXPECT_EQ(kelvin_of(0.0, kPlanck, {}), 0.0);
}

TEST(Radiometry, TakesOutWhatIsReflectedAndAdded) {
  const ObjectParameters object{.emissivity = 0.8,
                                .transmission = 0.9,
                                .optics_transmission = 0.7,
                                .reflected_k = 280.0,
                                .atmosphere_k = 290.0,
                                .optics_k = 310.0};
  const double behind_air = 0.9 * (0.8 * radiance(330.0) + 0.2 * radiance(280.0)) + 0.1 * radiance(290.0);
  const double seen = 0.7 * behind_air + 0.3 * radiance(310.0);
  EXPECT_NEAR(kelvin_of(count_of(seen), kPlanck, object), 330.0, 1e-9);
}

// The guarded object is destroyed right after shut(); a later use would be found by the sanitizers.
TEST(GateTest, NobodyIsInsideAfterShut) {
  for (int round = 0; round < 100; ++round) {
    Gate gate;
    auto guarded = std::make_unique<int>(0);
    int* const plain = guarded.get();
    std::atomic<bool> end{false};
    std::atomic<int> entries{0};
    std::thread worker([&] {
      while (!end.load()) {
        if (!gate.enter()) continue;
        ++*plain;
        gate.leave();
        entries.fetch_add(1);
      }
    });
    gate.open();
    while (entries.load() < round % 7) std::this_thread::yield();
    gate.shut();
    const int seen = *guarded;
    std::this_thread::yield();
    EXPECT_EQ(*guarded, seen);
    guarded.reset();
    end.store(true);
    worker.join();
  }
}

// --- Control privilege left behind by a program that died.

using fakecam::test::RawClient;
namespace reg = fakecam::reg;

class DeadProgram : public testing::Test {
 protected:
  void SetUp() override {
    camera_ = fakecam::test::serve(fakecam::test::synthetic({16, 8}, 4), {.address = address_});
    program_.emplace(address_);
    ASSERT_EQ(program_->take_control(), fakecam::gvcp::Status::kSuccess);
  }
  std::uint32_t privilege() const { return RawClient(address_).read(reg::kPrivilege); }

  std::string address_ = fakecam::test::fresh_address();
  std::unique_ptr<fakecam::FakeCamera> camera_;
  std::optional<RawClient> program_;
};

TEST_F(DeadProgram, LetsGoOfTheCamera) {
  program_.reset();  // closes the socket; the camera is not told
  ASSERT_NE(privilege(), 0U);
  EXPECT_TRUE(free_from_dead_program(address_, "127.0.0.1"));
  EXPECT_EQ(privilege(), 0U);
}

TEST_F(DeadProgram, IsNotOneThatLivesOrOnAnotherComputerOrNotInControl) {
  EXPECT_FALSE(free_from_dead_program(address_, "127.0.0.1")) << "it lives";
  EXPECT_NE(privilege(), 0U);
  ASSERT_EQ(program_->write(reg::kPrivilege, 0), fakecam::gvcp::Status::kSuccess);
  EXPECT_FALSE(free_from_dead_program(address_, "127.0.0.1")) << "nobody is in control";
  ASSERT_EQ(program_->take_control(), fakecam::gvcp::Status::kSuccess);
  program_.reset();
  EXPECT_FALSE(free_from_dead_program(address_, "127.0.0.2")) << "another computer's";
  EXPECT_NE(privilege(), 0U);
}

UniqueFd socket_at(const char* ipv4, sockaddr_in& address) {
  UniqueFd fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  address = address_of(ipv4, 0);
  socklen_t size = sizeof address;
  if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0) return {};
  getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &size);
  return fd;
}

bool passes(const UniqueFd& from, const UniqueFd& to, const sockaddr_in& to_address, std::size_t length, int content) {
  std::vector<std::uint8_t> bytes(length, 0x11);
  if (length > 4) bytes[4] = static_cast<std::uint8_t>(content);
  sendto(from.get(), bytes.data(), length, 0, reinterpret_cast<const sockaddr*>(&to_address), sizeof to_address);
  std::array<std::uint8_t, 2000> got{};
  return recv(to.get(), got.data(), got.size(), MSG_DONTWAIT) == static_cast<ssize_t>(length);
}

TEST(NetworkTest, LetsOnlyTheCamerasStreamIn) {
  sockaddr_in own{};
  sockaddr_in camera_at{};
  sockaddr_in other{};
  const UniqueFd stream = socket_at("127.0.0.1", own);
  const UniqueFd camera = socket_at("127.0.61.2", camera_at);
  const UniqueFd same_address = socket_at("127.0.61.2", other);
  const UniqueFd stranger = socket_at("127.0.61.3", other);
  ASSERT_TRUE(stream && camera && same_address && stranger);
  ASSERT_TRUE(filter_stream(stream.get(), "127.0.61.2", 0));
  EXPECT_FALSE(passes(stranger, stream, own, 100, 3));
  EXPECT_TRUE(passes(same_address, stream, own, 100, 3));
  for (const int content : {1, 2, 3, 0x81, 0x82, 0x83}) {
    EXPECT_TRUE(passes(camera, stream, own, 1472, content));
    EXPECT_TRUE(passes(camera, stream, own, 8, content));
    EXPECT_FALSE(passes(camera, stream, own, 7, content));
  }
  for (const int content : {0, 4, 5, 7, 8, 0x7f, 0x80, 0x85, 0xff}) {
    EXPECT_FALSE(passes(camera, stream, own, 100, content)) << content;
  }
  ASSERT_TRUE(filter_stream(stream.get(), "127.0.61.2", ntohs(camera_at.sin_port)));
  EXPECT_FALSE(passes(same_address, stream, own, 100, 3));
  EXPECT_TRUE(passes(camera, stream, own, 100, 3));
}

// --- A camera with a PTP clock: its state is reported, and the clock is left alone.

class Ptp : public testing::Test {
 protected:
  // Runs a source on a fake camera until its text contains `wanted`; returns the text.
  std::string run(bool ptp, const std::string& wanted) {
    const std::string address = fakecam::test::fresh_address();
    camera_ = fakecam::test::serve(fakecam::test::synthetic({64, 32}, 20), {.address = address, .laps = 0});
    GenicamSource source({.address = address, .ir_format = IrFormat::kLeave, .ptp = ptp});
    const auto info = must(source.open());
    pipeline::FrameInlet inlet(info->format, 4, 64);
    EXPECT_TRUE(source.start(inlet));
    std::string notices;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(15);
    while (notices.find(wanted) == std::string::npos && std::chrono::steady_clock::now() < end) {
      const auto arrival = inlet.next(20'000'000);
      if (arrival.slot != nullptr) inlet.give_back(*arrival.slot);
      for (const auto& notice : source.take_notices()) notices += notice.text + "\n";
      if (wanted.empty() && inlet.received() > 5) break;
    }
    ptp_ = source.status()->ptp.value();
    offset_ns_ = source.status()->ptp_offset_ns.value();
    source.stop();
    return notices;
  }

  std::unique_ptr<fakecam::FakeCamera> camera_;
  pipeline::PtpStatus ptp_ = pipeline::PtpStatus::kOff;
  std::int64_t offset_ns_ = 0;
};

TEST_F(Ptp, StateAndOffsetAreToldAndTheClockIsNotReset) {
  const std::string expected = "PTP keeps the camera's clock, -37 ns from its master";
  const std::string notices = run(true, expected);
  EXPECT_NE(notices.find(expected), std::string::npos) << notices;
  EXPECT_EQ(camera_->stats().clock_resets, 0U);
  EXPECT_EQ(ptp_, pipeline::PtpStatus::kSlave);
  EXPECT_EQ(offset_ns_, -37);
}

TEST_F(Ptp, WithoutItTheClockBeginsWithTheStream) {
  EXPECT_EQ(run(false, "").find("PTP"), std::string::npos);
  EXPECT_EQ(camera_->stats().clock_resets, 1U);
  EXPECT_EQ(ptp_, pipeline::PtpStatus::kOff);
}

// --- SceneWatch: motion, and values that are no temperatures. NucSchedule: when a correction is due.

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kPeriodNs = 5'000'000;
const StreamFormat kFormat{{64, 24}, PixelType::kUint16, {Unit::kKelvin, 0.01, 0.0}, 0.005, 1};

struct Scene {
  SceneWatch watch{kFormat, 0.1};
  std::int64_t now_ns = kSecondNs;
  std::vector<std::uint16_t> plane = std::vector<std::uint16_t>(kFormat.geometry.pixels(), 30000);

  // Shows frames for `seconds`; each pixel is `value(frame)`.
  template <typename Value>
  void show(double seconds, Value value) {
    for (int i = 0; i < static_cast<int>(seconds * 200); ++i, now_ns += kPeriodNs) {
      for (std::size_t p = 0; p < plane.size(); ++p) plane[p] = static_cast<std::uint16_t>(value(i, p));
      watch.update(plane.data(), now_ns);
    }
  }
};

TEST(SceneWatch, TellsSinceWhenNothingMoves) {
  Scene scene;
  const auto noise = [](int i, std::size_t p) { return 30000 + (i * 7 + static_cast<int>(p)) % 5; };
  scene.show(1.0, noise);
  const std::int64_t since_ns = scene.watch.still_since_ns();
  EXPECT_NE(since_ns, 0);
  EXPECT_LT(since_ns, scene.now_ns - kSecondNs / 2);
  scene.show(0.5, [](int i, std::size_t) { return 30000 + i * 2; });  // 4 K a second
  EXPECT_EQ(scene.watch.still_since_ns(), 0);
  const std::int64_t stopped_ns = scene.now_ns;
  scene.show(0.5, [](int, std::size_t) { return 30200; });
  EXPECT_GT(scene.watch.still_since_ns(), stopped_ns - kSecondNs / 5);
  scene.watch.restart();
  EXPECT_EQ(scene.watch.still_since_ns(), 0) << "another connection has shown nothing yet";
}

TEST(SceneWatch, TheMedianIsOfOneEarlyFrame) {
  Scene scene;
  EXPECT_EQ(scene.watch.median(), -1);
  scene.show(0.5, [](int, std::size_t p) { return p % 3 == 0 ? 65535 : 29500; });
  EXPECT_EQ(scene.watch.median(), 29500);
}

TEST(Implausible, NamesTheSettingThatMakesSense) {
  const LinearScale mk10{Unit::kKelvin, 0.01, 0.0};
  EXPECT_FALSE(implausible(29500, mk10));
  EXPECT_FALSE(implausible(100, {Unit::kCount, 1.0, 0.0})) << "counts may be anything";
  const int swapped = (29500 & 0xFF) << 8 | 29500 >> 8;
  EXPECT_NE(implausible(swapped, mk10)->find("pixel_order"), std::string::npos);
  EXPECT_NE(implausible(2950, mk10)->find("\"100mk\""), std::string::npos);
  EXPECT_NE(implausible(29500, {Unit::kKelvin, 0.1, 0.0})->find("\"10mk\""), std::string::npos);
  EXPECT_NE(implausible(7, mk10)->find("ir_format"), std::string::npos);
}

NucOptions policy(NucPolicy which) { return {.policy = which, .interval_s = 100.0, .still_s = 2.0}; }

TEST(NucSchedule, StillWaitsForTheSceneAndTheInterval) {
  NucSchedule schedule(policy(NucPolicy::kStill));
  EXPECT_FALSE(schedule.due(10 * kSecondNs, 0)) << "it moves";
  EXPECT_FALSE(schedule.due(10 * kSecondNs, 9 * kSecondNs)) << "it has only just stopped";
  EXPECT_TRUE(schedule.due(11 * kSecondNs, 9 * kSecondNs));
  schedule.done(11 * kSecondNs);
  EXPECT_FALSE(schedule.due(20 * kSecondNs, 9 * kSecondNs)) << "it was just corrected";
  EXPECT_TRUE(schedule.due(111 * kSecondNs, 9 * kSecondNs));
}

}  // namespace bolo::genicam::parts_test
