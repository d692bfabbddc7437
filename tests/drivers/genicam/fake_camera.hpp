// Aravis's fake GigE Vision camera, with known frames, on a private network of the test program.
#pragma once

#include <arpa/inet.h>
#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/genicam/genicam_source.hpp"
#include "drivers/genicam/gobject.hpp"
#include "drivers/genicam/network.hpp"
#include "src/core/unique_fd.hpp"
#include "src/pipeline/inlet.hpp"
#include "tests/refusal.hpp"

namespace bolo::genicam::test {

inline constexpr int kWidth = 64;
inline constexpr int kHeight = 24;
inline constexpr double kRateHz = 200.0;
inline constexpr std::uint64_t kPeriodNs = 5'000'000;
inline constexpr std::uint16_t kFirstId = 65500;  // every stream wraps around after 35 frames

inline std::string enter() {
  if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) {
    return std::string("no network namespace of its own (") + std::strerror(errno) +
           "): allow unprivileged user namespaces or run as root";
  }
  const UniqueFd fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq up{};
  std::strcpy(up.ifr_name, "lo");
  up.ifr_flags = IFF_UP | IFF_RUNNING;
  ifreq second{};
  std::strcpy(second.ifr_name, "lo:1");
  const sockaddr_in address = address_of("127.0.0.2", 0);
  std::memcpy(&second.ifr_addr, &address, sizeof address);
  const bool done = ioctl(fd.get(), SIOCSIFFLAGS, &up) == 0 && ioctl(fd.get(), SIOCSIFADDR, &second) == 0;
  return done ? "" : std::string("no loopback in the new namespace (") + std::strerror(errno) + ")";
}

// Moves the program into a network namespace with only a loopback (127.0.0.1 and 127.0.0.2), so that parallel tests can
// all have a camera at 127.0.0.1. Returns an empty string or the error. Call before any thread starts.
inline std::string enter_private_network() {
  static const std::string kWhyNot = enter();
  return kWhyNot;
}

constexpr std::uint16_t pixel(std::uint64_t n, int x, int y) {
  return static_cast<std::uint16_t>(n * 977 + static_cast<unsigned>(x) * 31 + static_cast<unsigned>(y) * 2111);
}

// The id of frame n: 16 bits that start at kFirstId and skip 0.
constexpr std::uint16_t wrapped_id(std::uint64_t n) {
  return static_cast<std::uint16_t>((kFirstId - 1 + n) % 65535 + 1);
}

struct FakeOptions {
  std::string address = "127.0.0.1";
  std::string xml{};  // GenICam file; empty: Aravis's
  bool big_endian = false;
  // Called before each frame n is sent; returns the frame id to send.
  std::function<std::uint16_t(std::uint64_t n)> id = nullptr;
  std::string serial{};  // empty: GV0 and the end of the address
};

class FakeCamera {
 public:
  explicit FakeCamera(FakeOptions options = {}) : options_(std::move(options)) {
    if (!options_.id) options_.id = wrapped_id;
    const char* xml = options_.xml.empty() ? nullptr : options_.xml.c_str();
    const std::string by_address = "GV0" + options_.address.substr(options_.address.rfind('.') + 1);
    const std::string serial = options_.serial.empty() ? by_address : options_.serial;
    fake_.reset(arv_gv_fake_camera_new_full(options_.address.c_str(), serial.c_str(), xml));
    arv_fake_camera_set_fill_pattern(camera(), &FakeCamera::fill, this);
  }
  ~FakeCamera() { kill(); }
  FakeCamera(const FakeCamera&) = delete;
  FakeCamera& operator=(const FakeCamera&) = delete;

  // The camera disappears: its sockets close.
  void kill() { fake_.reset(); }
  void set_lost_packets(double ratio) { g_object_set(fake_.get(), "gvsp-lost-ratio", ratio, nullptr); }
  // Simulates another program taking control; the camera stops.
  void take_control_away() { arv_fake_camera_set_control_channel_privilege(camera(), 0); }
  std::uint32_t read_register(std::uint32_t address) const {
    std::uint32_t value = 0;
    arv_fake_camera_read_register(camera(), address, &value);
    return value;
  }
  void write_register(std::uint32_t address, std::uint32_t value) {
    arv_fake_camera_write_register(camera(), address, value);
  }
  std::uint64_t sent() const { return sent_.load(); }
  // From now on every frame repeats frame 0's picture.
  void stand_still() { moves_.store(false); }

 private:
  ArvFakeCamera* camera() const { return arv_gv_fake_camera_get_fake_camera(fake_.get()); }
  static void fill(ArvBuffer* buffer, void* self, guint32, guint32, ArvPixelFormat) {
    auto* fake = static_cast<FakeCamera*>(self);
    const std::uint64_t n = fake->sent_.load();
    const std::uint64_t shown = fake->moves_.load() ? n : 0;
    const int width = arv_buffer_get_image_width(buffer);
    const int height = arv_buffer_get_image_height(buffer);
    std::size_t size = 0;  // bytes received so far; unused
    auto* bytes = static_cast<unsigned char*>(const_cast<void*>(arv_buffer_get_data(buffer, &size)));
    const std::size_t high = fake->options_.big_endian ? 0 : 1;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const std::size_t i =
            (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)) * 2;
        const std::uint16_t value = pixel(shown, x, y);
        bytes[i + high] = static_cast<unsigned char>(value >> 8);
        bytes[i + 1 - high] = static_cast<unsigned char>(value & 0xFF);
      }
    }
    arv_buffer_set_frame_id(buffer, fake->options_.id(n));
    arv_buffer_set_timestamp(buffer, n * kPeriodNs);
    fake->sent_.store(n + 1);
  }

  FakeOptions options_;
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<bool> moves_{true};
  Ref<ArvGvFakeCamera> fake_;
};

// Writes Aravis's GenICam file to a new file in the test's directory, with `nodes` appended and `change` applied.
// Returns the path.
inline std::string write_xml(const std::string& nodes, const std::function<void(std::string& xml)>& change = nullptr) {
  const Ref<ArvFakeCamera> plain(arv_fake_camera_new("plain"));
  std::size_t size = 0;
  const char* text = arv_fake_camera_get_genicam_xml(plain.get(), &size);
  std::string xml(text, size);
  xml.insert(xml.rfind("</RegisterDescription>"), nodes);
  if (change) change(xml);
  static int count = 0;
  std::string path = testing::TempDir() + "bolo-genicam-" + std::to_string(getpid()) + "-" + std::to_string(++count);
  path += ".xml";
  std::ofstream(path) << xml;
  return path;
}
// Nodes for an integer `name` in the fake's register memory, and for an enumeration over it.
inline std::string integer_node(const std::string& name, std::uint32_t address) {
  return "<Integer Name=\"" + name + "\"><pValue>" + name + "Register</pValue></Integer>" + "<IntReg Name=\"" + name +
         "Register\"><Address>" + std::to_string(address) +
         "</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
         "<Endianess>BigEndian</Endianess></IntReg>";
}
inline std::string enumeration_node(const std::string& name, std::uint32_t address,
                                    const std::vector<std::string>& entries) {
  std::string text = "<Enumeration Name=\"" + name + "\">";
  for (std::size_t i = 0; i < entries.size(); ++i) {
    text += "<EnumEntry Name=\"" + entries[i] + "\"><Value>" + std::to_string(i) + "</Value></EnumEntry>";
  }
  text += "<pValue>" + name + "Value</pValue></Enumeration>";
  return text + integer_node(name + "Value", address);
}

// Fills in the defaults that fit the fake; values set in `options` stay.
inline CameraOptions options_for(const std::string& address = "127.0.0.1", CameraOptions options = {}) {
  const auto standard = [](auto& value, auto none, auto ours) { value = value == none ? ours : value; };
  options.address = address;
  standard(options.width, 0, kWidth);
  standard(options.height, 0, kHeight);
  options.rate_hz = kRateHz;
  standard(options.windowing_watch_ms, CameraOptions().windowing_watch_ms, 200);
  return options;
}
inline CameraOptions with(CameraOptions options) { return options_for("127.0.0.1", std::move(options)); }

struct Received {
  FrameMeta meta;
  std::vector<std::uint16_t> pixels;
  bool restart_window = false;
};

// The fake's frame number: the timestamp in periods.
inline std::uint64_t number_of(const Received& frame) {
  return static_cast<std::uint64_t>(frame.meta.camera_ns) / kPeriodNs;
}

// Takes frames from an inlet in its own thread and keeps copies.
class Collector {
 public:
  explicit Collector(const StreamFormat& format, std::size_t queue = 64)
      : inlet_(format, 4, queue), thread_([this] { run(); }) {}
  ~Collector() { finish(); }
  Collector(const Collector&) = delete;
  Collector& operator=(const Collector&) = delete;

  pipeline::FrameInlet& inlet() { return inlet_; }
  std::uint64_t count() const { return count_.load(); }
  bool wait_for(std::uint64_t frames) const {
    return eventually([&] { return count() >= frames; });
  }
  // Drains the queue and ends the thread; the frames are then readable.
  const std::vector<Received>& finish() {
    end_.store(true);
    if (thread_.joinable()) thread_.join();
    return frames_;
  }

 private:
  void run() {
    const std::size_t pixels = inlet_.format().geometry.pixels();
    for (;;) {
      const bool last_poll = end_.load();
      const auto arrival = inlet_.next(20'000'000);
      if (arrival.slot == nullptr) {
        if (last_poll) return;
        continue;
      }
      const std::uint16_t* data = arrival.slot->u16();
      frames_.push_back({arrival.slot->meta, {data, data + pixels}, arrival.restart_window});
      inlet_.give_back(*arrival.slot);
      count_.fetch_add(1);
    }
  }

  pipeline::FrameInlet inlet_;
  std::atomic<std::uint64_t> count_{0};
  std::atomic<bool> end_{false};
  std::vector<Received> frames_;
  std::thread thread_;
};

class CameraTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  }
  // Before the cameras are destroyed: closing a source whose camera is gone takes seconds.
  void TearDown() override {
    if (source_) source_->stop();
  }

  FakeCamera& add_camera(FakeOptions options = {}) {
    return *cameras_.emplace_back(std::make_unique<FakeCamera>(std::move(options)));
  }
  void open(CameraOptions options = options_for()) {
    source_ = std::make_unique<GenicamSource>(std::move(options));
    info_ = *must(source_->open());
  }
  // Starts the open source; frames go to collector_.
  void collect(std::size_t queue = 64) {
    collector_ = std::make_unique<Collector>(info_.format, queue);
    must(source_->start(collector_->inlet()));
  }
  void start(CameraOptions options = options_for()) {
    ASSERT_NO_FATAL_FAILURE(open(std::move(options)));
    collect();
  }
  // Opens, starts and waits for this many frames.
  void start_and_take(std::uint64_t frames, CameraOptions options = options_for()) {
    ASSERT_NO_FATAL_FAILURE(start(std::move(options)));
    ASSERT_TRUE(collector_->wait_for(frames));
  }
  std::uint64_t lost(LossCause cause) const { return collector_->inlet().losses().value(cause); }
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

inline void expect_not_opened(const CameraOptions& options, std::initializer_list<std::string> parts) {
  expect_refused(GenicamSource(options).open(), parts);
}

}  // namespace bolo::genicam::test
