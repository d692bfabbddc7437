#include "drivers/fakecam/fault_script.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/core/clock.hpp"
#include "src/core/text.hpp"

namespace bolo::fakecam {
namespace {

constexpr double kForEver = std::numeric_limits<double>::infinity();
constexpr double kLongest = 1e6;  // s: eleven days

FaultKey at_key() {
  return {"at", "s", 0.0, 0.0, kLongest, false, "after the first stream's start; goes on through later streams"};
}
FaultKey every_key() { return {"every", "s", kForEver, 0.001, kLongest, false, "from one strike to the next"}; }
FaultKey for_key(double standard) { return {"for", "s", standard, 0.001, kLongest, false, "how long"}; }
FaultKey frames_key() { return {"frames", "", kForEver, 1.0, 1e9, true, "how long, in frames; instead of for"}; }
FaultKey seed_key() { return {"seed", "", 1.0, 0.0, 1e9, true, "another choice of packets"}; }

// Keys of faults that strike once (once), last for a while (lasting, silence), or strike random packets (of_packets).
std::vector<FaultKey> once(std::vector<FaultKey> own) {
  own.insert(own.end(), {at_key(), every_key()});
  return own;
}
std::vector<FaultKey> lasting(std::vector<FaultKey> own, double standard_s) {
  own.insert(own.end(), {at_key(), for_key(standard_s), frames_key(), every_key()});
  return own;
}
std::vector<FaultKey> silence(double standard_s) { return {at_key(), for_key(standard_s), every_key()}; }
std::vector<FaultKey> of_packets(std::vector<FaultKey> own) {
  own.insert(own.begin(), {"rate", "", 0.01, 0.0, 1.0, false, "share of the packets"});
  own.push_back(seed_key());
  return lasting(std::move(own), kForEver);
}

std::vector<FaultType> make_types() {
  return {
      {FaultKind::kLoss, "loss", "packets never arrive; resent ones neither", of_packets({})},
      {FaultKind::kReorder, "reorder", "packets arrive after later ones of their frame",
       of_packets({{"by", "", 1.0, 1.0, 1000.0, true, "how many packets later"}})},
      {FaultKind::kDuplicate, "duplicate", "packets arrive twice", of_packets({})},
      {FaultKind::kGarbage, "garbage", "packets arrive between the camera's that are none: noise, and forged headers",
       of_packets({{"bytes", "", 44.0, 0.0, 44.0, true, "of the longest; a header has 8, with extended ids 20"}})},
      {FaultKind::kNoResend, "resend_unanswered",
       "the camera claims resends and answers no request for frames of that time", lasting({}, kForEver)},
      {FaultKind::kIdGap, "id_gap", "the frame counter jumps, the clock does not",
       once({{"ids", "", 1.0, 1.0, 30000.0, true, "that no frame gets"}})},
      {FaultKind::kTimeJump, "time_jump", "the camera's clock jumps, the frame counter does not",
       once({{"by", "s", 1.0, -1e4, 1e4, false, "ahead, or back"}})},
      {FaultKind::kStall, "stall", "no frames, the camera answers; its counter and clock go on", lasting({}, 0.4)},
      {FaultKind::kFreeze, "freeze", "no frames and no answers, then as if nothing had been", lasting({}, 0.4)},
      {FaultKind::kControlLoss, "control_loss", "the client's control is taken away, its stream ends", once({})},
      {FaultKind::kReboot, "reboot", "silent, then registers, stream and client are forgotten", silence(1.0)},
      {FaultKind::kNuc, "nuc", "a shutter: the last frame is repeated, then all pixels are off by a little more",
       lasting({{"offset", "K", 0.5, -100.0, 100.0, false, "of all pixels after each; counts when radiometric"}}, 0.4)},
      {FaultKind::kByteOrder, "byte_order", "pixels come with their bytes swapped", lasting({}, kForEver)},
      {FaultKind::kMetadataRows, "metadata_rows", "the last rows hold metadata: the frame counter in bytes 12 and 13",
       lasting({{"rows", "", 3.0, 1.0, 16.0, true, "of each frame"}}, kForEver)},
      {FaultKind::kWindowingDrop, "windowing_drop", "a change of IRWindowing drops the connection, as an A655sc does",
       std::vector<FaultKey>{for_key(4.0)}},
  };
}

const FaultKey* find_key(const FaultType& type, std::string_view key) {
  const auto found = std::ranges::find(type.keys, key, &FaultKey::key);
  return found == type.keys.end() ? nullptr : &*found;
}

Result<const FaultType*> find_type(std::string_view name) {
  std::vector<std::string_view> names;
  for (const FaultType& type : fault_types()) {
    if (type.name == name) return &type;
    names.push_back(type.name);
  }
  return bad_input(did_you_mean("fault", name, names) + " (bolo fakecam --list-faults shows all)");
}

Status check_value(const std::string& where, const FaultKey& key, double value) {
  const bool fits = value >= key.low && value <= key.high && (!key.whole || value == std::floor(value));
  if (fits) return {};
  return bad_input(where + std::string(key.key) + "=" + shortest(value) + ": expected " +
                   (key.whole ? "a whole number from " : "") + shortest(key.low) + " to " + shortest(key.high));
}

Status take_item(Fault& fault, std::string_view item) {
  const std::string where = "fault " + std::string(fault.type->name) + ": ";
  const std::size_t equals = item.find('=');
  if (equals == std::string_view::npos || equals == 0) {
    return bad_input(where + "'" + std::string(item) + "': expected key=value");
  }
  const std::string_view name = item.substr(0, equals);
  const std::string_view text = item.substr(equals + 1);
  const FaultKey* key = find_key(*fault.type, name);
  if (key == nullptr) {
    std::vector<std::string_view> keys;
    for (const FaultKey& k : fault.type->keys) keys.push_back(k.key);
    return bad_input(where + did_you_mean("key", name, keys));
  }
  if (fault.given(name)) return bad_input(where + std::string(name) + " is given twice");
  const std::optional<double> value = number_of(text);
  if (!value) return bad_input(where + std::string(name) + "=" + std::string(text) + ": expected a number");
  if (Status fine = check_value(where, *key, *value); !fine) return fine;
  fault.values.emplace(name, *value);
  return {};
}

Status check_together(const Fault& fault) {
  const std::string where = "fault " + std::string(fault.type->name) + ": ";
  if (fault.given("for") && fault.given("frames")) return bad_input(where + "give for or frames, not both");
  if (!fault.given("every") || !fault.has("for") || fault.given("frames")) return {};
  const double lasts_s = fault.value("for");
  if (lasts_s < fault.value("every")) return {};
  return bad_input(where + "every=" + shortest(fault.value("every")) + " must be longer than a strike lasts: " +
                   (std::isfinite(lasts_s) ? shortest(lasts_s) : "for ever") + "; set for");
}

// A time that never comes; a quarter of the range, so that sums do not overflow.
constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max() / 4;

}  // namespace

bool Fault::has(std::string_view key) const { return find_key(*type, key) != nullptr; }

double Fault::value(std::string_view key) const {
  const auto found = values.find(key);
  if (found != values.end()) return found->second;
  const FaultKey* const known = find_key(*type, key);
  return known != nullptr ? known->standard : 0.0;
}

std::span<const FaultType> fault_types() {
  static const std::vector<FaultType> kTypes = make_types();
  return kTypes;
}

Result<Fault> parse_fault(std::string_view text) {
  const std::size_t colon = text.find(':');
  ASSIGN_OR_RETURN(const auto type, find_type(text.substr(0, colon)));
  Fault fault{type, {}};
  for (std::string_view rest = colon == std::string_view::npos ? "" : text.substr(colon); !rest.empty();) {
    rest.remove_prefix(1);  // the colon, or a comma
    const std::size_t comma = std::min(rest.find(','), rest.size());
    RETURN_IF_ERROR(take_item(fault, rest.substr(0, comma)));
    rest.remove_prefix(comma);
  }
  RETURN_IF_ERROR(check_together(fault));
  return fault;
}

std::string fault_text(const Fault& fault) {
  std::string text(fault.type->name);
  char separator = ':';
  for (const auto& [key, value] : fault.values) {
    text += separator + key + "=" + shortest(value);
    separator = ',';
  }
  return text;
}

std::uint64_t Schedule::begun(std::int64_t time_ns) const noexcept {
  if (time_ns < at_ns) return 0;
  return every_ns == 0 ? 1 : static_cast<std::uint64_t>((time_ns - at_ns) / every_ns) + 1;
}

std::uint64_t Schedule::ended(std::int64_t time_ns) const noexcept { return begun(time_ns - for_ns); }

Schedule schedule_of(const Fault& fault, std::int64_t period_ns) {
  Schedule schedule;
  if (fault.has("at")) schedule.at_ns = to_ns(fault.value("at"));
  if (fault.given("frames")) {
    schedule.for_ns = std::llround(fault.value("frames")) * period_ns;
  } else if (fault.has("for")) {
    schedule.for_ns = std::isfinite(fault.value("for")) ? to_ns(fault.value("for")) : kNever;
  }
  if (fault.given("every")) schedule.every_ns = to_ns(fault.value("every"));
  return schedule;
}

Schedule frame_schedule_of(const Fault& fault, std::int64_t period_ns) {
  Schedule schedule = schedule_of(fault, period_ns);
  schedule.at_ns -= period_ns / 2;
  return schedule;
}

FaultTallies::FaultTallies(const FaultScript& script) : script_(script) {
  for (const Fault& fault : script_) tallies_.push_back({fault_text(fault), 0, 0, 0});
}

void FaultTallies::add(std::size_t place, std::uint64_t InjectedFault::*count, std::uint64_t n) noexcept {
  const std::lock_guard lock(mutex_);
  tallies_[place].*count += n;
}

void FaultTallies::add_frame(FaultSet hit, FaultSet struck) noexcept {
  for (; hit != 0; hit &= hit - 1) add_frames(static_cast<std::size_t>(std::countr_zero(hit)));
  for (; struck != 0; struck &= struck - 1) {
    const auto place = static_cast<std::size_t>(std::countr_zero(struck));
    add_time(place);
    const Fault& fault = script_[place];
    if (fault.kind() == FaultKind::kIdGap) add_frames(place, static_cast<std::uint64_t>(fault.value("ids")));
  }
}

std::vector<InjectedFault> FaultTallies::read() const {
  const std::lock_guard lock(mutex_);
  return tallies_;
}

}  // namespace bolo::fakecam
