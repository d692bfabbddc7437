// Another process sends forged GVSP packets to a live stream: from its own address, from the camera's address, and, if
// permitted (CAP_NET_RAW), from the camera's address and port.
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <sys/prctl.h>
#include <sys/wait.h>

#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/fake_camera.hpp"
#include "drivers/genicam/network.hpp"
#include "src/core/unique_fd.hpp"
#include "tests/drivers/fakecam/raw_client.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"
#include "tests/drivers/genicam/fake_camera.hpp"
#include "tests/drivers/genicam/gvsp_packets.hpp"

namespace bolo::genicam::forged_packets_test {

constexpr Geometry kFrame{640, 120};
constexpr double kRateHz = 200.0;
constexpr long kPauseNs = 1'000'000;  // 1,000 packets a second
constexpr std::size_t kDistinct = 40;

struct Stream {
  sockaddr_in to{};
  sockaddr_in camera{};
};

UniqueFd socket_from(const std::string& ipv4) {
  UniqueFd fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const sockaddr_in own = address_of(ipv4, 0);
  return bind(fd.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own) == 0 ? std::move(fd) : UniqueFd{};
}

// Sends with our own IP and UDP headers.
void send_raw(int fd, const Stream& stream, const gvsp::test::Datagram& bytes) {
  std::vector<std::byte> packet(sizeof(iphdr) + sizeof(udphdr) + bytes.size());
  iphdr ip{};
  ip.version = 4;
  ip.ihl = 5;
  ip.ttl = 64;
  ip.protocol = IPPROTO_UDP;
  ip.tot_len = htons(static_cast<std::uint16_t>(packet.size()));
  ip.saddr = stream.camera.sin_addr.s_addr;
  ip.daddr = stream.to.sin_addr.s_addr;
  udphdr udp{};
  udp.source = stream.camera.sin_port;
  udp.dest = stream.to.sin_port;
  udp.len = htons(static_cast<std::uint16_t>(sizeof udp + bytes.size()));
  std::memcpy(packet.data(), &ip, sizeof ip);
  std::memcpy(packet.data() + sizeof ip, &udp, sizeof udp);
  if (!bytes.empty()) std::memcpy(packet.data() + sizeof ip + sizeof udp, bytes.data(), bytes.size());
  sendto(fd, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&stream.to), sizeof stream.to);
}

// Sends forged packets until killed.
[[noreturn]] void forge(const Stream& stream, const std::string& camera, const std::string& stranger) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const UniqueFd raw(socket(AF_INET, SOCK_RAW | SOCK_CLOEXEC, IPPROTO_RAW));
  const std::array<UniqueFd, 2> sockets{socket_from(camera), socket_from(stranger)};
  timespec next{};
  clock_gettime(CLOCK_MONOTONIC, &next);
  for (std::uint64_t n = 0;; ++n) {
    const gvsp::test::Datagram bytes = gvsp::test::forged(n, 1);
    if (raw && n % 4 != 0) {
      send_raw(raw.get(), stream, bytes);
    } else {
      sendto(sockets[n / 4 % 2].get(), bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&stream.to),
             sizeof stream.to);
    }
    next.tv_nsec += kPauseNs;
    if (next.tv_nsec >= 1'000'000'000) {
      next.tv_nsec -= 1'000'000'000;
      ++next.tv_sec;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, nullptr);
  }
}

TEST(ForgedPackets, EndNothingAndEveryFrameIsPublishedOrCounted) {
  const char* asked = std::getenv("BOLO_FORGED_SECONDS");
  const auto seconds = static_cast<std::uint64_t>(asked != nullptr ? std::max(1, std::atoi(asked)) : 5);
  const std::uint64_t frames = seconds * static_cast<std::uint64_t>(kRateHz);
  const std::string camera = fakecam::test::fresh_address();
  const auto fake = fakecam::test::serve(fakecam::test::synthetic(kFrame, kDistinct, 1.0 / kRateHz),
                                         {.address = camera, .laps = frames / kDistinct});
  GenicamSource source({.address = camera});
  const auto info = must(source.open());
  test::Collector collector(info->format, 200);
  ASSERT_TRUE(source.start(collector.inlet()));

  fakecam::test::RawClient reader(camera);
  const auto port = [&](std::uint32_t where) { return static_cast<std::uint16_t>(reader.read(where)); };
  Stream stream;
  stream.to = address_of("0.0.0.0", port(fakecam::reg::kStreamPort));
  stream.to.sin_addr.s_addr = htonl(reader.read(fakecam::reg::kStreamAddress));
  stream.camera = address_of(camera, port(fakecam::reg::kStreamSourcePort));
  const std::string stranger = fakecam::test::fresh_address();
  const pid_t forger = fork();
  if (forger == 0) forge(stream, camera, stranger);

  const auto& losses = collector.inlet().losses();
  while (fake->stats().streams_finished == 0 && !testing::Test::HasFailure()) usleep(50'000);
  EXPECT_TRUE(eventually([&] { return collector.inlet().received() + losses.total() >= frames; }));
  kill(forger, SIGKILL);
  waitpid(forger, nullptr, 0);
  const std::uint64_t packets = source.status()->received_packets.value();
  source.stop();

  const auto received = collector.finish();
  ASSERT_FALSE(received.empty());
  const std::uint64_t span = received.back().meta.frame_id - received.front().meta.frame_id + 1;
  const auto of_frames = received.size() * fake->stats().packets_sent / fake->stats().frames_sent;
  const std::uint64_t others = packets - std::min<std::uint64_t>(packets, of_frames);
  std::printf("%zu of %zu frames received, %zu lost; %zu packets, %zu of no whole frame\n", received.size(),
              static_cast<std::size_t>(fake->stats().frames_sent), static_cast<std::size_t>(losses.total()),
              static_cast<std::size_t>(packets), static_cast<std::size_t>(others));
  EXPECT_EQ(received.size() + losses.total(), frames);
  EXPECT_LE(span, frames);
  EXPECT_GT(received.size(), frames / 2) << "the machine may be busy, but frames flow";
  EXPECT_GT(others + 1, seconds) << "forged packets arrived";
  for (const auto& frame : received) {
    ASSERT_FALSE(frame.restart_window) << "the counter never began anew";
  }
}

}  // namespace bolo::genicam::forged_packets_test
