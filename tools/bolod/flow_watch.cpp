#include "tools/bolod/flow_watch.hpp"

#include "src/core/duration_text.hpp"

namespace bolo::daemon {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kPatienceNs = 2 * kSecondNs;         // with our own threads
constexpr std::int64_t kSourcePatienceNs = 30 * kSecondNs;  // opening a lost camera takes its time
constexpr double kSpareFrames = 2.0;

}  // namespace

FlowWatch::FlowWatch(double frame_period_s, int lookahead, std::int64_t stall_ns, std::int64_t start_ns)
    : patience_ns_(kPatienceNs + static_cast<std::int64_t>((lookahead + kSpareFrames) * frame_period_s * 1e9)),
      stall_ns_(stall_ns),
      received_{0, start_ns},
      handled_{0, start_ns} {}

std::string FlowWatch::check(const Signs& signs) {
  const std::int64_t silent_ns = signs.now_ns - received_.since_ns;
  if (signs.received != received_.value && silent_ns > patience_ns_) handled_.since_ns = signs.now_ns;  // due from now
  received_.update(signs.received, signs.now_ns);
  handled_.update(signs.handled, signs.now_ns);
  const auto for_how_long = [&](std::int64_t since_ns) { return seconds_text(signs.now_ns - since_ns); };

  if (signs.now_ns - signs.polled_ns > kPatienceNs) {
    return "the pipeline has not moved for " + for_how_long(signs.polled_ns);
  }
  if (signs.now_ns - received_.since_ns <= patience_ns_) {  // frames come
    if (signs.now_ns - handled_.since_ns <= patience_ns_) return {};
    return "frames come, but none was published for " + for_how_long(handled_.since_ns);
  }
  if (!signs.watched) return {};
  if (signs.now_ns - signs.watched_ns > kSourcePatienceNs) {
    return "no frame comes, and the camera was not looked after for " + for_how_long(signs.watched_ns);
  }
  if (signs.streams && signs.now_ns - received_.since_ns > stall_ns_ + patience_ns_) {
    return "no frame came for " + for_how_long(received_.since_ns) + ", though the camera streams";
  }
  return {};
}

}  // namespace bolo::daemon
