#include "drivers/genicam/session.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <functional>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "drivers/genicam/nodes.hpp"
#include "src/core/clock.hpp"
#include "src/core/threads.hpp"

namespace bolo::genicam {
namespace {

using std::chrono::milliseconds;

constexpr std::int64_t kReopenLimitNs = 8'000'000'000;  // FLIR's A6xx return 3.5 to 5 s after a windowing change
constexpr int kFewestFrames = 40;                       // minimum number of buffers
// Without resends an incomplete frame is abandoned when a later one is complete. The retention then only limits a
// sender's pause within a frame, and a short one loses frames needlessly on a busy machine.
constexpr int kPauseWithoutResendUs = 100'000;

// GigE Vision registers, of the first stream channel.
constexpr std::uint64_t kStreamCapability = 0x092c;
constexpr std::uint32_t kHasSourcePort = 0x80000000;
constexpr std::uint64_t kCapabilities = 0x0934;
constexpr std::uint32_t kResends = 1U << 2U;
constexpr std::uint64_t kStreamPort = 0x0d00;
constexpr std::uint64_t kStreamAddress = 0x0d18;
constexpr std::uint64_t kStreamSourcePort = 0x0d1c;

void sleep_unless(const std::atomic<bool>& stop_requested, milliseconds time) {
  const auto until = std::chrono::steady_clock::now() + time;
  while (!stop_requested.load(std::memory_order_relaxed) && std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(milliseconds(20));
  }
}

// True when the camera still answers and is controlled at the end of watch_ms.
bool stays_controlled(const Connection& connection, int watch_ms, const std::atomic<bool>& stop_requested) {
  const std::int64_t until_ns = monotonic_ns() + watch_ms * 1'000'000LL;
  while (is_controlled(connection)) {
    if (monotonic_ns() >= until_ns) return true;
    if (stop_requested.load(std::memory_order_relaxed)) return false;
    sleep_unless(stop_requested, milliseconds(50));
  }
  return false;
}

// --- Stream of a USB3 Vision camera, received by Aravis.

constexpr std::int64_t kOldestNs = 1'000'000'000;  // maximum time from a frame's first packet to its delivery here

// Arrival of the first packet on CLOCK_MONOTONIC. Aravis stamps it with the wall clock (microseconds); a step of that
// clock within the frame is an error of that size. An implausible time is replaced by the present.
std::int64_t first_packet_ns(ArvBuffer* buffer) noexcept {
  const auto system_ns = static_cast<std::int64_t>(arv_buffer_get_system_timestamp(buffer));
  const std::int64_t now_ns = monotonic_ns();
  const std::int64_t age_ns = realtime_ns() - system_ns;
  return age_ns >= 0 && age_ns < kOldestNs ? now_ns - age_ns : now_ns;
}

FrameEnd end_of(ArvBuffer* buffer) noexcept {
  switch (arv_buffer_get_status(buffer)) {
    case ARV_BUFFER_STATUS_SUCCESS:
      return FrameEnd::kWhole;
    case ARV_BUFFER_STATUS_UNKNOWN:
    case ARV_BUFFER_STATUS_CLEARED:
    case ARV_BUFFER_STATUS_FILLING:
    case ARV_BUFFER_STATUS_ABORTED:
      return FrameEnd::kDriver;
    default:  // later versions of Aravis add error codes
      return FrameEnd::kIncomplete;
  }
}

CameraFrame frame_of(ArvBuffer* buffer) noexcept {
  CameraFrame frame;
  frame.end = end_of(buffer);
  frame.id = arv_buffer_get_frame_id(buffer);
  if (frame.end != FrameEnd::kWhole || frame.id == CameraFrame::kNoId) return frame;
  frame.camera_ns = static_cast<std::int64_t>(arv_buffer_get_timestamp(buffer));
  frame.receive_ns = first_packet_ns(buffer);
  frame.mono16 = arv_buffer_get_payload_type(buffer) == ARV_BUFFER_PAYLOAD_TYPE_IMAGE &&
                 arv_buffer_get_image_pixel_format(buffer) == ARV_PIXEL_FORMAT_MONO_16;
  if (!frame.mono16) return frame;
  int y_padding = 0;
  std::size_t size = 0;
  const void* data = arv_buffer_get_image_data(buffer, &size);
  arv_buffer_get_image_padding(buffer, &frame.x_padding, &y_padding);
  frame.width = arv_buffer_get_image_width(buffer);
  frame.height = arv_buffer_get_image_height(buffer);
  frame.pixels = {static_cast<const std::byte*>(data), data != nullptr ? size : 0};
  return frame;
}

}  // namespace

class AravisStream {
 public:
  // Delivers frames to `take` on Aravis's thread until destruction. payload_bytes: per frame. A refused priority is a
  // warning. Thread: setup.
  static Result<std::unique_ptr<AravisStream>> start(const Connection& connection, const CameraOptions& options,
                                                     std::size_t payload_bytes,
                                                     std::function<void(const CameraFrame&)> take,
                                                     std::vector<std::string>& warnings) {
    RETURN_IF_ERROR(check_resources());
    std::unique_ptr<AravisStream> made(new AravisStream(options.realtime_priority, std::move(take)));
    GlibError error;
    made->stream_.reset(
        arv_device_create_stream(connection.device.get(), &AravisStream::on_stream, made.get(), error.out()));
    if (error || made->stream_ == nullptr) return failed(connection.name + ": no stream (" + error.message() + ")");
    made->running_.store(made->stream_.get(), std::memory_order_release);  // partner: drain()
    made->await_priority(warnings);
    for (int i = 0; i < std::max(options.buffers, kFewestFrames); ++i) {
      ArvBuffer* buffer = arv_buffer_new_allocate(payload_bytes);
      arv_buffer_set_frame_id(buffer, CameraFrame::kNoId);
      arv_stream_push_buffer(made->stream_.get(), buffer);
    }
    return made;
  }

  ~AravisStream() {
    running_.store(nullptr, std::memory_order_release);  // partner: drain(); stops the reuse of buffers
  }

 private:
  AravisStream(int realtime_priority, std::function<void(const CameraFrame&)> take)
      : realtime_priority_(realtime_priority), take_(std::move(take)) {}

  static void on_stream(void* self, ArvStreamCallbackType type, ArvBuffer*) {
    auto* stream = static_cast<AravisStream*>(self);
    if (type == ARV_STREAM_CALLBACK_TYPE_INIT) {
      const Status granted = gvsp::raise_priority("", stream->realtime_priority_);
      stream->priority_.store(granted ? Priority::kGranted : Priority::kRefused,
                              std::memory_order_release);  // partner: await_priority()
    }
    if (type == ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE) stream->drain();
  }

  // A completed buffer is already in the output queue: pop it, use it, push it back at once.
  void drain() noexcept {
    ArvStream* stream = running_.load(std::memory_order_acquire);  // partner: start()
    if (stream == nullptr) return;
    while (ArvBuffer* buffer = arv_stream_try_pop_buffer(stream)) {
      take_(frame_of(buffer));
      // Only the frame's first packet sets the id: a frame that still has kNoId lost that packet.
      arv_buffer_set_frame_id(buffer, CameraFrame::kNoId);
      arv_stream_push_buffer(stream, buffer);
    }
  }

  // Waits until the thread has set its priority, to know of a refusal.
  void await_priority(std::vector<std::string>& warnings) const {
    constexpr int kTries = 1000;
    for (int i = 0; i < kTries; ++i) {
      if (priority_.load(std::memory_order_acquire) != Priority::kPending) break;  // partner: on_stream()
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    if (priority_.load(std::memory_order_acquire) == Priority::kRefused) {  // partner: on_stream()
      warnings.push_back(gvsp::refused_priority(realtime_priority_));
    }
  }

  enum class Priority { kPending, kGranted, kRefused };

  const int realtime_priority_;
  const std::function<void(const CameraFrame&)> take_;
  std::atomic<Priority> priority_{Priority::kPending};
  std::atomic<ArvStream*> running_{nullptr};  // stream_, for the thread that Aravis starts while creating it
  Ref<ArvStream> stream_;
};

Result<std::unique_ptr<Session>> Session::open(const CameraOptions& options, bool search,
                                               const std::atomic<bool>& stop_requested,
                                               std::vector<std::string>& warnings) {
  std::int64_t give_up_ns = 0;  // set once the camera may drop the connection
  milliseconds pause(250);
  for (;;) {
    std::vector<std::string> found;
    auto connection = connect(options, search);
    auto negotiated = connection ? configure(*connection, options, found)
                                 : Result<Negotiated>(tl::unexpected<Error>(connection.error()));
    if (negotiated && negotiated->windowing_changed) {
      if (give_up_ns == 0) give_up_ns = monotonic_ns() + kReopenLimitNs;
      if (stays_controlled(*connection, options.windowing_watch_ms, stop_requested)) {
        negotiated = configure(*connection, options, found);
      }
    }
    if (negotiated && !negotiated->windowing_changed) {
      RETURN_IF_ERROR(configure_packet_size(*connection, options, found));
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
  attempt([this] {  // out of memory: the camera times out by itself
    if (!began_ || control_lost() || !answers()) return;
    Nodes nodes(connection_.device.get());
    nodes.execute("AcquisitionStop");
    if (nodes.has("TLParamsLocked")) nodes.set_integer("TLParamsLocked", 0);
    GlibError ignored;
    if (gvsp_ != nullptr) arv_device_write_register(connection_.device.get(), kStreamPort, 0, ignored.out());
  });
}

Status Session::prepare(FrameReceiver& receiver, std::shared_ptr<pipeline::SourceStatus> status,
                        std::vector<std::string>& warnings) {
  receiver_ = &receiver;
  if (!answers()) return failed(connection_.name + " does not answer any more");  // the calls below ask it for seconds
  ASSIGN_OR_RETURN(const std::size_t payload, payload_bytes());
  if (connection_.is_gige()) return start_gvsp(payload, std::move(status), warnings);
  const auto take_frame = [this](const CameraFrame& frame) { take(frame); };
  ASSIGN_OR_RETURN(other_, AravisStream::start(connection_, options_, payload, take_frame, warnings));
  return {};
}

Status Session::begin() {
  began_ = true;
  Nodes nodes(connection_.device.get());
  // Do not reset a clock that is synchronised by PTP.
  if (!read_ptp(nodes).enabled && nodes.has("GevTimestampControlReset")) nodes.execute("GevTimestampControlReset");
  if (nodes.has("TLParamsLocked")) nodes.set_integer("TLParamsLocked", 1);
  nodes.execute("AcquisitionStart");
  if (!nodes.ok()) return at(connection_.name, nodes.status().error());
  return {};
}

Status Session::trigger_nuc() {
  Nodes nodes(connection_.device.get());
  if (!nodes.has("NUCAction"))
    return failed(connection_.name + " has no NUCAction: it cannot be told to correct itself");
  nodes.execute("NUCAction");
  if (!nodes.ok()) return at(connection_.name, nodes.status().error());
  return {};
}

Status Session::set_nuc(const NucOptions& nuc, std::vector<std::string>& warnings) {
  Nodes nodes(connection_.device.get());
  configure_nuc(nodes, nuc, warnings);
  return nodes.status();
}

PtpState Session::ptp() {
  Nodes nodes(connection_.device.get());
  PtpState state = read_ptp(nodes);
  return nodes.ok() ? std::move(state) : PtpState{};
}

double Session::temperature_k() {
  constexpr double kZeroCelsius = 273.15;
  constexpr double kHottestCelsius = 150.0;  // above, it is kelvin. Untested: the standard says degrees Celsius
  Nodes nodes(connection_.device.get());
  if (!nodes.has("DeviceTemperature")) return 0.0;
  const double value = nodes.number("DeviceTemperature");
  if (!nodes.ok()) return 0.0;
  return value > kHottestCelsius ? value : value + kZeroCelsius;
}

// Runs on the heartbeat's thread, which the device's destruction joins: only sets the flag.
void Session::on_control_lost(ArvDevice*, void* flag) {
  static_cast<std::atomic<bool>*>(flag)->store(true, std::memory_order_relaxed);
}

// --- creating the stream ---

Result<std::size_t> Session::payload_bytes() {
  constexpr std::int64_t kAlwaysTaken = 4 << 20;
  constexpr std::int64_t kMostImages = 4;  // maximum frame size in images, for padding and chunks
  const auto pixels = static_cast<std::int64_t>(negotiated_.info.format.geometry.pixels());
  const std::int64_t most = std::max(kAlwaysTaken, kMostImages * 2 * pixels);  // of 16 bits
  Nodes nodes(connection_.device.get());
  const std::int64_t bytes = nodes.integer("PayloadSize");
  if (!nodes.ok()) return at(connection_.name, nodes.status().error());
  if (bytes <= 0) return failed(connection_.name + " says that its frames are empty (PayloadSize 0)");
  if (bytes > most) {
    return failed(fmt::format("{} says that its frames have {} bytes (PayloadSize): {} at most are taken",
                              connection_.name, bytes, most));
  }
  return static_cast<std::size_t>(bytes);
}

Status Session::start_gvsp(std::size_t payload_bytes, std::shared_ptr<pipeline::SourceStatus> status,
                           std::vector<std::string>& warnings) {
  ASSIGN_OR_RETURN(gvsp_,
                   at(connection_.name, gvsp::Receiver::open(connection_.route.local_address, connection_.address,
                                                             options_.socket_buffer_bytes)));
  ArvDevice* device = connection_.device.get();
  GlibError error;
  const in_addr own = address_of(connection_.route.local_address, 0).sin_addr;
  arv_device_write_register(device, kStreamAddress, ntohl(own.s_addr), error.out());
  if (!error) arv_device_write_register(device, kStreamPort, gvsp_->port(), error.out());
  if (error) return failed(connection_.name + ": it is not told where to send its stream (" + error.message() + ")");
  ASSIGN_OR_RETURN(const gvsp::StreamPlan plan, plan_stream(payload_bytes, warnings));
  try {
    const Status raised = gvsp_->start(
        plan, source_port(), options_.realtime_priority, [this](const CameraFrame& frame) { take(frame); },
        std::move(status));
    if (!raised) warnings.push_back(gvsp::refused_priority(options_.realtime_priority));
  } catch (const std::system_error& e) {
    return failed(connection_.name + ": " + describe_exception(e));
  }
  return {};
}

Result<gvsp::StreamPlan> Session::plan_stream(std::size_t payload_bytes, std::vector<std::string>& warnings) {
  const int largest = largest_socket_buffer();
  if (largest > 0 && options_.socket_buffer_bytes > largest) {
    warnings.push_back(
        fmt::format("asked for a socket buffer of {0} bytes, the kernel grants {1}: sysctl -w net.core.rmem_max={0}",
                    options_.socket_buffer_bytes, largest));
  }
  ArvGvDevice* device = ARV_GV_DEVICE(connection_.device.get());
  GlibError error;
  gvsp::StreamPlan plan;
  plan.payload_bytes = payload_bytes;
  plan.packet_bytes = arv_gv_device_get_packet_size(device, error.out());
  if (error || plan.packet_bytes < std::size_t{kSmallestPacket}) {
    return failed(fmt::format("{} sends packets of {} bytes: {} is the least", connection_.name, plan.packet_bytes,
                              kSmallestPacket));
  }
  plan.frames = static_cast<std::size_t>(std::max(options_.buffers, kFewestFrames));
  plan.period_ns = to_ns(negotiated_.info.format.frame_period_s);
  plan.ticks_per_s = arv_gv_device_get_timestamp_tick_frequency(device, error.out());
  if (error || plan.ticks_per_s > gvsp::kMostTicksPerSecond) plan.ticks_per_s = 0;
  if (plan.ticks_per_s == 0) warnings.push_back("the camera has no clock: this computer's stands in for it");
  plan.resend = options_.resend && (read_register(kCapabilities) & kResends) != 0;
  if (options_.resend && !plan.resend) warnings.push_back("asked for resends, the camera cannot send packets again");
  const int retention_us =
      plan.resend ? options_.frame_retention_us : std::max(options_.frame_retention_us, kPauseWithoutResendUs);
  plan.packet_timeout_ns = options_.packet_timeout_us * kNsPerUs;
  plan.retention_ns = retention_us * kNsPerUs;
  return plan;
}

// Source port of the camera's stream packets; 0 when unknown.
std::uint16_t Session::source_port() {
  return (read_register(kStreamCapability) & kHasSourcePort) != 0
             ? static_cast<std::uint16_t>(read_register(kStreamSourcePort))
             : std::uint16_t{0};
}

// 0 when the camera does not have the register.
std::uint32_t Session::read_register(std::uint64_t address) {
  GlibError error;
  std::uint32_t value = 0;
  arv_device_read_register(connection_.device.get(), address, &value, error.out());
  return error ? 0 : value;
}

// Thread: acquire.
void Session::take(const CameraFrame& frame) noexcept {
  if (!gate_.enter()) return;
  receiver_->take(frame);
  gate_.leave();
}

}  // namespace bolo::genicam
