#include "tools/bolod/state.hpp"

#include "drivers/shm/camera_block.hpp"
#include "src/core/clock.hpp"
#include "src/pipeline/counter_table.hpp"

namespace bolo::daemon {
namespace {

using nlohmann::ordered_json;

ordered_json latency_json(const rt::LatencyHistogram& histogram) {
  const auto counts = histogram.counts();
  const auto percentile = [&counts](double fraction) { return rt::LatencyHistogram::percentile_ms(counts, fraction); };
  return {{"p50_ms", percentile(0.5)}, {"p99_ms", percentile(0.99)}, {"max_ms", percentile(1.0)}};
}

ordered_json losses_json(const pipeline::PipelineStats& stats) {
  ordered_json lost;
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    const auto cause = static_cast<LossCause>(i);
    lost[std::string(name(cause))] = stats.inlet.losses().value(cause);
  }
  return lost;
}

ordered_json effort_json(const pipeline::PipelineStats& stats) {
  ordered_json frames;
  for (std::size_t i = 0; i < pipeline::kEfforts; ++i) {
    frames[std::string(name(static_cast<pipeline::Effort>(i)))] = stats.by_effort[i].value();
  }
  return {{"now", name(stats.effort.value())}, {"frames", frames}};
}

ordered_json video_json(const v4l2::V4l2Sink& sink) {
  const v4l2::V4l2Stats& stats = sink.stats();
  return {{"device", sink.options().device},
          {"open", stats.open.value()},
          {"written", stats.written.value()},
          {"dropped", stats.dropped.value()},
          {"failures", stats.failures.value()}};
}

}  // namespace

ordered_json stages_json(const pipeline::PipelineStats& stats) {
  return {{"arrival", latency_json(stats.stages.arrival)},
          {"queue", latency_json(stats.stages.queue)},
          {"deblur", latency_json(stats.stages.deblur)},
          {"publish", latency_json(stats.stages.publish)},
          {"total", latency_json(stats.latency)}};
}

ordered_json state_json(const std::string& name, const pipeline::PipelineStats& stats,
                        const std::array<v4l2::V4l2Sink*, kVideoDevices>& video) {
  ordered_json json{{"ok", true}, {"name", name}, {"received", stats.inlet.received()}};
  for (const auto& row : pipeline::kFrameCounters) {  // the others are in shared memory
    if (row.shared == 0 && !row.key.empty()) json[std::string(row.key)] = row.read(stats, 0);
  }
  json["lost_total"] = stats.inlet.losses().total();
  json["lost"] = losses_json(stats);
  json["effort"] = effort_json(stats);
  json["stages"] = stages_json(stats);
  json["camera"] = nullptr;
  json["video"] = ordered_json::array();
  if (stats.source != nullptr) json["camera"] = shm::camera_json(shm::camera_block(*stats.source), monotonic_ns());
  for (const v4l2::V4l2Sink* sink : video) {
    if (sink != nullptr) json["video"].push_back(video_json(*sink));
  }
  return json;
}

}  // namespace bolo::daemon
