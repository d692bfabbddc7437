#include "drivers/fakecam/register_map.hpp"

#include <algorithm>
#include <bit>

namespace bolo::fakecam {
namespace {

constexpr std::size_t kRegisterBytes = 4;

bool whole_words(std::uint32_t address, std::size_t bytes) {
  return address % kRegisterBytes == 0 && bytes % kRegisterBytes == 0;
}

// The part [address, address + bytes) of `memory`, which starts at `base`; empty when it lies outside.
ConstBytes window(ConstBytes memory, std::uint32_t base, std::uint32_t address, std::size_t bytes) {
  if (address < base || address - base > memory.size() || bytes > memory.size() - (address - base)) return {};
  return memory.subspan(address - base, bytes);
}

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
  const std::size_t length = std::min(text.size(), field_bytes - 1);  // one zero ends it
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
    if (!(number >= min && number <= max)) return refuse(gvcp::Status::kInvalidParameter);  // also not a number
    return value;
  });
}

void RegisterMap::writable_text(std::uint32_t address, std::size_t field_bytes) {
  for (std::uint32_t at = 0; at < field_bytes; at += kRegisterBytes) {
    writable(address + at, [](std::uint32_t value) -> WriteOutcome { return value; });
  }
}

}  // namespace bolo::fakecam
