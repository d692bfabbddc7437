#include "tools/bolod/metrics.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <prometheus/text_serializer.h>

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

// Families in the order in which they are begun.
class Families {
 public:
  // Goes on with the family when it was begun before. Names in _total are counters.
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
  std::size_t now_ = 0;
};

void add_information(const MetricsView& view, Families& to) {
  const pipeline::SourceInfo& source = view.pipeline.source();
  to.begin("bolo_build_info", "The program; always 1");
  to.value(1.0, {{"version", BOLO_VERSION}});
  to.begin("bolo_stream_info", "Who deblurs what, and how; always 1");
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

// Read from the last row to the first: counters derived from other frames' are then never larger than these.
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

// 1 for the one of an enumeration's values that holds now.
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

// Sinks of a kind share the families of their numbers.
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
  std::string host;
  int port = 0;
};

// "127.0.0.1:9464", "[::1]:9464"
std::optional<Listen> parse(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) return std::nullopt;
  Listen listen{text.substr(0, colon)};
  const char* const end = text.data() + text.size();
  const auto [read, error] = std::from_chars(text.data() + colon + 1, end, listen.port);
  constexpr int kMostPorts = 65535;
  if (error != std::errc() || read != end || listen.port < 1 || listen.port > kMostPorts) return std::nullopt;
  return listen;
}

struct Address {
  bool valid = false;
  bool loopback = false;
};

Address classify(const std::string& host) {
  constexpr std::uint32_t kLoopbackNet = 127;
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return {true, ntohl(v4.s_addr) >> 24 == kLoopbackNet};
  if (host.size() < 2 || host.front() != '[' || host.back() != ']') return {};
  in6_addr v6{};
  if (inet_pton(AF_INET6, host.substr(1, host.size() - 2).c_str(), &v6) != 1) return {};
  return {true, IN6_IS_ADDR_LOOPBACK(&v6) != 0};
}

constexpr RequestServer::Limits kMetricsLimits{.clients = 16, .patience_ms = 2000, .longest_request = 8192};

// Of an address that check_listen() let pass.
Result<UniqueFd> listen_at(const Listen& listen) {
  sockaddr_storage place{};
  auto& v4 = reinterpret_cast<sockaddr_in&>(place);
  auto& v6 = reinterpret_cast<sockaddr_in6&>(place);
  const bool is_v6 = listen.host.starts_with('[');
  place.ss_family = is_v6 ? AF_INET6 : AF_INET;
  if (is_v6) {
    inet_pton(AF_INET6, listen.host.substr(1, listen.host.size() - 2).c_str(), &v6.sin6_addr);
    v6.sin6_port = htons(static_cast<std::uint16_t>(listen.port));
  } else {
    inet_pton(AF_INET, listen.host.c_str(), &v4.sin_addr);
    v4.sin_port = htons(static_cast<std::uint16_t>(listen.port));
  }
  const socklen_t bytes = is_v6 ? sizeof v6 : sizeof v4;
  UniqueFd fd(socket(place.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int on = 1;
  setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);  // after a daemon that has just ended
  if (fd && bind(fd.get(), reinterpret_cast<const sockaddr*>(&place), bytes) == 0 &&
      ::listen(fd.get(), RequestServer::kBacklog) == 0) {
    return fd;
  }
  const std::string port = std::to_string(listen.port);
  return failed("metrics.listen: cannot listen at " + listen.host + ":" + port + " (" + std::strerror(errno) +
                "); who has it: ss -ltnp 'sport = :" + port + "'; end that, or set metrics.listen to a free port");
}

std::string http_answer(const std::string& status, const std::string& body) {
  return "HTTP/1.1 " + status + "\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\nContent-Length: " +
         std::to_string(body.size()) + "\r\nConnection: close\r\n\r\n" + body;
}

// Nothing: the headers have not ended yet.
std::optional<std::string> answer_to(std::string_view received, const MetricsServer::Collect& collect) {
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
  const Address address = listen ? classify(listen->host) : Address{};
  if (!address.valid) {
    return bad_input("metrics.listen = \"" + options.listen + "\" is no ADDRESS:PORT such as 127.0.0.1:9464");
  }
  if (address.loopback || options.allow_remote) return {};
  return bad_input("metrics.listen = \"" + options.listen +
                   "\" is within other computers' reach: use 127.0.0.1, or set metrics.allow_remote = true");
}

Result<std::unique_ptr<MetricsServer>> MetricsServer::start(const MetricsOptions& options, Collect collect) {
  RETURN_IF_ERROR(check_listen(options));
  ASSIGN_OR_RETURN(UniqueFd listener, listen_at(*parse(options.listen)));
  try {
    return std::unique_ptr<MetricsServer>(new MetricsServer(std::move(listener), std::move(collect)));
  } catch (const std::system_error& e) {
    return failed("metrics: " + describe_exception(e));
  }
}

MetricsServer::MetricsServer(UniqueFd listener, Collect collect)
    : server_(std::move(listener), kMetricsLimits,
              [collect = std::move(collect)](std::string_view received) { return answer_to(received, collect); }) {}

}  // namespace bolo::daemon
