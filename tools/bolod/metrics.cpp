#include "tools/bolod/metrics.hpp"

#include <array>
#include <bit>
#include <string_view>
#include <utility>

#include "src/pipeline/counter_table.hpp"

namespace bolo::daemon {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

constexpr double kSecondsPerNs = 1e-9;
constexpr double kSecondsPerMs = 1e-3;
constexpr double kZeroCelsius = 273.15;

// Families in the order in which they are begun.
class Families {
 public:
  void begin(MetricType type, std::string name, std::string help) {
    families_.push_back({std::move(name), std::move(help), type, {}});
  }
  void value(double value, Labels labels = {}) {
    ClientMetric& metric = add(std::move(labels));
    metric.counter.value = value;
    metric.gauge.value = value;
  }
  void gauge(std::string name, std::string help, double reading) {
    begin(MetricType::Gauge, std::move(name), std::move(help));
    value(reading);
  }
  void histogram(const rt::LatencyHistogram& source, Labels labels = {}) {
    add(std::move(labels)).histogram = convert(source);
  }
  std::vector<MetricFamily> take() { return std::move(families_); }

 private:
  ClientMetric& add(Labels labels) {
    ClientMetric& metric = families_.back().metric.emplace_back();
    metric.label = std::move(labels);
    return metric;
  }
  // Two buckets an octave of the eight that are counted, from 64 us to 1 s: enough to see a percentile move.
  static ClientMetric::Histogram convert(const rt::LatencyHistogram& source) {
    constexpr std::size_t kFirst = 31;  // its upper edge is 64 us
    constexpr std::size_t kLast = 143;  // 1.05 s
    constexpr std::size_t kStep = 4;
    const auto counts = source.counts();
    ClientMetric::Histogram histogram;
    std::uint64_t seen = 0;
    for (std::size_t b = 0; b < counts.size(); ++b) {
      seen += counts[b];
      if (b < kFirst || b > kLast || (b - kFirst) % kStep != 0) continue;
      histogram.bucket.push_back({seen, rt::LatencyHistogram::upper_ms(b) * kSecondsPerMs});
    }
    histogram.sample_count = seen;
    histogram.sample_sum = static_cast<double>(source.sum_ns()) * kSecondsPerNs;
    return histogram;
  }

  std::vector<MetricFamily> families_;
};

void add_information(const MetricsView& view, Families& to) {
  const pipeline::SourceInfo& source = view.pipeline.source();
  to.begin(MetricType::Gauge, "bolo_build_info", "The program; always 1");
  to.value(1.0, {{"version", BOLO_VERSION}});
  to.begin(MetricType::Gauge, "bolo_stream_info", "Who deblurs what, and how; always 1");
  to.value(1.0, {{"name", view.name},
                 {"camera_model", source.camera_model},
                 {"camera_serial", source.camera_serial},
                 {"solver", view.pipeline.solver_text()}});
  to.gauge("bolo_frame_period_seconds", "From one frame of the stream to the next", source.format.frame_period_s);
}

template <typename Source>
double metric_value(const pipeline::CounterRow<Source>& row, std::uint64_t word) {
  using pipeline::RowKind;
  if (row.kind == RowKind::kReal) return std::bit_cast<double>(word) * row.metric_scale;
  return static_cast<double>(word) * row.metric_scale;
}

// Read from the last row to the first: what comes of other frames is then never more than they.
template <typename Source, std::size_t N>
void add_rows(const std::array<pipeline::CounterRow<Source>, N>& rows, const Source& source, Families& to) {
  std::array<std::vector<std::uint64_t>, N> words;
  for (std::size_t n = N; n-- > 0;) {
    for (std::size_t i = 0; i < rows[n].parts; ++i) words[n].push_back(rows[n].read(source, i));
  }
  for (std::size_t n = 0; n < N; ++n) {
    const pipeline::CounterRow<Source>& row = rows[n];
    if (row.metric.empty()) continue;
    to.begin(row.metric.ends_with("_total") ? MetricType::Counter : MetricType::Gauge, std::string(row.metric),
             std::string(row.help));
    for (std::size_t i = 0; i < row.parts; ++i) {
      Labels labels;
      if (!row.label.empty()) labels.push_back({std::string(row.label), part_key(row, i)});
      to.value(metric_value(row, words[n][i]), std::move(labels));
    }
  }
}

// 1 for the one of an enumeration's values that holds now.
template <typename Enum>
void add_choice(const char* metric, const char* help, const char* label, std::size_t count, Enum now, Families& to) {
  to.begin(MetricType::Gauge, metric, help);
  for (std::size_t i = 0; i < count; ++i) {
    to.value(now == static_cast<Enum>(i) ? 1.0 : 0.0, {{label, std::string(name(static_cast<Enum>(i)))}});
  }
}

void add_frames(const pipeline::PipelineStats& stats, Families& to) {
  add_rows(pipeline::kFrameCounters, stats, to);
  add_choice("bolo_effort", "1 for what is spent on frames now", "effort", pipeline::kEfforts, stats.effort.value(),
             to);
  to.gauge("bolo_queue_frames", "Frames that wait for the pipeline", static_cast<double>(stats.waiting()));
}

void add_latencies(const pipeline::PipelineStats& stats, Families& to) {
  to.begin(MetricType::Histogram, "bolo_latency_seconds", "From a frame's first byte to its being handed to the sinks");
  to.histogram(stats.latency);
  to.begin(MetricType::Histogram, "bolo_stage_latency_seconds",
           "Where that time goes: arrival (until the frame is whole), queue, deblur, and publish (the sinks' copies)");
  to.histogram(stats.stages.arrival, {{"stage", "arrival"}});
  to.histogram(stats.stages.queue, {{"stage", "queue"}});
  to.histogram(stats.stages.deblur, {{"stage", "deblur"}});
  to.histogram(stats.stages.publish, {{"stage", "publish"}});
}

void add_camera(const pipeline::SourceStatus& source, Families& to) {
  add_choice("bolo_camera_state", "1 for the state that the camera is in", "state", pipeline::kSourceStates,
             source.state.value(), to);
  add_rows(pipeline::kCameraCounters, source, to);
  const double temperature_k = source.temperature_k.value();
  if (temperature_k > 0.0) {
    to.gauge("bolo_camera_temperature_celsius", "Of the camera itself", temperature_k - kZeroCelsius);
  }
}

void add_video(const MetricsView& view, Families& to) {
  const auto each = [&](MetricType type, const char* name, const char* help, auto value_of) {
    bool begun = false;
    for (const v4l2::V4l2Sink* sink : view.video) {
      if (sink == nullptr) continue;
      if (!std::exchange(begun, true)) to.begin(type, name, help);
      to.value(static_cast<double>(value_of(sink->stats())), {{"device", sink->options().device}});
    }
  };
  using Stats = v4l2::V4l2Stats;
  each(MetricType::Gauge, "bolo_video_open", "1 while the device takes frames",
       [](const Stats& s) { return s.open.value() ? 1.0 : 0.0; });
  each(MetricType::Counter, "bolo_video_frames_written_total", "Frames that the device took",
       [](const Stats& s) { return s.written.value(); });
  each(MetricType::Counter, "bolo_video_frames_dropped_total", "Frames that it did not take",
       [](const Stats& s) { return s.dropped.value(); });
  each(MetricType::Counter, "bolo_video_failures_total", "Times that it failed and was let go",
       [](const Stats& s) { return s.failures.value(); });
}

}  // namespace

std::vector<MetricFamily> collect_metrics(const MetricsView& view) {
  const pipeline::PipelineStats& stats = view.pipeline.stats();
  Families families;
  add_information(view, families);
  families.gauge("bolo_flowing", "1 while the watchdog gets signs of life", view.flows.value() ? 1.0 : 0.0);
  add_frames(stats, families);
  add_latencies(stats, families);
  if (stats.source != nullptr) add_camera(*stats.source, families);
  add_video(view, families);
  return families.take();
}

}  // namespace bolo::daemon
