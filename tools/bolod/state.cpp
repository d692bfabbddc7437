#include "tools/bolod/state.hpp"

#include <bit>

#include "drivers/shm/camera_block.hpp"
#include "src/core/clock.hpp"
#include "tools/bolod/health.hpp"

namespace bolo::daemon {
namespace {

using nlohmann::ordered_json;

ordered_json latency_json(const rt::LatencyHistogram& histogram) {
  const auto counts = histogram.counts();
  const auto percentile = [&counts](double fraction) { return rt::LatencyHistogram::percentile_ms(counts, fraction); };
  return {{"p50_ms", percentile(0.5)}, {"p99_ms", percentile(0.99)}, {"max_ms", percentile(1.0)}};
}

template <typename Enum, std::size_t N>
ordered_json by_name(const std::array<std::uint64_t, N>& counts) {
  ordered_json json;
  for (std::size_t i = 0; i < N; ++i) json[std::string(name(static_cast<Enum>(i)))] = counts[i];
  return json;
}

ordered_json sink_json(const pipeline::SinkStatistics& sink) {
  ordered_json json{{sink.label, sink.name}};
  for (const pipeline::SinkNumber& number : sink.numbers) {
    json[std::string(number.key)] = number.counts() ? ordered_json(number.value) : ordered_json(number.value != 0);
  }
  return json;
}

ordered_json stages_json(const pipeline::PipelineStats& stats) {
  ordered_json json;
  for (const auto& stage : pipeline::kStages) json[std::string(stage.name)] = latency_json(stats.stages.*stage.latency);
  json["total"] = latency_json(stats.latency);
  return json;
}

}  // namespace

ordered_json state_json(const DaemonConfig& config, const pipeline::Pipeline& pipeline) {
  const pipeline::PipelineStats& stats = pipeline.stats();
  ordered_json json{{"ok", true}, {"name", config.name}, {"received", stats.inlet.received()}};
  for (const auto& row : pipeline::kFrameCounters) {  // the others are in shared memory
    if (row.shared != 0 || row.key.empty()) continue;
    const std::uint64_t word = row.read(stats, 0);
    json[std::string(row.key)] = word;
    if (row.kind == pipeline::RowKind::kReal) {
      json[std::string(row.key)] = word == 0 ? ordered_json() : ordered_json(std::bit_cast<double>(word));
    }
  }
  json["lost_total"] = stats.inlet.losses().total();
  json["lost"] = by_name<LossCause>(loss_counts(stats));
  json["effort"] = {{"now", name(stats.effort.value())},
                    {"frames", by_name<pipeline::QualityLevel>(quality_counts(stats))}};
  json["stages"] = stages_json(stats);
  json["camera"] = nullptr;
  if (stats.source != nullptr) json["camera"] = shm::camera_json(shm::camera_block(*stats.source), monotonic_ns());
  for (const auto& section : config.sinks) {
    if (!section->group().empty()) json[std::string(section->group())] = ordered_json::array();
  }
  for (const pipeline::FrameSink* sink : pipeline.sinks()) {
    const pipeline::SinkStatistics statistics = sink->statistics();
    if (!statistics.group.empty()) json[std::string(statistics.group)].push_back(sink_json(statistics));
  }
  return json;
}

}  // namespace bolo::daemon
