#include "drivers/fakecam/camera_features.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

#include <fmt/format.h>

namespace bolo::fakecam {
namespace {

constexpr std::size_t kRegisterBytes = 4;

bool whole_words(std::uint32_t address, std::size_t bytes) {
  return address % kRegisterBytes == 0 && bytes % kRegisterBytes == 0;
}

// Part [address, address + bytes) of `memory`, which starts at `base`; empty when out of range.
ConstBytes window(ConstBytes memory, std::uint32_t base, std::uint32_t address, std::size_t bytes) {
  if (address < base || address - base > memory.size() || bytes > memory.size() - (address - base)) return {};
  return memory.subspan(address - base, bytes);
}

// Bootstrap registers with their constant or initial values.
constexpr std::pair<std::uint32_t, std::uint32_t> kBootstrap[] = {
    {reg::kVersion, 0x00010002},  // GigE Vision 1.2
    {0x0004, 1U << 31 | 1U},      // device mode: big-endian, UTF-8
    {0x0008, 0x0200},             // MAC address: locally administered; the IP address in the low word makes it unique
    {0x0010, 0x6},                // supported IP configurations: link-local and DHCP
    {0x0014, 0x6},                // current one
    {0x0600, 1},                  // network interfaces
    {0x0670, 1000},               // link speed, Mbit/s
    {0x0904, 1},                  // stream channels
    {0x092c, 0xc0000000},         // of the stream: source port, 16-bit ids
    // Concatenated reads and writes, WRITEMEM, PACKETRESEND, primary application registers, link speed, heartbeat
    // switch, serial number, user-defined name.
    {0x0934, 1U | 1U << 1 | 1U << 2 | 1U << 27 | 1U << 28 | 1U << 29 | 1U << 30 | 1U << 31},
    {reg::kHeartbeatTimeout, 3000},
    {reg::kTickFrequencyLow, 1'000'000'000},
    {reg::kStreamPacketSize, 1400},
};
constexpr std::uint32_t kMinHeartbeatMs = 500;
constexpr std::uint32_t kMaxPacketDelayTicks = 10'000'000;

constexpr float kMaxRateHz = 10'000.0F;
constexpr float kMinRateHz = 0.01F;
constexpr std::uint32_t kSingleFrame = 1;
constexpr std::uint32_t kPtpDisabled = 2;  // state numbers of the SFNC
constexpr std::uint32_t kPtpListening = 3;
constexpr std::uint32_t kPtpSlave = 8;
constexpr int kPtpOffset_ns = -37;

// Measurement ranges of an A655sc: -40..150, 100..650 and 300..2000 degrees Celsius.
struct Range {
  float low_k;
  float high_k;
};
constexpr std::array<Range, 3> kCases{{{233.15F, 423.15F}, {373.15F, 923.15F}, {573.15F, 2273.15F}}};

}  // namespace

RegisterMap::RegisterMap(std::string_view description)
    : registers_(reg::kRegistersEnd, 0), description_(description.begin(), description.end()) {
  description_.resize((description_.size() + kRegisterBytes - 1) / kRegisterBytes * kRegisterBytes, 0);
}

gvcp::Status RegisterMap::read(std::uint32_t address, Bytes out) const {
  if (!whole_words(address, out.size())) return gvcp::Status::kBadAlignment;
  ConstBytes found = window(registers_, 0, address, out.size());
  if (found.empty()) found = window(description_, reg::kDescription, address, out.size());
  if (found.empty()) return gvcp::Status::kInvalidAddress;
  std::copy(found.begin(), found.end(), out.begin());
  return gvcp::Status::kSuccess;
}

gvcp::Status RegisterMap::write(std::uint32_t address, ConstBytes in) {
  if (!whole_words(address, in.size())) return gvcp::Status::kBadAlignment;
  for (std::size_t at = 0; at < in.size(); at += kRegisterBytes) {
    const auto status = write_word(address + static_cast<std::uint32_t>(at), load_u32(in, at));
    if (status != gvcp::Status::kSuccess) return status;
  }
  return gvcp::Status::kSuccess;
}

gvcp::Status RegisterMap::write_word(std::uint32_t address, std::uint32_t value) {
  const bool known = !window(registers_, 0, address, kRegisterBytes).empty() ||
                     !window(description_, reg::kDescription, address, kRegisterBytes).empty();
  if (!known) return gvcp::Status::kInvalidAddress;
  const auto rule = rules_.find(address);
  if (rule == rules_.end()) return gvcp::Status::kWriteProtect;
  const WriteOutcome outcome = rule->second(value);
  if (!outcome) return outcome.error();
  set(address, *outcome);
  return gvcp::Status::kSuccess;
}

std::uint32_t RegisterMap::get(std::uint32_t address) const { return load_u32(registers_, address); }

float RegisterMap::get_float(std::uint32_t address) const { return std::bit_cast<float>(get(address)); }

void RegisterMap::set(std::uint32_t address, std::uint32_t value) { store_u32(registers_, address, value); }

void RegisterMap::set_float(std::uint32_t address, float value) { set(address, std::bit_cast<std::uint32_t>(value)); }

void RegisterMap::set_text(std::uint32_t address, std::size_t field_bytes, std::string_view text) {
  const auto field = Bytes(registers_).subspan(address, field_bytes);
  std::fill(field.begin(), field.end(), std::uint8_t{0});
  const std::size_t length = std::min(text.size(), field_bytes - 1);  // leaves room for the terminating zero
  std::copy_n(text.begin(), length, field.begin());
}

void RegisterMap::writable(std::uint32_t address, WriteRule rule) { rules_[address] = std::move(rule); }

void RegisterMap::writable_range(std::uint32_t address, std::uint32_t min, std::uint32_t max) {
  writable(address, [min, max](std::uint32_t value) -> WriteOutcome {
    if (value < min || value > max) return refuse(gvcp::Status::kInvalidParameter);
    return value;
  });
}

void RegisterMap::writable_float(std::uint32_t address, float min, float max) {
  writable(address, [min, max](std::uint32_t value) -> WriteOutcome {
    const auto number = std::bit_cast<float>(value);
    if (!(number >= min && number <= max)) return refuse(gvcp::Status::kInvalidParameter);  // also refuses NaN
    return value;
  });
}

void RegisterMap::writable_text(std::uint32_t address, std::size_t field_bytes) {
  for (std::uint32_t at = 0; at < field_bytes; at += kRegisterBytes) {
    writable(address + at, [](std::uint32_t value) -> WriteOutcome { return value; });
  }
}

void fill_bootstrap(RegisterMap& registers, const Identity& identity) {
  for (const auto& [address, value] : kBootstrap) registers.set(address, value);
  registers.set(reg::kMacLow, identity.address);
  registers.set(reg::kIpAddress, identity.address);
  registers.set(reg::kSubnetMask, identity.netmask);
  registers.set_text(reg::kManufacturer, 32, "FLIR Systems");
  registers.set_text(reg::kModel, 32, "A655sc (Bolo fake)");
  registers.set_text(reg::kDeviceVersion, 32, "1.0");
  registers.set_text(reg::kManufacturerInfo, 48, "Bolo: replays captures");
  registers.set_text(reg::kSerial, 16, identity.serial);
  registers.writable_text(reg::kUserName, 16);
  const std::string url = fmt::format("Local:a655sc.xml;{:x};{:x}", reg::kDescription, description().size());
  registers.set_text(reg::kFirstUrl, 512, url);
  registers.set_text(reg::kSecondUrl, 512, url);

  registers.writable(reg::kHeartbeatTimeout,
                     [](std::uint32_t ms) -> WriteOutcome { return std::max(ms, kMinHeartbeatMs); });
  registers.writable(reg::kGvcpConfig, [](std::uint32_t value) -> WriteOutcome { return value & reg::kHeartbeatOff; });

  registers.writable_range(reg::kStreamPort, 0, 0xffff);
  registers.writable(reg::kStreamAddress, [](std::uint32_t value) -> WriteOutcome { return value; });
  registers.writable_range(reg::kStreamPacketDelay, 0, kMaxPacketDelayTicks);
}

CameraFeatures::CameraFeatures(RegisterMap& registers, Counters& counters, const StreamFormat& format, Geometry sensor,
                               double rate_hz, Actions actions)
    : registers_(registers),
      counters_(counters),
      sensor_(sensor),
      actions_(std::move(actions)),
      capture_rate_hz_(static_cast<float>(1.0 / format.frame_period_s)) {
  fill_image(rate_hz);
  fill_infrared(format.scale.unit);
  fill_kept(registers_);
  fill_cases();
  fill_ptp();
}

void CameraFeatures::fill_image(double rate_hz) {
  registers_.set(reg::kSensorWidth, static_cast<std::uint32_t>(sensor_.width));
  registers_.set(reg::kSensorHeight, static_cast<std::uint32_t>(sensor_.height));
  fill_axis(reg::kWidth, reg::kOffsetX, static_cast<std::uint32_t>(sensor_.width), offset_x_given_);
  fill_axis(reg::kHeight, reg::kOffsetY, static_cast<std::uint32_t>(sensor_.height), offset_y_given_);
  registers_.set(reg::kPixelFormat, gvsp::kMono16);
  registers_.set_float(reg::kFrameRate, static_cast<float>(rate_hz));
  update_payload();
  registers_.writable_range(reg::kPixelFormat, gvsp::kMono16, gvsp::kMono16);
  registers_.writable_float(reg::kFrameRate, kMinRateHz, kMaxRateHz);
  registers_.writable(reg::kAcquisitionStart, [this](std::uint32_t) -> WriteOutcome {
    const auto status = actions_.start();
    if (status != gvcp::Status::kSuccess) return refuse(status);
    return 0U;
  });
  command(reg::kAcquisitionStop, [this] { actions_.stop(); });
}

// Width or Height with its offset: an offset that the client has not written keeps the window centred.
void CameraFeatures::fill_axis(std::uint32_t size_register, std::uint32_t offset_register, std::uint32_t sensor_size,
                               bool& offset_given) {
  registers_.set(size_register, sensor_size);
  image_register(size_register, [=, this, &offset_given](std::uint32_t value) -> WriteOutcome {
    if (value == 0 || value > sensor_size) return refuse(gvcp::Status::kInvalidParameter);
    const std::uint32_t room = sensor_size - value;
    const std::uint32_t offset = registers_.get(offset_register);
    registers_.set(offset_register, offset_given ? std::min(offset, room) : room / 2);
    registers_.set(size_register, value);
    update_payload();
    return value;
  });
  image_register(offset_register, [=, this, &offset_given](std::uint32_t value) -> WriteOutcome {
    if (value > sensor_size - registers_.get(size_register)) return refuse(gvcp::Status::kInvalidParameter);
    offset_given = true;
    return value;
  });
}

// Off, Half, Quarter: all columns, the middle rows.
WriteOutcome CameraFeatures::write_windowing(std::uint32_t value) {
  if (value > 2) return refuse(gvcp::Status::kInvalidParameter);
  if (value != registers_.get(reg::kIrWindowing)) actions_.windowing_changed();
  const auto sensor_rows = static_cast<std::uint32_t>(sensor_.height);
  const std::uint32_t rows = std::max(sensor_rows >> value, 1U);
  offset_y_given_ = false;
  registers_.set(reg::kHeight, rows);
  registers_.set(reg::kOffsetY, (sensor_rows - rows) / 2);
  update_payload();
  return value;
}

void CameraFeatures::update_payload() {
  registers_.set(reg::kPayloadSize, registers_.get(reg::kWidth) * registers_.get(reg::kHeight) * 2);
}

void CameraFeatures::fill_infrared(Unit unit) {
  const auto format = unit == Unit::kKelvin ? IrFormat::kTemperatureLinear10mK : IrFormat::kRadiometric;
  registers_.set(reg::kIrFormat, static_cast<std::uint32_t>(format));
  image_register(reg::kIrFormat, [](std::uint32_t value) -> WriteOutcome {
    if (value > static_cast<std::uint32_t>(IrFormat::kTemperatureLinear10mK)) {
      return refuse(gvcp::Status::kInvalidParameter);
    }
    return value;
  });
  image_register(reg::kIrWindowing, [this](std::uint32_t value) { return write_windowing(value); });
  command(reg::kNucAction, [this] {
    registers_.set(reg::kNucCount, registers_.get(reg::kNucCount) + 1);
    counters_.add(&FakeCameraStats::nuc_actions);
  });
  command(reg::kAutoFocus, [] {});
}

void CameraFeatures::fill_cases() {
  const auto show = [this](std::uint32_t which) {
    registers_.set_float(reg::kQueryCaseLowLimit, kCases[which].low_k);
    registers_.set_float(reg::kQueryCaseHighLimit, kCases[which].high_k);
  };
  registers_.set(reg::kNumCases, kCases.size());
  registers_.writable(reg::kQueryCase, [show](std::uint32_t value) -> WriteOutcome {
    if (value >= kCases.size()) return refuse(gvcp::Status::kInvalidParameter);
    show(value);
    return value;
  });
  show(0);
}

// After enabling, the first latch reports "listening", later ones "slave".
void CameraFeatures::fill_ptp() {
  registers_.set(reg::kPtpStatus, kPtpDisabled);
  registers_.writable(reg::kPtpEnable, [this](std::uint32_t value) -> WriteOutcome {
    if (value > 1) return refuse(gvcp::Status::kInvalidParameter);
    if (value == 0) registers_.set(reg::kPtpStatus, kPtpDisabled);
    return value;
  });
  command(reg::kPtpLatch, [this] {
    if (registers_.get(reg::kPtpEnable) == 0) return;
    const bool listens = registers_.get(reg::kPtpStatus) == kPtpDisabled;
    registers_.set(reg::kPtpStatus, listens ? kPtpListening : kPtpSlave);
    registers_.set(reg::kPtpOffset, listens ? 0U : static_cast<std::uint32_t>(kPtpOffset_ns));
  });
}

void CameraFeatures::image_register(std::uint32_t address, WriteRule rule) {
  registers_.writable(address, [this, rule = std::move(rule)](std::uint32_t value) -> WriteOutcome {
    if (actions_.streaming()) return refuse(gvcp::Status::kBusy);
    return rule(value);
  });
}

void CameraFeatures::command(std::uint32_t address, std::function<void()> action) {
  registers_.writable(address, [action = std::move(action)](std::uint32_t) -> WriteOutcome {
    action();
    return 0U;
  });
}

Region CameraFeatures::region() const {
  const auto value = [this](std::uint32_t address) { return static_cast<int>(registers_.get(address)); };
  return {value(reg::kOffsetX), value(reg::kOffsetY), value(reg::kWidth), value(reg::kHeight)};
}

IrFormat CameraFeatures::ir_format() const { return static_cast<IrFormat>(registers_.get(reg::kIrFormat)); }

double CameraFeatures::rate_hz() const {
  const float rate = registers_.get_float(reg::kFrameRate);
  return rate == capture_rate_hz_ ? 0.0 : static_cast<double>(rate);
}

bool CameraFeatures::single_frame() const { return registers_.get(reg::kAcquisitionMode) == kSingleFrame; }

}  // namespace bolo::fakecam
