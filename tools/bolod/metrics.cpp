#include "tools/bolod/metrics.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>
#include <system_error>
#include <utility>

#include <prometheus/text_serializer.h>

#include "src/core/ip_address.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"

namespace bolo::daemon {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

constexpr double kSecondsPerNs = 1e-9;
constexpr double kSecondsPerMs = 1e-3;
constexpr double kZeroCelsius = 273.15;

// Metric families in the order of their begin().
class Families {
 public:
  // Starts a family, or continues an existing one. Names in _total are counters.
  void begin(std::string_view name, std::string_view help, MetricType others = MetricType::Gauge) {
    const auto found =
        std::find_if(families_.begin(), families_.end(), [name](const auto& f) { return f.name == name; });
    now_ = static_cast<std::size_t>(found - families_.begin());
    if (found != families_.end()) return;
    families_.push_back(
        {std::string(name), std::string(help), name.ends_with("_total") ? MetricType::Counter : others, {}});
  }
  void value(double value, Labels labels = {}) {
    ClientMetric& metric = add(std::move(labels));
    metric.counter.value = value;
    metric.gauge.value = value;
  }
  void gauge(std::string_view name, std::string_view help, double reading) {
    begin(name, help);
    value(reading);
  }
  void histogram(const rt::LatencyHistogram& source, Labels labels = {}) {
    add(std::move(labels)).histogram = convert(source);
  }
  std::vector<MetricFamily> take() { return std::move(families_); }

 private:
  ClientMetric& add(Labels labels) {
    ClientMetric& metric = families_[now_].metric.emplace_back();
    metric.label = std::move(labels);
    return metric;
  }
  // Two of the eight counted buckets per octave, from 64 us to 1 s: enough to see a percentile move.
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
  std::size_t now_ = 0;
};

void add_information(const MetricsView& view, Families& to) {
  const pipeline::SourceInfo& source = view.pipeline.source();
  to.begin("bolo_build_info", "The program; always 1");
  to.value(1.0, {{"version", BOLO_VERSION}});
  // Prometheus rejects the whole scrape if a label is not UTF-8.
  to.begin("bolo_stream_info", "Who deblurs what, and how; always 1");
  to.value(1.0, {{"name", view.name},
                 {"camera_model", printable(source.camera_model)},
                 {"camera_serial", printable(source.camera_serial)},
                 {"solver", view.pipeline.solver_text()}});
  to.gauge("bolo_frame_period_seconds", "From one frame of the stream to the next",
           view.pipeline.stats().period_s.value());
}

template <typename Source>
double metric_value(const pipeline::CounterRow<Source>& row, std::uint64_t word) {
  using pipeline::RowKind;
  if (row.kind == RowKind::kReal) return std::bit_cast<double>(word) * row.metric_scale;
  return static_cast<double>(word) * row.metric_scale;
}

// Reads from the last row to the first, so that derived counters never exceed those they derive from.
template <typename Source, std::size_t N>
void add_rows(const std::array<pipeline::CounterRow<Source>, N>& rows, const Source& source, Families& to) {
  std::array<std::vector<std::uint64_t>, N> words;
  for (std::size_t n = N; n-- > 0;) {
    for (std::size_t i = 0; i < rows[n].parts; ++i) words[n].push_back(rows[n].read(source, i));
  }
  for (std::size_t n = 0; n < N; ++n) {
    const pipeline::CounterRow<Source>& row = rows[n];
    if (row.metric.empty()) continue;
    to.begin(row.metric, row.help);
    for (std::size_t i = 0; i < row.parts; ++i) {
      Labels labels;
      if (!row.label.empty()) labels.push_back({std::string(row.label), part_key(row, i)});
      to.value(metric_value(row, words[n][i]), std::move(labels));
    }
  }
}

// 1 for the enumeration's current value, 0 for the others.
template <typename Enum>
void add_choice(const char* metric, const char* help, const char* label, std::size_t count, Enum now, Families& to) {
  to.begin(metric, help);
  for (std::size_t i = 0; i < count; ++i) {
    to.value(now == static_cast<Enum>(i) ? 1.0 : 0.0, {{label, std::string(name(static_cast<Enum>(i)))}});
  }
}

void add_frames(const pipeline::PipelineStats& stats, Families& to) {
  add_rows(pipeline::kFrameCounters, stats, to);
  add_choice("bolo_effort", "1 for what is spent on frames now", "effort", pipeline::kQualityLevels,
             stats.effort.value(), to);
  to.gauge("bolo_queue_frames", "Frames that wait for the pipeline", static_cast<double>(stats.waiting()));
}

void add_latencies(const pipeline::PipelineStats& stats, Families& to) {
  to.begin("bolo_latency_seconds", "From a frame's first byte to its being handed to the sinks", MetricType::Histogram);
  to.histogram(stats.latency);
  to.begin("bolo_stage_latency_seconds",
           "Where that time goes: arrival (until the frame is whole), queue, deblur, and publish (the sinks' copies)",
           MetricType::Histogram);
  for (const auto& stage : pipeline::kStages) {
    to.histogram(stats.stages.*stage.latency, {{"stage", std::string(stage.name)}});
  }
}

void add_camera(const pipeline::SourceStatus& source, Families& to) {
  add_choice("bolo_camera_state", "1 for the state that the camera is in", "state", pipeline::kSourceStates,
             source.state.value(), to);
  if (source.ptp.value() != pipeline::PtpStatus::kOff) {
    add_choice("bolo_camera_ptp_state", "1 for the state of its PTP clock", "state", pipeline::kPtpStatuses,
               source.ptp.value(), to);
    to.gauge("bolo_camera_ptp_offset_seconds", "Of its clock from its PTP master, as it reckons",
             static_cast<double>(source.ptp_offset_ns.value()) * 1e-9);
  }
  add_rows(pipeline::kCameraCounters, source, to);
  const double temperature_k = source.temperature_k.value();
  if (temperature_k > 0.0) {
    to.gauge("bolo_camera_temperature_celsius", "Of the camera itself", temperature_k - kZeroCelsius);
  }
}

// Sinks of the same kind share metric families.
void add_sinks(std::span<pipeline::FrameSink* const> sinks, Families& to) {
  for (const pipeline::FrameSink* sink : sinks) {
    const pipeline::SinkStatistics statistics = sink->statistics();
    for (const pipeline::SinkNumber& number : statistics.numbers) {
      to.begin(number.metric, number.help);
      to.value(static_cast<double>(number.value), {{std::string(statistics.label), statistics.name}});
    }
  }
}

struct Listen {
  std::string port;
  IpAddress address{};
};

// "127.0.0.1:9464", "[::1]:9464"
std::optional<Listen> parse(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) return std::nullopt;
  std::string host = text.substr(0, colon);
  const auto port = whole_number<std::uint16_t>(std::string_view(text).substr(colon + 1));
  const bool in_brackets = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (in_brackets) host = host.substr(1, host.size() - 2);
  const auto address = ip_address(host, port.value_or(0));
  if (port.value_or(0) == 0 || !address || in_brackets != (address->place.ss_family == AF_INET6)) return std::nullopt;
  return Listen{std::to_string(*port), *address};
}

constexpr RequestServer::Limits kMetricsLimits{.clients = 16, .patience_ms = 2000, .longest_request = 8192};

std::string http_answer(const std::string& status, const std::string& body) {
  return "HTTP/1.1 " + status + "\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: " +
         std::to_string(body.size()) + "\r\nConnection: close\r\n\r\n" + body;
}

// Nothing: the headers are incomplete.
std::optional<std::string> answer_to(std::string_view received, const CollectMetrics& collect) {
  if (received.find("\r\n\r\n") == std::string_view::npos) return std::nullopt;
  if (!received.starts_with("GET ")) return http_answer("405 Method Not Allowed", "only GET is understood\n");
  const std::string_view path = received.substr(4, received.find_first_of(" ?\r", 4) - 4);
  if (path != "/metrics") return http_answer("404 Not Found", "what is here is /metrics\n");
  return http_answer("200 OK", prometheus::TextSerializer().Serialize(collect()));
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
  add_sinks(view.pipeline.sinks(), families);
  return families.take();
}

Status check_listen(const MetricsOptions& options) {
  const auto listen = parse(options.listen);
  if (!listen) {
    return bad_input("metrics.listen = \"" + options.listen + "\" is no ADDRESS:PORT such as 127.0.0.1:9464");
  }
  if (listen->address.loopback || options.allow_remote) return {};
  return bad_input("metrics.listen = \"" + options.listen +
                   "\" is within other computers' reach: use 127.0.0.1, or set metrics.allow_remote = true");
}

Result<std::unique_ptr<RequestServer>> metrics_server(const MetricsOptions& options, CollectMetrics collect) {
  RETURN_IF_ERROR(check_listen(options));
  const Listen listen = *parse(options.listen);
  UniqueFd listener = listen_on(listen.address, RequestServer::kBacklog, false);
  if (!listener) {
    return failed("metrics.listen: cannot listen at " + options.listen + " (" + std::strerror(errno) +
                  "); who has it: ss -ltnp 'sport = :" + listen.port +
                  "'; end that, or set metrics.listen to a free port");
  }
  try {
    return std::make_unique<RequestServer>(
        std::move(listener), kMetricsLimits,
        [collect = std::move(collect)](std::string_view received) { return answer_to(received, collect); });
  } catch (const std::system_error& e) {
    return failed("metrics: " + describe_exception(e));
  }
}

}  // namespace bolo::daemon
