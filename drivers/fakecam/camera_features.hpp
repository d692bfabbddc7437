// Register map of the camera, effects of register writes, and the stream settings latched at AcquisitionStart.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "drivers/fakecam/frames.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/stats.hpp"

namespace bolo::fakecam {

// --- Camera memory as GVCP sees it: a page of registers with write rules, and the read-only GenICam description.

// Register addresses: the bootstrap registers of GigE Vision 1.2 (chapter 17) and, from 0xa000, the camera's own.
// Registers that only store their value are defined in description.cpp, constant ones in camera_features.cpp. All are
// big-endian 32-bit words unless noted.
namespace reg {

// Bootstrap
inline constexpr std::uint32_t kVersion = 0x0000;
inline constexpr std::uint32_t kMacLow = 0x000c;
inline constexpr std::uint32_t kIpAddress = 0x0024;
inline constexpr std::uint32_t kSubnetMask = 0x0034;
inline constexpr std::uint32_t kManufacturer = 0x0048;      // 32 bytes
inline constexpr std::uint32_t kModel = 0x0068;             // 32 bytes
inline constexpr std::uint32_t kDeviceVersion = 0x0088;     // 32 bytes
inline constexpr std::uint32_t kManufacturerInfo = 0x00a8;  // 48 bytes
inline constexpr std::uint32_t kSerial = 0x00d8;            // 16 bytes
inline constexpr std::uint32_t kUserName = 0x00e8;          // 16 bytes, writable
inline constexpr std::uint32_t kFirstUrl = 0x0200;          // 512 bytes
inline constexpr std::uint32_t kSecondUrl = 0x0400;         // 512 bytes
inline constexpr std::uint32_t kHeartbeatTimeout = 0x0938;  // ms
inline constexpr std::uint32_t kTickFrequencyLow = 0x0940;
inline constexpr std::uint32_t kTimestampControl = 0x0944;  // bit 1 latch, bit 0 reset
inline constexpr std::uint32_t kTimestampHigh = 0x0948;
inline constexpr std::uint32_t kTimestampLow = 0x094c;
inline constexpr std::uint32_t kGvcpConfig = 0x0954;  // bit 0: heartbeat off
inline constexpr std::uint32_t kPrivilege = 0x0a00;   // bit 1 control, bit 0 exclusive
inline constexpr std::uint32_t kPrimaryPort = 0x0a04;
inline constexpr std::uint32_t kPrimaryAddress = 0x0a14;
inline constexpr std::uint32_t kStreamPort = 0x0d00;         // low half: the receiver's UDP port, 0 closes the channel
inline constexpr std::uint32_t kStreamPacketSize = 0x0d04;   // bit 31 fire test packet, bit 30 do not fragment, 15..0
inline constexpr std::uint32_t kStreamPacketDelay = 0x0d08;  // ticks between packets
inline constexpr std::uint32_t kStreamAddress = 0x0d18;
inline constexpr std::uint32_t kStreamSourcePort = 0x0d1c;

// Camera: image and acquisition
inline constexpr std::uint32_t kSensorWidth = 0xa000;
inline constexpr std::uint32_t kSensorHeight = 0xa004;
inline constexpr std::uint32_t kWidth = 0xa008;
inline constexpr std::uint32_t kHeight = 0xa00c;
inline constexpr std::uint32_t kOffsetX = 0xa010;
inline constexpr std::uint32_t kOffsetY = 0xa014;
inline constexpr std::uint32_t kPixelFormat = 0xa018;
inline constexpr std::uint32_t kPayloadSize = 0xa01c;
inline constexpr std::uint32_t kAcquisitionMode = 0xa020;
inline constexpr std::uint32_t kAcquisitionStart = 0xa024;
inline constexpr std::uint32_t kAcquisitionStop = 0xa028;
inline constexpr std::uint32_t kFrameRate = 0xa02c;  // float, Hz

// Camera: infrared
inline constexpr std::uint32_t kIrFormat = 0xa100;
inline constexpr std::uint32_t kIrWindowing = 0xa104;
inline constexpr std::uint32_t kNucAction = 0xa110;
inline constexpr std::uint32_t kNucCount = 0xa114;
inline constexpr std::uint32_t kAutoFocus = 0xa118;
inline constexpr std::uint32_t kObjectEmissivity = 0xa14c;

// Measurement ranges ("cases")
inline constexpr std::uint32_t kNumCases = 0xa180;
inline constexpr std::uint32_t kQueryCase = 0xa184;
inline constexpr std::uint32_t kQueryCaseLowLimit = 0xa188;   // float, K
inline constexpr std::uint32_t kQueryCaseHighLimit = 0xa18c;  // float, K

// Clock synchronised by PTP (IEEE 1588)
inline constexpr std::uint32_t kPtpEnable = 0xa200;
inline constexpr std::uint32_t kPtpLatch = 0xa204;
inline constexpr std::uint32_t kPtpStatus = 0xa208;  // 2 disabled, 3 listening, 8 slave
inline constexpr std::uint32_t kPtpOffset = 0xa20c;  // ns, signed

inline constexpr std::uint32_t kRegistersEnd = 0xa210;
inline constexpr std::uint32_t kDescription = 0x10000;  // the GenICam XML, read-only

inline constexpr std::uint32_t kPrivilegeExclusive = 1U << 0;
inline constexpr std::uint32_t kPrivilegeControl = 1U << 1;
inline constexpr std::uint32_t kFireTestPacket = 1U << 31;
inline constexpr std::uint32_t kDoNotFragment = 1U << 30;
inline constexpr std::uint32_t kPacketSizeMask = 0xffff;
inline constexpr std::uint32_t kTimestampLatch = 1U << 1;
inline constexpr std::uint32_t kTimestampReset = 1U << 0;
inline constexpr std::uint32_t kHeartbeatOff = 1U << 0;

}  // namespace reg

// Result of a write: the value that the register then holds, or the status of the refusal.
using WriteOutcome = tl::expected<std::uint32_t, gvcp::Status>;
using WriteRule = std::function<WriteOutcome(std::uint32_t value)>;

inline tl::unexpected<gvcp::Status> refuse(gvcp::Status status) { return tl::unexpected<gvcp::Status>(status); }

// Thread: one at a time; the control thread once the camera runs.
class RegisterMap {
 public:
  // `description` is readable from reg::kDescription on, zero-padded to whole words.
  explicit RegisterMap(std::string_view description);

  // Network access, whole words only: otherwise kBadAlignment; outside the registers and the description
  // kInvalidAddress. Gaps between the registers read as zero.
  gvcp::Status read(std::uint32_t address, Bytes out) const;
  // Writes words in order and stops at the first refused one; earlier words stay written.
  gvcp::Status write(std::uint32_t address, ConstBytes in);

  // Access by the camera itself, without rules. `address` must be a register.
  std::uint32_t get(std::uint32_t address) const;
  float get_float(std::uint32_t address) const;
  void set(std::uint32_t address, std::uint32_t value);
  void set_float(std::uint32_t address, float value);
  void set_text(std::uint32_t address, std::size_t field_bytes, std::string_view text);

  // Saves the current values as the power-on state; restores it. Write rules are kept.
  void remember() { power_on_ = registers_; }
  void power_on() { registers_ = power_on_; }

  // Registers without a rule are write-protected.
  void writable(std::uint32_t address, WriteRule rule);
  void writable_range(std::uint32_t address, std::uint32_t min, std::uint32_t max);
  void writable_float(std::uint32_t address, float min, float max);
  void writable_text(std::uint32_t address, std::size_t field_bytes);

 private:
  gvcp::Status write_word(std::uint32_t address, std::uint32_t value);

  std::vector<std::uint8_t> registers_;
  std::vector<std::uint8_t> power_on_;
  std::vector<std::uint8_t> description_;
  std::map<std::uint32_t, WriteRule> rules_;
};

struct Identity {
  std::string serial;  // at most 15 characters
  std::uint32_t address = 0;
  std::uint32_t netmask = 0;
};

// The GenICam description. Thread: any.
std::string_view description();

// Constant registers and registers that only store their value, with the limits of the description. Thread: setup.
void fill_kept(RegisterMap& registers);

// Constant bootstrap registers and those that only store their value. Thread: setup.
void fill_bootstrap(RegisterMap& registers, const Identity& identity);

// Image, acquisition and infrared features. Thread: one at a time; control once the camera runs.
class CameraFeatures {
 public:
  // Called by command registers. A refusal becomes the status of the write.
  struct Actions {
    std::function<gvcp::Status()> start;
    std::function<void()> stop;
    std::function<bool()> streaming;  // image registers are locked while true
    std::function<void()> windowing_changed;
  };

  // `format`: of the capture; `sensor`: size of the served part; `rate_hz`: until a client writes AcquisitionFrameRate.
  CameraFeatures(RegisterMap& registers, Counters& counters, const StreamFormat& format, Geometry sensor,
                 double rate_hz, Actions actions);

  // Restores the power-on state except for the registers.
  void power_on() { offset_x_given_ = offset_y_given_ = false; }

  // Settings latched when a stream starts; region in sensor coordinates.
  Region region() const;
  IrFormat ir_format() const;
  double rate_hz() const;  // 0: the capture's rate
  bool single_frame() const;

 private:
  void fill_image(double rate_hz);
  void fill_infrared(Unit unit);
  void fill_axis(std::uint32_t size_register, std::uint32_t offset_register, std::uint32_t sensor_size,
                 bool& offset_given);
  void fill_cases();
  void fill_ptp();

  WriteOutcome write_windowing(std::uint32_t value);
  void update_payload();
  void image_register(std::uint32_t address, WriteRule rule);  // refuses while streaming
  void command(std::uint32_t address, std::function<void()> action);

  RegisterMap& registers_;
  Counters& counters_;
  Geometry sensor_;
  Actions actions_;
  float capture_rate_hz_;        // rounded to float like the register
  bool offset_x_given_ = false;  // false: the window is centred
  bool offset_y_given_ = false;
};

}  // namespace bolo::fakecam
