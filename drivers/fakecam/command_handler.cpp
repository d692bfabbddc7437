#include "drivers/fakecam/command_handler.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::size_t kWordBytes = 4;
constexpr std::uint32_t kPrivilegeBits = reg::kPrivilegeExclusive | reg::kPrivilegeControl;
constexpr std::int64_t kNsPerMs = 1'000'000;

bool is(std::uint16_t command, gvcp::Command which) { return command == static_cast<std::uint16_t>(which); }

}  // namespace

CommandHandler::CommandHandler(RegisterMap& registers, Counters& counters, Hooks hooks)
    : registers_(registers), counters_(counters), hooks_(std::move(hooks)) {
  registers_.writable(reg::kPrivilege, [this](std::uint32_t value) { return write_privilege(value); });
}

ConstBytes CommandHandler::handle(ConstBytes packet, Peer peer, std::int64_t now_ns) {
  check_heartbeat(now_ns);
  if (packet.size() < gvcp::kHeaderBytes || packet[0] != gvcp::kKey) {  // not GVCP, or an answer: nothing to say
    counters_.add(&FakeCameraStats::bad_commands);
    return {};
  }
  peer_ = peer;
  now_ns_ = now_ns;
  data_bytes_ = 0;
  const Header header{packet[1], load_u16(packet, 2), load_u16(packet, 6)};
  const ConstBytes data = packet.subspan(gvcp::kHeaderBytes);
  const bool whole = load_u16(packet, 4) == data.size();
  const gvcp::Status status = whole ? dispatch(header.command, data) : gvcp::Status::kInvalidHeader;
  if (may_write()) last_command_ns_ = now_ns;
  counters_.add(status == gvcp::Status::kSuccess ? &FakeCameraStats::commands : &FakeCameraStats::bad_commands);
  const bool wants_answer =
      (header.flags & gvcp::kAckRequired) != 0 && !is(header.command, gvcp::Command::kPacketResend);
  return wants_answer ? acknowledge(header, status) : ConstBytes{};
}

ConstBytes CommandHandler::handle_broadcast(ConstBytes packet, Peer peer, std::int64_t now_ns) {
  if (packet.size() < gvcp::kHeaderBytes || !is(load_u16(packet, 2), gvcp::Command::kDiscovery)) return {};
  return handle(packet, peer, now_ns);
}

gvcp::Status CommandHandler::dispatch(std::uint16_t command, ConstBytes data) {
  switch (static_cast<gvcp::Command>(command)) {
    case gvcp::Command::kDiscovery:
      return discover(data);
    case gvcp::Command::kReadRegister:
      return read_registers(data);
    case gvcp::Command::kWriteRegister:
      return write_registers(data);
    case gvcp::Command::kReadMemory:
      return read_memory(data);
    case gvcp::Command::kWriteMemory:
      return write_memory(data);
    case gvcp::Command::kPacketResend:
      return resend(data);
    case gvcp::Command::kForceIp:
      break;
  }
  return gvcp::Status::kNotImplemented;
}

gvcp::Status CommandHandler::discover(ConstBytes) {
  data_bytes_ = gvcp::kDiscoveryBytes;
  return registers_.read(0, data().first(gvcp::kDiscoveryBytes));
}

// Addresses in, values out; the answer to a failed read ends before the register that failed.
gvcp::Status CommandHandler::read_registers(ConstBytes addresses) {
  if (addresses.empty() || addresses.size() % kWordBytes != 0 || addresses.size() > gvcp::kMaxDataBytes) {
    return gvcp::Status::kInvalidParameter;
  }
  if (!may_read()) return gvcp::Status::kAccessDenied;
  for (std::size_t at = 0; at < addresses.size(); at += kWordBytes) {
    const auto status = registers_.read(load_u32(addresses, at), data().subspan(at, kWordBytes));
    if (status != gvcp::Status::kSuccess) return status;
    data_bytes_ += kWordBytes;
  }
  return gvcp::Status::kSuccess;
}

// Pairs of address and value; the answer holds how many were written.
gvcp::Status CommandHandler::write_registers(ConstBytes pairs) {
  constexpr std::size_t kPairBytes = 2 * kWordBytes;
  if (pairs.empty() || pairs.size() % kPairBytes != 0) return gvcp::Status::kInvalidParameter;
  data_bytes_ = kWordBytes;
  store_u32(data(), 0, 0);
  for (std::size_t at = 0; at < pairs.size(); at += kPairBytes) {
    const std::uint32_t address = load_u32(pairs, at);
    if (address != reg::kPrivilege && !may_write()) return gvcp::Status::kAccessDenied;
    const auto status = registers_.write(address, pairs.subspan(at + kWordBytes, kWordBytes));
    if (status != gvcp::Status::kSuccess) return status;
    store_u16(data(), 2, static_cast<std::uint16_t>(at / kPairBytes + 1));
  }
  return gvcp::Status::kSuccess;
}

gvcp::Status CommandHandler::read_memory(ConstBytes request) {
  if (request.size() != 2 * kWordBytes) return gvcp::Status::kInvalidParameter;
  const std::uint32_t address = load_u32(request, 0);
  const std::size_t count = load_u16(request, 6);
  if (count == 0 || count > gvcp::kMaxMemoryBytes) return gvcp::Status::kInvalidParameter;
  if (!may_read()) return gvcp::Status::kAccessDenied;
  const auto status = registers_.read(address, data().subspan(kWordBytes, count));
  if (status != gvcp::Status::kSuccess) return status;
  store_u32(data(), 0, address);
  data_bytes_ = kWordBytes + count;
  return status;
}

gvcp::Status CommandHandler::write_memory(ConstBytes request) {
  if (request.size() <= kWordBytes) return gvcp::Status::kInvalidParameter;
  if (!may_write()) return gvcp::Status::kAccessDenied;
  const ConstBytes values = request.subspan(kWordBytes);
  const auto status = registers_.write(load_u32(request, 0), values);
  data_bytes_ = kWordBytes;
  store_u32(data(), 0, status == gvcp::Status::kSuccess ? static_cast<std::uint32_t>(values.size()) : 0);
  return status;
}

// Not acknowledged: the packets are the answer. A receiver asks from its stream socket, so any peer may.
gvcp::Status CommandHandler::resend(ConstBytes request) {
  constexpr std::size_t kRequestBytes = 12;
  if (request.size() < kRequestBytes) return gvcp::Status::kInvalidParameter;
  const ResendRequest wanted{load_u16(request, 2), load_u32(request, 4) & 0xffffffU, load_u32(request, 8) & 0xffffffU};
  if (wanted.last_packet < wanted.first_packet) return gvcp::Status::kInvalidParameter;
  hooks_.on_resend(wanted);
  return gvcp::Status::kSuccess;
}

WriteOutcome CommandHandler::write_privilege(std::uint32_t value) {
  if (controlled_ && peer_ != controller_) return refuse(gvcp::Status::kAccessDenied);
  const std::uint32_t wanted = value & kPrivilegeBits;
  if (wanted == 0) {
    drop_client();
    return 0U;
  }
  if (!controlled_) counters_.add(&FakeCameraStats::clients);
  controlled_ = true;
  controller_ = peer_;
  last_command_ns_ = now_ns_;
  counters_.set(&FakeCameraStats::controlled, true);
  registers_.set(reg::kPrimaryAddress, peer_.address);
  registers_.set(reg::kPrimaryPort, peer_.port);
  return wanted;
}

void CommandHandler::lose_control() {
  controlled_ = false;
  controller_ = {};
  counters_.set(&FakeCameraStats::controlled, false);
  registers_.set(reg::kPrivilege, 0);
  registers_.set(reg::kPrimaryAddress, 0);
  registers_.set(reg::kPrimaryPort, 0);
  hooks_.on_control_lost();
}

void CommandHandler::drop_client() {
  if (controlled_) lose_control();
}

void CommandHandler::check_heartbeat(std::int64_t now_ns) {
  if (!controlled_ || (registers_.get(reg::kGvcpConfig) & reg::kHeartbeatOff) != 0) return;
  if (now_ns - last_command_ns_ <= registers_.get(reg::kHeartbeatTimeout) * kNsPerMs) return;
  counters_.add(&FakeCameraStats::heartbeat_losses);
  lose_control();
}

bool CommandHandler::may_read() const {
  return !controlled_ || peer_ == controller_ || (registers_.get(reg::kPrivilege) & reg::kPrivilegeExclusive) == 0;
}

ConstBytes CommandHandler::acknowledge(const Header& header, gvcp::Status status) {
  const Bytes head(answer_);
  store_u16(head, 0, static_cast<std::uint16_t>(status));
  store_u16(head, 2, gvcp::ack_of(header.command));
  store_u16(head, 4, static_cast<std::uint16_t>(data_bytes_));
  store_u16(head, 6, header.id);
  return ConstBytes(answer_).first(gvcp::kHeaderBytes + data_bytes_);
}

}  // namespace bolo::fakecam
