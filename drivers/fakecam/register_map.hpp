// The camera's memory as GVCP sees it: a page of registers with write rules, and the read-only GenICam description.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <tl/expected.hpp>

#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/registers.hpp"

namespace bolo::fakecam {

// Result of a write: the value that the register then holds, or the reason for its refusal.
using WriteOutcome = tl::expected<std::uint32_t, gvcp::Status>;
using WriteRule = std::function<WriteOutcome(std::uint32_t value)>;

inline tl::unexpected<gvcp::Status> refuse(gvcp::Status status) { return tl::unexpected<gvcp::Status>(status); }

// Thread: one at a time; the control thread once the camera runs.
class RegisterMap {
 public:
  // `description` is readable from reg::kDescription on, padded with zeros to whole words.
  explicit RegisterMap(std::string_view description);

  // Access from the network. Whole words only: anything else is kBadAlignment, beyond the registers and the description
  // kInvalidAddress. Holes between the registers read as zero.
  gvcp::Status read(std::uint32_t address, Bytes out) const;
  // Words are written in order; the first refused one ends the write, those before it stay written.
  gvcp::Status write(std::uint32_t address, ConstBytes in);

  // Access from the camera itself: no rules. `address` is a register's.
  std::uint32_t get(std::uint32_t address) const;
  float get_float(std::uint32_t address) const;
  void set(std::uint32_t address, std::uint32_t value);
  void set_float(std::uint32_t address, float value);
  void set_text(std::uint32_t address, std::size_t field_bytes, std::string_view text);

  // Keeps all values as those at power-on; goes back to them. Rules stay.
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

}  // namespace bolo::fakecam
