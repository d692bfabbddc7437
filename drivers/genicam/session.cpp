#include "drivers/genicam/session.hpp"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "drivers/genicam/nodes.hpp"
#include "drivers/genicam/object.hpp"
#include "src/core/clock.hpp"

namespace bolo::genicam {
namespace {

using std::chrono::milliseconds;

constexpr std::int64_t kReopenLimitNs = 8'000'000'000;  // FLIR's A6xx come back 3.5 to 5 s after a new windowing
constexpr int kFewestBuffers = 40;
// Without resends Aravis gives a frame up when the next one begins. The retention then only decides how long a sender
// may pause within a frame, and a short one loses frames for nothing on a busy machine.
constexpr int kPauseWithoutResendUs = 100'000;
constexpr int kNiceLevel = -10;  // of the receiving thread when no real-time priority is asked for

void sleep_unless(const std::atomic<bool>& stop_requested, milliseconds time) {
  const auto until = std::chrono::steady_clock::now() + time;
  while (!stop_requested.load(std::memory_order_relaxed) && std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(milliseconds(20));
  }
}

// The camera still answers and is still controlled at the end of the time.
bool stays(const Connection& connection, int watch_ms, const std::atomic<bool>& stop_requested) {
  const std::int64_t until_ns = monotonic_ns() + watch_ms * 1'000'000LL;
  while (is_controlled(connection)) {
    if (monotonic_ns() >= until_ns) return true;
    if (stop_requested.load(std::memory_order_relaxed)) return false;
    sleep_unless(stop_requested, milliseconds(50));
  }
  return false;
}

}  // namespace

Result<std::unique_ptr<Session>> Session::open(const CameraOptions& options, const std::atomic<bool>& stop_requested,
                                               std::vector<std::string>& warnings) {
  std::int64_t give_up_ns = 0;  // set once the camera may drop the connection
  milliseconds pause(250);
  for (;;) {
    std::vector<std::string> found;
    auto connection = connect(options);
    auto negotiated = connection ? configure(*connection, options, found)
                                 : Result<Negotiated>(tl::unexpected<Error>(connection.error()));
    if (negotiated && negotiated->windowing_changed) {
      if (give_up_ns == 0) give_up_ns = monotonic_ns() + kReopenLimitNs;
      if (stays(*connection, options.windowing_watch_ms, stop_requested)) {
        negotiated = configure(*connection, options, found);
      }
    }
    if (negotiated && !negotiated->windowing_changed) {
      if (Status size = configure_packet_size(*connection, options, found); !size) {
        return tl::unexpected<Error>(std::move(size.error()));
      }
      warnings.insert(warnings.end(), found.begin(), found.end());
      return std::unique_ptr<Session>(new Session(std::move(*connection), std::move(*negotiated), options));
    }
    if (monotonic_ns() >= give_up_ns || stop_requested.load(std::memory_order_relaxed)) {
      if (negotiated) return failed(connection->name + " does not keep the windowing that it was given");
      return tl::unexpected<Error>(std::move(negotiated.error()));
    }
    if (connection) connection->device.reset();
    sleep_unless(stop_requested, pause);
    pause = std::min(pause * 2, milliseconds(1000));
  }
}

Session::Session(Connection connection, Negotiated negotiated, const CameraOptions& options)
    : options_(options), negotiated_(std::move(negotiated)), connection_(std::move(connection)) {
  g_signal_connect(connection_.device.get(), "control-lost", G_CALLBACK(&Session::on_control_lost),
                   connection_.control_lost.get());
}

Session::~Session() {
  gate_.shut();
  running_.store(nullptr, std::memory_order_release);  // partner: drain(); buffers are not turned round any more
  if (began_ && !control_lost() && answers()) {
    Nodes nodes(connection_.device.get());
    nodes.execute("AcquisitionStop");
    if (nodes.has("TLParamsLocked")) nodes.set_integer("TLParamsLocked", 0);
  }
}

Status Session::prepare(Intake& intake, std::vector<std::string>& warnings) {
  intake_ = &intake;
  if (Status made = create_stream(warnings); !made) return made;
  tune_stream(warnings);
  await_priority(warnings);
  return push_buffers();
}

Status Session::begin() {
  began_ = true;
  Nodes nodes(connection_.device.get());
  if (nodes.has("GevTimestampControlReset")) nodes.execute("GevTimestampControlReset");
  if (nodes.has("TLParamsLocked")) nodes.set_integer("TLParamsLocked", 1);
  nodes.execute("AcquisitionStart");
  if (!nodes.ok()) return at(connection_.name, nodes.status().error());
  return {};
}

Status Session::correct() {
  Nodes nodes(connection_.device.get());
  if (!nodes.has("NUCAction"))
    return failed(connection_.name + " has no NUCAction: it cannot be told to correct itself");
  nodes.execute("NUCAction");
  if (!nodes.ok()) return at(connection_.name, nodes.status().error());
  return {};
}

Status Session::follow(const NucOptions& nuc, std::vector<std::string>& warnings) {
  Nodes nodes(connection_.device.get());
  configure_nuc(nodes, nuc, warnings);
  return nodes.status();
}

double Session::temperature_k() {
  constexpr double kZeroCelsius = 273.15;
  constexpr double kHottestCelsius = 150.0;  // above, it is kelvin. Unproven: the standard says degrees Celsius
  Nodes nodes(connection_.device.get());
  if (!nodes.has("DeviceTemperature")) return 0.0;
  const double value = nodes.number("DeviceTemperature");
  if (!nodes.ok()) return 0.0;
  return value > kHottestCelsius ? value : value + kZeroCelsius;
}

TransportStats Session::transport() const {
  TransportStats stats;
  if (stream_ == nullptr) return stats;
  const auto value = [&](const char* name) { return arv_stream_get_info_uint64_by_name(stream_.get(), name); };
  stats.completed_buffers = value("n_completed_buffers");
  stats.failures = value("n_failures");
  stats.underruns = value("n_underruns");
  if (!connection_.is_gige()) return stats;
  stats.received_packets = value("n_received_packets");
  stats.missing_packets = value("n_missing_packets");
  stats.resend_requests = value("n_resend_requests");
  stats.resent_packets = value("n_resent_packets");
  stats.ignored_packets = value("n_ignored_packets");
  return stats;
}

// --- Aravis's threads ---

void Session::on_stream(void* self, ArvStreamCallbackType type, ArvBuffer*) {
  auto* session = static_cast<Session*>(self);
  if (type == ARV_STREAM_CALLBACK_TYPE_INIT) session->set_priority();
  if (type == ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE) session->drain();
}

// On the heartbeat's thread, which the device's end waits for: nothing but the flag.
void Session::on_control_lost(ArvDevice*, void* flag) {
  static_cast<std::atomic<bool>*>(flag)->store(true, std::memory_order_relaxed);
}

void Session::set_priority() noexcept {
  Priority result = Priority::kNotAsked;
  if (options_.realtime_priority > 0) {
    result = arv_make_thread_realtime(options_.realtime_priority) != FALSE ? Priority::kGranted : Priority::kRefused;
  } else {
    arv_make_thread_high_priority(kNiceLevel);  // as far as it is allowed
  }
  priority_.store(result, std::memory_order_release);  // partner: await_priority()
}

// The buffer that is done is in the output queue already: take it, use it, give it back at once.
void Session::drain() noexcept {
  ArvStream* stream = running_.load(std::memory_order_acquire);  // partner: create_stream()
  if (stream == nullptr) return;
  while (ArvBuffer* buffer = arv_stream_try_pop_buffer(stream)) {
    if (gate_.enter()) {
      intake_->take(buffer);
      gate_.leave();
    }
    arv_buffer_set_frame_id(buffer, Intake::kNoId);
    arv_stream_push_buffer(stream, buffer);
  }
}

// --- making the stream ---

Status Session::create_stream(std::vector<std::string>& warnings) {
  if (connection_.is_gige()) {
    // Never the packet socket: its kernel ring hands packets over in blocks, up to 5 ms (a whole frame) late, it needs
    // CAP_NET_RAW, and it fails on the loopback.
    arv_gv_device_set_stream_options(ARV_GV_DEVICE(connection_.device.get()),
                                     ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    GlibError error;
    const guint64 ticks =
        arv_gv_device_get_timestamp_tick_frequency(ARV_GV_DEVICE(connection_.device.get()), error.out());
    if (error || ticks == 0) warnings.push_back("the camera has no clock: this computer's stands in for it");
  }
  GlibError error;
  stream_.reset(arv_device_create_stream(connection_.device.get(), &Session::on_stream, this, error.out()));
  if (error || stream_ == nullptr) {
    return failed(connection_.name + ": no stream (" + error.message() + ")");
  }
  if (ARV_IS_GV_STREAM(stream_.get()) && !drop_short_packets(arv_gv_stream_get_port(ARV_GV_STREAM(stream_.get())))) {
    warnings.push_back("stray datagrams to the stream's port are not kept away: they can end this program");
  }
  running_.store(stream_.get(), std::memory_order_release);  // partner: drain()
  return {};
}

void Session::tune_stream(std::vector<std::string>& warnings) {
  if (!ARV_IS_GV_STREAM(stream_.get())) return;
  const int largest = largest_socket_buffer();
  if (largest > 0 && options_.socket_buffer_bytes > largest) {
    warnings.push_back("asked for a socket buffer of " + std::to_string(options_.socket_buffer_bytes) +
                       " bytes, the kernel grants " + std::to_string(largest) +
                       ": sysctl -w net.core.rmem_max=" + std::to_string(options_.socket_buffer_bytes));
  }
  ArvGvStreamPacketResend able = ARV_GV_STREAM_PACKET_RESEND_NEVER;
  g_object_get(stream_.get(), "packet-resend", &able, nullptr);
  const bool resend = options_.resend && able == ARV_GV_STREAM_PACKET_RESEND_ALWAYS;
  if (options_.resend && !resend) warnings.push_back("asked for resends, the camera cannot send packets again");
  const int retention_us =
      resend ? options_.frame_retention_us : std::max(options_.frame_retention_us, kPauseWithoutResendUs);
  g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
               options_.socket_buffer_bytes, "packet-resend",
               resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER, "packet-timeout",
               static_cast<guint>(options_.packet_timeout_us), "frame-retention", static_cast<guint>(retention_us),
               nullptr);
}

// The receiving thread sets its priority first thing; waits for that so that a refusal is known.
void Session::await_priority(std::vector<std::string>& warnings) const {
  constexpr int kTries = 1000;
  for (int i = 0; i < kTries; ++i) {
    if (priority_.load(std::memory_order_acquire) != Priority::kPending) break;  // partner: set_priority()
    std::this_thread::sleep_for(milliseconds(1));
  }
  if (priority_.load(std::memory_order_acquire) == Priority::kRefused) {  // partner: set_priority()
    warnings.push_back("asked for real-time priority " + std::to_string(options_.realtime_priority) +
                       " of the receiving thread, refused: raise LimitRTPRIO (systemd) or ulimit -r");
  }
}

Status Session::push_buffers() {
  Nodes nodes(connection_.device.get());
  const std::int64_t bytes = nodes.integer("PayloadSize");
  if (!nodes.ok()) return at(connection_.name, nodes.status().error());
  if (bytes <= 0) return failed(connection_.name + " says that its frames are empty (PayloadSize 0)");
  const int count = std::max(options_.buffers, kFewestBuffers);
  for (int i = 0; i < count; ++i) {
    ArvBuffer* buffer = arv_buffer_new_allocate(static_cast<std::size_t>(bytes));
    arv_buffer_set_frame_id(buffer, Intake::kNoId);
    arv_stream_push_buffer(stream_.get(), buffer);
  }
  return {};
}

}  // namespace bolo::genicam
