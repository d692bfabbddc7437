// Aravis's fake GigE Vision camera with frames that the tests know, on a network that only the test program has.
#pragma once

#include "drivers/genicam/genicam_source.hpp"
#include "drivers/genicam/gobject.hpp"
#include "src/pipeline/inlet.hpp"
#include "tests/refusal.hpp"

namespace bolo::genicam::test {

inline constexpr int kWidth = 64;
inline constexpr int kHeight = 24;
inline constexpr double kRateHz = 200.0;
inline constexpr std::uint64_t kPeriodNs = 5'000'000;
inline constexpr std::uint16_t kFirstId = 65500;  // so that every stream wraps after 35 frames

// Moves the program into a network namespace with only a loopback (127.0.0.1 and 127.0.0.2), so that tests that run at
// the same time can all have a camera at 127.0.0.1. Empty, or why it cannot be done. Call it before any thread starts.
std::string enter_private_network();

// The pixel of frame n (counted from 0) at (x, y).
constexpr std::uint16_t pixel(std::uint64_t n, int x, int y) {
  return static_cast<std::uint16_t>(n * 977 + static_cast<unsigned>(x) * 31 + static_cast<unsigned>(y) * 2111);
}

struct FakeOptions {
  std::string address = "127.0.0.1";
  std::string xml{};  // GenICam file of its own; empty: Aravis's
  bool big_endian = false;
  // Called for each frame n that is sent, before it is; returns the id it is sent with.
  std::function<std::uint16_t(std::uint64_t n)> id = nullptr;
  std::string serial{};  // empty: GV0 and the end of the address
};

class FakeCamera {
 public:
  explicit FakeCamera(FakeOptions options = {});
  ~FakeCamera() { kill(); }
  FakeCamera(const FakeCamera&) = delete;
  FakeCamera& operator=(const FakeCamera&) = delete;

  // The camera disappears: its sockets close.
  void kill() { fake_.reset(); }
  void set_lost_packets(double ratio) { g_object_set(fake_.get(), "gvsp-lost-ratio", ratio, nullptr); }
  // Another program is taken to be in control; the camera stops.
  void take_control_away() { arv_fake_camera_set_control_channel_privilege(camera(), 0); }
  std::uint32_t read_register(std::uint32_t address) const;
  void write_register(std::uint32_t address, std::uint32_t value);
  std::uint64_t sent() const { return sent_.load(); }
  // From now on every frame shows frame 0's picture.
  void stand_still() { moves_.store(false); }

 private:
  ArvFakeCamera* camera() const { return arv_gv_fake_camera_get_fake_camera(fake_.get()); }
  static void fill(ArvBuffer* buffer, void* self, guint32 exposure_us, guint32 gain, ArvPixelFormat format);

  FakeOptions options_;
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<bool> moves_{true};
  Ref<ArvGvFakeCamera> fake_;
};

// The id of frame n: 16 bits that start at kFirstId and skip 0.
constexpr std::uint16_t wrapped_id(std::uint64_t n) {
  return static_cast<std::uint16_t>((kFirstId - 1 + n) % 65535 + 1);
}

// Aravis's GenICam file with nodes added before its end and other changes, in a new file of the test's directory.
// Returns the path.
std::string write_xml(const std::string& nodes, const std::function<void(std::string& xml)>& change = nullptr);
// An integer in the fake's register memory, as `name`; and an enumeration over it.
std::string integer_node(const std::string& name, std::uint32_t address);
std::string enumeration_node(const std::string& name, std::uint32_t address, const std::vector<std::string>& entries);

// Options that fit the fake; what is set in `options` stays.
CameraOptions options_for(const std::string& address = "127.0.0.1", CameraOptions options = {});
inline CameraOptions with(CameraOptions options) { return options_for("127.0.0.1", std::move(options)); }

struct Received {
  FrameMeta meta;
  std::vector<std::uint16_t> pixels;
  bool restart_window = false;
};

// The number that the fake gave the frame: its timestamp is that many periods.
inline std::uint64_t number_of(const Received& frame) {
  return static_cast<std::uint64_t>(frame.meta.camera_ns) / kPeriodNs;
}

// Takes frames out of an inlet on a thread of its own, and keeps them.
class Collector {
 public:
  explicit Collector(const StreamFormat& format, std::size_t queue = 64);
  ~Collector() { finish(); }
  Collector(const Collector&) = delete;
  Collector& operator=(const Collector&) = delete;

  pipeline::FrameInlet& inlet() { return inlet_; }
  std::uint64_t count() const { return count_.load(); }
  // Waits until `frames` have come, 20 s at most. True when they have.
  bool wait_for(std::uint64_t frames) const;
  // Empties the queue and ends the thread; the frames are then readable.
  const std::vector<Received>& finish();

 private:
  void run();

  pipeline::FrameInlet inlet_;
  std::atomic<std::uint64_t> count_{0};
  std::atomic<bool> end_{false};
  std::vector<Received> frames_;
  std::thread thread_;
};

// Waits until the condition holds, 20 s at most. True when it does.
bool eventually(const std::function<bool()>& condition);

// A test with cameras on a network that only this program has.
class CameraTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  }

  // A camera that outlives the source: closing one that is gone takes seconds.
  FakeCamera& add_camera(FakeOptions options = {}) {
    return *cameras_.emplace_back(std::make_unique<FakeCamera>(std::move(options)));
  }
  void open(CameraOptions options = options_for()) {
    source_ = std::make_unique<GenicamSource>(std::move(options));
    info_ = *must(source_->open());
  }
  // Starts what is open: frames go to collector_ from then on.
  void collect(std::size_t queue = 64) {
    collector_ = std::make_unique<Collector>(info_.format, queue);
    must(source_->start(collector_->inlet()));
  }
  void start(CameraOptions options = options_for()) {
    ASSERT_NO_FATAL_FAILURE(open(std::move(options)));
    collect();
  }
  // The same until so many frames have come.
  void start_and_take(std::uint64_t frames, CameraOptions options = options_for()) {
    ASSERT_NO_FATAL_FAILURE(start(std::move(options)));
    ASSERT_TRUE(collector_->wait_for(frames));
  }
  std::uint64_t lost(LossCause cause) const { return collector_->inlet().losses().value(cause); }
  // Waits for so many frames more.
  bool wait_for_more(std::uint64_t frames) const { return collector_->wait_for(collector_->count() + frames); }
  bool warned(const std::string& part) const {
    return std::ranges::any_of(source_->warnings(),
                               [&](const std::string& text) { return text.find(part) != text.npos; });
  }

  std::vector<std::unique_ptr<FakeCamera>> cameras_;
  pipeline::SourceInfo info_;
  std::unique_ptr<Collector> collector_;
  std::unique_ptr<GenicamSource> source_;
};

// Expects that opening it is refused, in words with these parts.
inline void expect_not_opened(const CameraOptions& options, std::initializer_list<std::string> parts) {
  expect_refused(GenicamSource(options).open(), parts);
}

}  // namespace bolo::genicam::test
