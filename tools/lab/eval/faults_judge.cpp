#include "tools/lab/eval/faults_judge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <optional>

#include "src/core/clock.hpp"

namespace bolo::tools::faults {
namespace {

enum class Kind { kRight, kWarmUp, kGap, kOther, kStrange };

struct Seen {
  std::size_t number = 0;  // in the scene
  int offset = 0;          // of its pixels, counts
};

// Whether both planes are the same but for an offset. Rounding moves deblurred values by one count when it is there.
bool same(const Counts& shown, const std::uint16_t* expected, int offset, int tolerance) {
  for (std::size_t p = 0; p < shown.size(); ++p) {
    if (std::abs(static_cast<int>(shown[p]) - static_cast<int>(expected[p]) - offset) > tolerance) return false;
  }
  return true;
}

class Judge {
 public:
  Judge(const Recording& scene, const std::vector<Counts>& reference, const Disturbance& disturbance)
      : scene_(scene), reference_(reference), disturbance_(disturbance) {}

  // The scene's frame that this is, by the camera's clock and value by value.
  std::optional<Seen> find(const Published& frame) const {
    for (const double shift_s : {0.0, disturbance_.clock_shift_s}) {
      const double since_first = static_cast<double>(frame.meta.camera_ns - kFirstCameraNs) / kNsPerSecond - shift_s;
      const auto number = std::lround(since_first / scene_.format.frame_period_s);
      if (number < 0 || static_cast<std::size_t>(number) >= scene_.planes.size()) continue;
      const auto k = static_cast<std::size_t>(number);
      const auto* plane = reinterpret_cast<const std::uint16_t*>(scene_.planes[k].data());
      for (const int offset : {0, disturbance_.offset_counts}) {
        if (same(frame.raw, plane, offset, 0)) return Seen{k, offset};
      }
    }
    return std::nullopt;
  }

  Kind kind_of(const Published& frame, const std::optional<Seen>& seen) const {
    if (!seen) return Kind::kStrange;
    if ((frame.meta.flags & kFlagWarmUp) != 0) return Kind::kWarmUp;
    const Counts& expected = reference_[seen->number];
    const bool right = !expected.empty() && same(frame.deblurred, expected.data(), seen->offset, seen->offset != 0);
    if (right) return Kind::kRight;
    return (frame.meta.flags & kFlagGap) != 0 ? Kind::kGap : Kind::kOther;
  }

  // Less than a window after the disturbance, in the stream that it struck.
  bool settles(const Seen& seen, int window) const {
    const double time_s = static_cast<double>(seen.number) * scene_.format.frame_period_s;
    const double settled_s = disturbance_.to_s + (window - 0.5) * scene_.format.frame_period_s;
    return time_s >= disturbance_.from_s && time_s < settled_s;
  }

 private:
  const Recording& scene_;
  const std::vector<Counts>& reference_;
  const Disturbance& disturbance_;
};

}  // namespace

Verdict judge(const RunResult& result, const Recording& scene, const std::vector<Counts>& reference, int window,
              const Disturbance& disturbance) {
  const Judge judge(scene, reference, disturbance);
  const auto start_ns = static_cast<std::int64_t>(result.camera.first_stream_ns);
  const auto over_ns = start_ns + static_cast<std::int64_t>(disturbance.to_s * kNsPerSecond);
  const auto from_ns = start_ns + static_cast<std::int64_t>(disturbance.from_s * kNsPerSecond);
  Verdict verdict;
  std::int64_t right_since_ns = 0;  // publish time of the first of the right frames that end the run
  bool disturbed = false;
  std::size_t last_number = 0;
  bool later_stream = false;
  bool first = true;
  for (const Published& frame : result.frames) {
    const auto seen = judge.find(frame);
    if (seen) {
      const bool new_stream = seen->number < last_number;
      later_stream = later_stream || new_stream;
      if (!new_stream && !first) verdict.never_came += seen->number - last_number - 1;
      last_number = seen->number;
      first = false;
    }
    const Kind kind = judge.kind_of(frame, seen);
    const bool excused = seen && !later_stream && judge.settles(*seen, window);
    verdict.right += kind == Kind::kRight ? 1U : 0U;
    verdict.warm_up += kind == Kind::kWarmUp ? 1U : 0U;
    verdict.gap += kind == Kind::kGap ? 1U : 0U;
    verdict.settling += kind == Kind::kOther && excused ? 1U : 0U;
    verdict.wrong += kind == Kind::kOther && !excused ? 1U : 0U;
    verdict.strange += kind == Kind::kStrange ? 1U : 0U;
    disturbed = disturbed || (kind != Kind::kRight && frame.publish_ns >= from_ns);
    if (kind != Kind::kRight) {
      right_since_ns = 0;
    } else if (right_since_ns == 0) {
      right_since_ns = frame.publish_ns;
    }
  }
  verdict.recovered = right_since_ns != 0;
  if (disturbed && disturbance.from_s >= 0.0)
    verdict.recovery_ms = std::max(0.0, static_cast<double>(right_since_ns - over_ns) * kMsPerNs);
  return verdict;
}

Losses expected_losses(const fakecam::FaultScript& script, const std::vector<fakecam::InjectedFault>& injected,
                       bool resends) {
  using fakecam::FaultKind;
  Losses losses{};
  const auto add = [&losses](LossCause cause, std::uint64_t n) { losses[static_cast<std::size_t>(cause)] += n; };
  for (std::size_t i = 0; i < script.size(); ++i) {
    const FaultKind kind = script[i].kind();
    const bool no_packet =
        kind == FaultKind::kStall || kind == FaultKind::kFreeze || kind == FaultKind::kIdGap || kind == FaultKind::kNuc;
    if (no_packet) add(LossCause::kMissing, injected[i].frames);
    if (kind == FaultKind::kLoss && !resends) add(LossCause::kIncomplete, injected[i].frames);
  }
  return losses;
}

}  // namespace bolo::tools::faults
