#include <algorithm>
#include <array>
#include <cstdio>

#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/gvsp.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::uint32_t kGigE12 = 0x00010002;
constexpr std::uint32_t kBigEndianUtf8 = 1U << 31 | 1U;
constexpr std::uint32_t kLinkLocalAndDhcp = 0x6;
constexpr std::uint32_t kSourcePortAnd16BitIds = 0xc0000000;
// Concatenated reads and writes, WRITEMEM, PACKETRESEND, primary application registers, link speed, heartbeat switch,
// serial number, user-defined name.
constexpr std::uint32_t kCapabilities = 1U | 1U << 1 | 1U << 2 | 1U << 27 | 1U << 28 | 1U << 29 | 1U << 30 | 1U << 31;
constexpr std::uint32_t kLinkSpeedMbit = 1000;
constexpr std::uint32_t kTicksPerSecond = 1'000'000'000;
constexpr std::uint32_t kHeartbeatMs = 3000;
constexpr std::uint32_t kMinHeartbeatMs = 500;
constexpr std::uint32_t kDefaultPacketSize = 1400;
constexpr std::uint32_t kMaxPacketDelayTicks = 10'000'000;

}  // namespace

void fill_bootstrap(RegisterMap& registers, const Identity& identity) {
  registers.set(reg::kVersion, kGigE12);
  registers.set(reg::kDeviceMode, kBigEndianUtf8);
  registers.set(reg::kMacHigh, 0x0200);  // locally administered; the rest is the address, so that no two are equal
  registers.set(reg::kMacLow, identity.address);
  registers.set(reg::kSupportedIpConfig, kLinkLocalAndDhcp);
  registers.set(reg::kCurrentIpConfig, kLinkLocalAndDhcp);
  registers.set(reg::kIpAddress, identity.address);
  registers.set(reg::kSubnetMask, identity.netmask);
  registers.set_text(reg::kManufacturer, 32, "FLIR Systems");
  registers.set_text(reg::kModel, 32, "A655sc (Bolo fake)");
  registers.set_text(reg::kDeviceVersion, 32, "1.0");
  registers.set_text(reg::kManufacturerInfo, 48, "Bolo: replays captures");
  registers.set_text(reg::kSerial, 16, identity.serial);
  registers.set_text(reg::kUserName, 16, identity.user_name);
  registers.writable_text(reg::kUserName, 16);
  std::array<char, 64> url{};
  std::snprintf(url.data(), url.size(), "Local:a655sc.xml;%x;%zx", reg::kDescription, identity.description_bytes);
  registers.set_text(reg::kFirstUrl, 512, url.data());
  registers.set_text(reg::kSecondUrl, 512, url.data());

  registers.set(reg::kInterfaces, 1);
  registers.set(reg::kLinkSpeed, kLinkSpeedMbit);
  registers.set(reg::kStreamChannels, 1);
  registers.set(reg::kStreamCapability, kSourcePortAnd16BitIds);
  registers.set(reg::kGvcpCapability, kCapabilities);
  registers.set(reg::kHeartbeatTimeout, kHeartbeatMs);
  registers.writable(reg::kHeartbeatTimeout,
                     [](std::uint32_t ms) -> WriteOutcome { return std::max(ms, kMinHeartbeatMs); });
  registers.set(reg::kTickFrequencyLow, kTicksPerSecond);
  registers.writable(reg::kGvcpConfig, [](std::uint32_t value) -> WriteOutcome { return value & reg::kHeartbeatOff; });

  registers.writable_range(reg::kStreamPort, 0, 0xffff);
  registers.writable(reg::kStreamAddress, [](std::uint32_t value) -> WriteOutcome { return value; });
  registers.writable_range(reg::kStreamPacketDelay, 0, kMaxPacketDelayTicks);
  registers.set(reg::kStreamPacketSize, kDefaultPacketSize);
}

}  // namespace bolo::fakecam
