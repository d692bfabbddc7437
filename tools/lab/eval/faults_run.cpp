#include "tools/lab/eval/faults.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <mutex>
#include <sstream>

#include "src/core/clock.hpp"

namespace bolo::tools::faults {
namespace {

constexpr std::uint64_t kFirstId = 100;
constexpr double kOpenLimitS = 20.0;  // to the first stream; slower if the camera drops the first connection
constexpr std::size_t kSpareFrames = 256;
constexpr int kManyPackets = 576;  // bytes: eight packets per frame of 64x24 pixels

// Copies each frame to preallocated memory.
class KeepingSink final : public pipeline::FrameSink {
 public:
  explicit KeepingSink(std::size_t frames) : most_(frames) {}

  Status open(const pipeline::SinkFormat& format) override {
    const std::size_t pixels = format.source.format.geometry.pixels();
    frames_.assign(most_, {{}, 0, Counts(pixels), Counts(pixels)});
    return {};
  }
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats&) noexcept override {
    if (count_ == frames_.size()) return;
    Published& kept = frames_[count_++];
    kept.meta = frame.meta;
    kept.publish_ns = frame.publish_ns;
    std::memcpy(kept.raw.data(), frame.raw, kept.raw.size() * sizeof(std::uint16_t));
    std::memcpy(kept.deblurred.data(), frame.deblurred, kept.deblurred.size() * sizeof(std::uint16_t));
  }
  void close() noexcept override {}

  std::vector<Published> take() {
    frames_.resize(count_);
    return std::move(frames_);
  }

 private:
  std::size_t most_;
  std::vector<Published> frames_;
  std::size_t count_ = 0;
};

fakecam::FrameProvider content_of(const Recording& scene, int rows_below) {
  fakecam::FrameProvider content;
  content.format = scene.format;
  content.format.geometry.height += rows_below;
  content.serial = "FAULTS";
  const std::size_t stride = plane_bytes(content.format.geometry, content.format.type);
  content.planes.resize(stride * scene.planes.size());
  for (std::size_t k = 0; k < scene.planes.size(); ++k) {
    content.frame_ids.push_back(kFirstId + k);
    content.times_s.push_back(static_cast<double>(kFirstCameraNs) / kNsPerSecond +
                              static_cast<double>(k) * scene.format.frame_period_s);
    std::memcpy(content.planes.data() + k * stride, scene.planes[k].data(), scene.planes[k].size());
  }
  return content;
}

// RcvbufErrors of this network namespace: the kernel's own count, two lines of names and values.
std::uint64_t host_dropped() {
  std::ifstream in("/proc/net/snmp");
  std::string names;
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with("Udp:")) continue;
    if (names.empty()) {
      names = line;
      continue;
    }
    std::istringstream name_fields(names);
    std::istringstream value_fields(line);
    for (std::string name, value; name_fields >> name && value_fields >> value;) {
      if (name == "RcvbufErrors") return std::stoull(value);
    }
  }
  return 0;
}

Status wait_for_end(const fakecam::FakeCamera& camera, double seconds, const std::atomic<bool>& ended) {
  const std::int64_t give_up_ns = monotonic_ns() + static_cast<std::int64_t>(kOpenLimitS * kNsPerSecond);
  const auto length_ns = static_cast<std::int64_t>(seconds * kNsPerSecond);
  while (!ended.load(std::memory_order_relaxed)) {
    const auto start_ns = static_cast<std::int64_t>(camera.stats().first_stream_ns);
    if (start_ns != 0 && monotonic_ns() >= start_ns + length_ns) break;
    if (start_ns == 0 && monotonic_ns() >= give_up_ns) return failed("the camera was never told to stream");
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return {};
}

enum class Kind { kRight, kWarmUp, kGap, kOther, kStrange };

struct Seen {
  std::size_t number = 0;  // in the scene
  int offset = 0;          // of its pixels, counts
};

// True if the planes are equal up to an offset. With an offset, rounding changes deblurred values by up to one count.
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

  // The scene's frame with this time on the camera's clock and these values.
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

  // True if less than a window after the disturbance, in the same stream.
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

genicam::CameraOptions camera_options(const Recording& scene, const std::string& address) {
  genicam::CameraOptions options;
  options.address = address;
  options.width = scene.format.geometry.width;
  options.height = scene.format.geometry.height;
  options.rate_hz = 1.0 / scene.format.frame_period_s;
  options.packet_size = kManyPackets;
  options.windowing_watch_ms = 50;
  options.stall_ms = 150;
  options.reconnect_after_ms = 600;
  return options;
}

std::string fresh_address() {
  static std::atomic<int> last{0};
  const int pid = getpid();
  return "127." + std::to_string(1 + (pid >> 8) % 254) + "." + std::to_string(pid & 255) + "." +
         std::to_string(100 + last++ % 150);
}

Result<RunResult> run(const RunTask& task) {
  fakecam::FakeCameraOptions fake_options;
  fake_options.address = task.camera.address;
  fake_options.laps = 0;
  fake_options.faults = task.faults;
  ASSIGN_OR_RETURN(auto fake, fakecam::FakeCamera::start(fake_options, content_of(*task.scene, task.rows_below)));
  const std::uint64_t dropped_before = host_dropped();

  KeepingSink sink(static_cast<std::size_t>(task.seconds / task.scene->format.frame_period_s) + kSpareFrames);
  auto source = std::make_unique<genicam::GenicamSource>(task.camera);
  const genicam::GenicamSource& camera = *source;
  static std::mutex opening;  // Aravis reads a camera's description with process-wide state
  ASSIGN_OR_RETURN(const auto line, [&] {
    const std::lock_guard lock(opening);
    return pipeline::Pipeline::create(std::move(source), {&sink}, task.pipeline);
  }());
  std::atomic<bool> stop{false};
  std::atomic<bool> ended{false};
  Status ran;
  std::thread runner([&] {
    ran = line->run(stop);
    ended.store(true, std::memory_order_relaxed);  // its results are read after the join
  });
  const Status waited = wait_for_end(*fake, task.seconds, ended);
  RunResult result;
  result.injected = fake->injected();
  result.reconnects = camera.reconnects();
  stop.store(true, std::memory_order_relaxed);
  runner.join();
  RETURN_IF_ERROR(ran);
  RETURN_IF_ERROR(waited);

  result.frames = sink.take();
  const pipeline::PipelineStats& stats = line->stats();
  for (std::size_t c = 0; c < kLossCauses; ++c) result.lost[c] = stats.inlet.losses().value(static_cast<LossCause>(c));
  result.camera = fake->stats();
  for (const Published& frame : result.frames) {
    result.latency_ms.push_back(static_cast<double>(frame.publish_ns - frame.meta.receive_ns) * kMsPerNs);
  }
  result.host_dropped = host_dropped() - dropped_before;
  return result;
}

Result<std::vector<Counts>> undisturbed(const Recording& scene, const pipeline::PipelineOptions& options) {
  KeepingSink sink(scene.planes.size());
  ASSIGN_OR_RETURN(auto line, pipeline::Pipeline::create(std::make_unique<RecordingSource>(scene), {&sink}, options));
  const std::atomic<bool> never{false};
  RETURN_IF_ERROR(line->run(never));
  std::vector<Counts> planes(scene.planes.size());
  for (Published& frame : sink.take()) {
    if ((frame.meta.flags & kFlagWarmUp) == 0) planes[frame.meta.frame_id] = std::move(frame.deblurred);
  }
  return planes;
}

Verdict judge(const RunResult& result, const Recording& scene, const std::vector<Counts>& reference, int window,
              const Disturbance& disturbance) {
  const Judge judge(scene, reference, disturbance);
  const auto start_ns = static_cast<std::int64_t>(result.camera.first_stream_ns);
  const auto over_ns = start_ns + static_cast<std::int64_t>(disturbance.to_s * kNsPerSecond);
  const auto from_ns = start_ns + static_cast<std::int64_t>(disturbance.from_s * kNsPerSecond);
  Verdict verdict;
  std::int64_t right_since_ns = 0;  // publish time of the first frame in the final run of right ones
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
