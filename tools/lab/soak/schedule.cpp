#include "tools/lab/soak/schedule.hpp"

#include <algorithm>
#include <array>

#include "tools/lab/common.hpp"

namespace bolo::tools::soak {
namespace {

// Recovery times are limits for a machine in shared use. The slow ones: a silent camera is polled after 0.2 s and
// reopened, including its start-up; a killed daemon is restarted after 0.3 s, and promised to be back 2 s after the
// kill (PROMISES.md).
// AT, FOR: of the disturbance; LONGER: includes later requests for lost packets.
constexpr std::array<KindInfo, 27> kKinds{{
    {Kind::kLoss, "loss", 0.3, 0.8, 3.0, 2.2, "at=AT,for=FOR,rate=RATE,seed=SEED"},
    {Kind::kReorder, "reorder", 0.3, 0.8, 3.0, 2.2, "at=AT,for=FOR,rate=RATE,seed=SEED"},
    {Kind::kDuplicate, "duplicate", 0.3, 0.8, 3.0, 2.2, "at=AT,for=FOR,rate=RATE,seed=SEED"},
    {Kind::kGarbage, "garbage", 0.3, 0.8, 4.0, 2.4, "at=AT,for=FOR,rate=RATE,seed=SEED"},
    {Kind::kNoResend, "resend_unanswered", 0.3, 0.8, 3.0, 2.4,
     "at=AT,for=LONGER loss:at=AT,for=FOR,rate=RATE,seed=SEED"},
    {Kind::kIdGap, "id_gap", 0.0, 0.0, 3.0, 1.6, "at=AT,ids=IDS"},
    {Kind::kTimeJump, "time_jump", 0.0, 0.0, 3.0, 1.6, "at=AT,by=BY"},
    {Kind::kStall, "stall", 0.2, 0.6, 6.0, 2.6, "at=AT,for=FOR"},
    {Kind::kFreeze, "freeze", 0.3, 1.0, 8.0, 3.6, "at=AT,for=FOR"},
    {Kind::kControlLoss, "control_loss", 0.0, 0.0, 10.0, 3.2, "at=AT"},
    {Kind::kReboot, "reboot", 0.5, 1.0, 10.0, 4.2, "at=AT,for=FOR"},
    {Kind::kShutter, "nuc", 0.3, 0.5, 3.0, 2.2, "at=AT,for=FOR,offset=0.5"},
    {Kind::kWindowingDrop, "windowing_drop", 0.5, 1.0, 15.0, 4.5, "for=FOR"},
    {Kind::kCameraStopped, "camera_stopped", 0.3, 1.0, 10.0, 4.0},
    {Kind::kCameraReplaced, "camera_replaced", 0.3, 0.8, 15.0, 4.5},
    {Kind::kDaemonStopped, "daemon_stopped", 0.2, 1.2, 5.0, 3.4},
    {Kind::kDaemonKilled, "daemon_killed", 0.3, 0.3, 1.7, 5.0},
    {Kind::kReaderKilled, "reader_killed", 0.2, 0.5, 2.0, 1.6},
    {Kind::kReaderStopped, "reader_stopped", 0.5, 1.2, 2.0, 2.2},
    {Kind::kRecording, "recording", 1.0, 1.5, 3.0, 3.0},
    {Kind::kRecorderKilled, "recorder_killed", 1.2, 1.8, 3.0, 3.2},
    {Kind::kDiskFull, "disk_full", 1.5, 2.5, 3.0, 3.8},
    {Kind::kCpuTaken, "cpu_taken", 0.8, 1.5, 5.0, 3.2},
    {Kind::kMemoryTaken, "memory_taken", 0.8, 1.5, 5.0, 3.2},
    {Kind::kReload, "reload", 0.0, 0.0, 2.0, 1.4},
    {Kind::kBadReload, "bad_reload", 0.5, 0.5, 2.0, 1.8},
    {Kind::kCorrection, "correction", 0.6, 0.6, 3.0, 2.4},
}};

constexpr double kFirstQuiet_s = 2.5;  // before the first disturbance of a round: the camera has just started
constexpr double kChange_s = 4.5;      // from one round's camera to the next one's first frame
constexpr double kUsualRound_s = 150.0;
constexpr std::size_t kRoundsPerKill = 3;
constexpr double kLongStall_s = 2.4;  // longer than bolod waits before it reopens a stalled camera (2 s)

// Kinds that begin a round, outside the order.
bool opens_round(Kind kind) { return kind == Kind::kWindowingDrop || kind == Kind::kCameraReplaced; }

// Jump of the camera's clock, s: never a whole number of frames, as two frames must not share a time, by which accounts
// are compared.
double jump(Dice& dice) { return std::floor(dice.between(0.2, 2.0) * 100.0) / 100.0 + 0.0013; }

std::string faults_of(const Disturbance& d, Dice& dice) {
  std::string text = std::string(info_of(d.kind).name) + ":" + std::string(info_of(d.kind).script);
  const auto put = [&text](std::string_view word, auto value) {
    for (auto at = text.find(word); at != std::string::npos; at = text.find(word))
      text.replace(at, word.size(), value());
  };
  // First, because RATE contains AT.
  put("RATE", [&] { return plot::format("%.3f", dice.between(0.01, 0.05)); });
  put("AT", [&] { return plot::format("%.3f", d.at_s); });
  put("FOR", [&] { return plot::format("%.3f", d.for_s); });
  put("LONGER", [&] { return plot::format("%.3f", d.for_s + 0.3); });
  put("IDS", [&] { return std::to_string(1 + dice.below(40)); });
  put("BY", [&] {
    const double sign = dice.below(2) == 0 ? 1.0 : -1.0;
    return plot::format("%.4f", sign * jump(dice));
  });
  put("SEED", [&] { return std::to_string(d.seed % 1'000'000); });
  return text;
}

Disturbance make(Kind kind, double at_s, std::size_t round, Dice& dice) {
  const KindInfo& info = info_of(kind);
  Disturbance d;
  d.kind = kind;
  d.at_s = std::round(at_s * 1000.0) / 1000.0;
  d.for_s = std::round(dice.between(info.shortest_s, info.longest_s) * 1000.0) / 1000.0;
  if (kind == Kind::kStall && round % 2 == 1) d.for_s = kLongStall_s;
  d.seed = dice.word();
  if (!info.script.empty()) d.faults = faults_of(d, dice);
  return d;
}

double room_of(Kind kind, std::size_t round) {
  return info_of(kind).room_s + (kind == Kind::kStall && round % 2 == 1 ? kLongStall_s : 0.0);
}

bool drawn(Kind kind, std::size_t round) {
  return !opens_round(kind) && (kind != Kind::kDaemonKilled || round % kRoundsPerKill == 0);
}

std::vector<Kind> shuffled(const std::set<Kind>& kinds, std::size_t round, Dice& dice) {
  std::vector<Kind> order;
  for (const Kind kind : kinds) {
    if (drawn(kind, round)) order.push_back(kind);
  }
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[dice.below(i)]);
  return order;
}

// All kinds that fit, spread over the available time.
Round draw_round(const ScheduleRequest& request, std::size_t round, double round_s, std::vector<Kind>& no_room) {
  Dice dice(splitmix::key(request.seed, round));
  Round out;
  if (round > 0) out.disturbances.push_back(make(Kind::kCameraReplaced, 0.0, round, dice));
  if (round % 2 == 0 && request.kinds.contains(Kind::kWindowingDrop)) {
    out.disturbances.push_back(make(Kind::kWindowingDrop, 0.0, round, dice));
  }
  double left_s = round_s - kFirstQuiet_s - kChange_s;
  std::vector<Kind> taken;
  for (const Kind kind : shuffled(request.kinds, round, dice)) {
    const double room_s = room_of(kind, round);
    if (room_s <= left_s) {
      left_s -= room_s;
      taken.push_back(kind);
    } else {
      no_room.push_back(kind);
    }
  }
  const double slack_s = taken.empty() ? 0.0 : left_s / static_cast<double>(taken.size());
  double at_s = kFirstQuiet_s;
  for (const Kind kind : taken) {
    out.disturbances.push_back(make(kind, at_s + 0.3 * slack_s * dice.between(0.0, 1.0), round, dice));
    at_s += room_of(kind, round) + slack_s;
  }
  return out;
}

}  // namespace

std::span<const KindInfo> kinds() { return kKinds; }

const KindInfo& info_of(Kind kind) { return kKinds[static_cast<std::size_t>(kind)]; }

std::optional<Kind> kind_named(std::string_view name) {
  const auto* const found = std::ranges::find(kKinds, name, &KindInfo::name);
  return found == kKinds.end() ? std::nullopt : std::optional(found->kind);
}

std::vector<std::string> Round::faults() const {
  std::vector<std::string> all;
  for (const Disturbance& d : disturbances) {
    for (std::size_t begin = 0; begin < d.faults.size();) {
      const std::size_t end = std::min(d.faults.find(' ', begin), d.faults.size());
      all.push_back(d.faults.substr(begin, end - begin));
      begin = end + 1;
    }
  }
  return all;
}

Schedule draw_schedule(const ScheduleRequest& request) {
  Schedule schedule;
  schedule.seed = request.seed;
  const auto rounds = static_cast<std::size_t>(std::max(1.0, std::floor(request.seconds / kUsualRound_s)));
  schedule.round_s = request.seconds / static_cast<double>(rounds);
  for (std::size_t r = 0; r < rounds; ++r) {
    std::vector<Kind> no_room;
    schedule.rounds.push_back(draw_round(request, r, schedule.round_s, no_room));
    if (r == 0) schedule.no_room = no_room;
  }
  return schedule;
}

}  // namespace bolo::tools::soak
