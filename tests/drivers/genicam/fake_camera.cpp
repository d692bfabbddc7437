#include "tests/drivers/genicam/fake_camera.hpp"

#include <arpa/inet.h>
#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

namespace bolo::genicam::test {
namespace {

constexpr int kPatienceMs = 20000;  // a guard against hanging, not an expectation

bool set_address(int socket, const char* interface, const char* address) {
  ifreq request{};
  std::strncpy(request.ifr_name, interface, IFNAMSIZ - 1);
  auto* in = reinterpret_cast<sockaddr_in*>(&request.ifr_addr);
  in->sin_family = AF_INET;
  inet_pton(AF_INET, address, &in->sin_addr);
  return ioctl(socket, SIOCSIFADDR, &request) == 0;
}

bool bring_up(int socket, const char* interface) {
  ifreq request{};
  std::strncpy(request.ifr_name, interface, IFNAMSIZ - 1);
  request.ifr_flags = IFF_UP | IFF_RUNNING;
  return ioctl(socket, SIOCSIFFLAGS, &request) == 0;
}

std::string enter() {
  if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) {
    return std::string("no network namespace of its own (") + std::strerror(errno) +
           "): allow unprivileged user namespaces or run as root";
  }
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool done = socket >= 0 && bring_up(socket, "lo") && set_address(socket, "lo:1", "127.0.0.2");
  const std::string why = done ? "" : std::string("no loopback in the new namespace (") + std::strerror(errno) + ")";
  if (socket >= 0) close(socket);
  return why;
}

}  // namespace

std::string enter_private_network() {
  static const std::string kWhyNot = enter();
  return kWhyNot;
}

FakeCamera::FakeCamera(FakeOptions options) : options_(std::move(options)) {
  if (!options_.id) options_.id = wrapped_id;
  const char* xml = options_.xml.empty() ? nullptr : options_.xml.c_str();
  const std::string by_address = "GV0" + options_.address.substr(options_.address.rfind('.') + 1);
  const std::string serial = options_.serial.empty() ? by_address : options_.serial;
  fake_.reset(arv_gv_fake_camera_new_full(options_.address.c_str(), serial.c_str(), xml));
  arv_fake_camera_set_fill_pattern(camera(), &FakeCamera::fill, this);
}

std::uint32_t FakeCamera::read_register(std::uint32_t address) const {
  std::uint32_t value = 0;
  arv_fake_camera_read_register(camera(), address, &value);
  return value;
}

void FakeCamera::write_register(std::uint32_t address, std::uint32_t value) {
  arv_fake_camera_write_register(camera(), address, value);
}

void FakeCamera::fill(ArvBuffer* buffer, void* self, guint32, guint32, ArvPixelFormat) {
  auto* fake = static_cast<FakeCamera*>(self);
  const std::uint64_t n = fake->sent_.load();
  const std::uint64_t shown = fake->moves_.load() ? n : 0;
  const int width = arv_buffer_get_image_width(buffer);
  const int height = arv_buffer_get_image_height(buffer);
  std::size_t size = 0;  // of what was received so far: says nothing here
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

std::string write_xml(const std::string& nodes, const std::function<void(std::string& xml)>& change) {
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

std::string integer_node(const std::string& name, std::uint32_t address) {
  return "<Integer Name=\"" + name + "\"><pValue>" + name + "Register</pValue></Integer>" + "<IntReg Name=\"" + name +
         "Register\"><Address>" + std::to_string(address) +
         "</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
         "<Endianess>BigEndian</Endianess></IntReg>";
}

std::string enumeration_node(const std::string& name, std::uint32_t address, const std::vector<std::string>& entries) {
  std::string text = "<Enumeration Name=\"" + name + "\">";
  for (std::size_t i = 0; i < entries.size(); ++i) {
    text += "<EnumEntry Name=\"" + entries[i] + "\"><Value>" + std::to_string(i) + "</Value></EnumEntry>";
  }
  text += "<pValue>" + name + "Value</pValue></Enumeration>";
  return text + integer_node(name + "Value", address);
}

CameraOptions options_for(const std::string& address, CameraOptions options) {
  const auto standard = [](auto& value, auto none, auto ours) { value = value == none ? ours : value; };
  options.address = address;
  standard(options.width, 0, kWidth);
  standard(options.height, 0, kHeight);
  options.rate_hz = kRateHz;
  standard(options.windowing_watch_ms, CameraOptions().windowing_watch_ms, 200);
  return options;
}

Collector::Collector(const StreamFormat& format, std::size_t queue)
    : inlet_(format, 4, queue), thread_([this] { run(); }) {}

bool Collector::wait_for(std::uint64_t frames) const {
  return eventually([&] { return count() >= frames; });
}

const std::vector<Received>& Collector::finish() {
  end_.store(true);
  if (thread_.joinable()) thread_.join();
  return frames_;
}

void Collector::run() {
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

bool eventually(const std::function<bool()>& condition) {
  constexpr int kStepMs = 5;
  for (int waited = 0; waited < kPatienceMs; waited += kStepMs) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(kStepMs));
  }
  return condition();
}

}  // namespace bolo::genicam::test
