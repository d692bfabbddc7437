#include "tools/bolod/metrics.hpp"

#include <string_view>
#include <utility>

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
  void value(std::uint64_t count, Labels labels = {}) { value(static_cast<double>(count), std::move(labels)); }
  void counter(std::string name, std::string help, std::uint64_t count) {
    begin(MetricType::Counter, std::move(name), std::move(help));
    value(count);
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

void add_frames(const pipeline::PipelineStats& stats, Families& to) {
  const std::uint64_t published = stats.published.value();  // before what it comes from, so that it is never more
  to.counter("bolo_frames_received_total", "Whole frames that reached the queue", stats.inlet.received());
  to.counter("bolo_frames_published_total", "Frames handed to the sinks", published);
  to.begin(MetricType::Counter, "bolo_frames_lost_total", "Frames lost, by the first cause that took them");
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    const auto cause = static_cast<LossCause>(i);
    to.value(stats.inlet.losses().value(cause), {{"cause", std::string(name(cause))}});
  }
  to.counter("bolo_frames_repeated_total", "Frames dropped that repeated the one before; among the missing, too",
             stats.repeats.value());
  to.counter("bolo_frames_warm_up_total", "Frames published without a full window behind them", stats.warm_up.value());
  to.counter("bolo_frames_gap_total", "Frames published with a lost one in their window", stats.gap_frames.value());
  to.begin(MetricType::Counter, "bolo_frames_effort_total",
           "Frames with a full window, by what was spent on them: less than full when too many were waiting");
  for (std::size_t i = 0; i < pipeline::kEfforts; ++i) {
    to.value(stats.by_effort[i].value(), {{"effort", std::string(name(static_cast<pipeline::Effort>(i)))}});
  }
  to.begin(MetricType::Gauge, "bolo_effort", "1 for what is spent on frames now");
  for (std::size_t i = 0; i < pipeline::kEfforts; ++i) {
    const auto effort = static_cast<pipeline::Effort>(i);
    to.value(stats.effort.value() == effort ? 1.0 : 0.0, {{"effort", std::string(name(effort))}});
  }
  to.counter("bolo_window_restarts_total", "Windows emptied: NUC, reconnect, a jump in time", stats.restarts.value());
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

void add_connection(const pipeline::SourceStatus& source, Families& to) {
  to.begin(MetricType::Gauge, "bolo_camera_state", "1 for the state that the camera is in");
  for (std::size_t i = 0; i < pipeline::kSourceStates; ++i) {
    const auto state = static_cast<pipeline::SourceState>(i);
    to.value(source.state.value() == state ? 1.0 : 0.0, {{"state", std::string(name(state))}});
  }
  to.begin(MetricType::Counter, "bolo_camera_lost_total", "Times that the camera was given up, by cause");
  for (std::size_t i = 0; i < pipeline::kLostCauses; ++i) {
    std::string cause(name(static_cast<pipeline::LostCause>(i)));
    std::replace(cause.begin(), cause.end(), ' ', '_');
    to.value(source.lost[i].value(), {{"cause", cause}});
  }
  to.counter("bolo_camera_reconnects_total", "Times that it was opened again", source.reopened.value());
  to.counter("bolo_camera_stalls_total", "Times that frames stopped", source.stalls.value());
  to.counter("bolo_camera_outage_frames_total", "Frames that would have come while it was lost",
             source.outage_frames.value());
  to.counter("bolo_camera_corrections_total", "Corrections of its pixels (NUC) that were asked for",
             source.corrections.value());
}

void add_camera(const pipeline::SourceStatus& source, Families& to) {
  add_connection(source, to);
  to.gauge("bolo_camera_clock_drift_ratio", "By how much its clock is slower than the host's",
           source.clock_drift_ppm.value() * 1e-6);
  to.gauge("bolo_camera_clock_jitter_seconds", "Of the way from camera to host, rms over its shortest",
           source.clock_jitter_ns.value() * kSecondsPerNs);
  to.counter("bolo_camera_clock_jumps_total", "Jumps of its clock", source.clock_jumps.value());
  to.counter("bolo_camera_packets_received_total", "Packets, as the transport counts them",
             source.received_packets.value());
  to.counter("bolo_camera_packets_missing_total", "Packets that never came", source.missing_packets.value());
  to.counter("bolo_camera_packets_resent_total", "Packets that came when asked for again",
             source.resent_packets.value());
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
      to.value(value_of(sink->stats()), {{"device", sink->options().device}});
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
