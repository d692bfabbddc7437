#include "drivers/fakecam/fake_camera.hpp"

#include <pthread.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cmath>
#include <exception>
#include <thread>

#include <fmt/format.h>

#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/network.hpp"
#include "drivers/fakecam/stream_session.hpp"
#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::size_t kMaxNameLength = 15;

Result<Region> sensor_of(const FakeCameraOptions& options, const FrameProvider& provider) {
  const Geometry whole = provider.format.geometry;
  const Region region = options.crop.value_or(Region{0, 0, whole.width, whole.height});
  if (region.inside(whole)) return region;
  return bad_input(fmt::format("the crop {},{},{},{} lies outside the capture's frames of {}x{}", region.x, region.y,
                               region.width, region.height, whole.width, whole.height));
}

// Clients distinguish cameras by serial number, so a generated one contains the address.
std::string serial_of(const FakeCameraOptions& options, const FrameProvider& provider, std::uint32_t address) {
  if (!options.serial.empty()) return options.serial;
  if (!provider.serial.empty()) return provider.serial.substr(0, kMaxNameLength);
  return fmt::format("BOLO{:08x}", address);
}

}  // namespace

// Once the control thread runs, it alone uses everything below; the stream has its own threads.
struct FakeCamera::Impl {
  Impl(const FakeCameraOptions& options_in, FrameProvider provider_in, Region sensor_in, ControlServer server_in,
       UniqueFd stream_socket_in, UniqueFd stop_event_in, const LocalAddress& local)
      : options(options_in),
        provider(std::move(provider_in)),
        sensor(sensor_in),
        serial(serial_of(options, provider, local.address)),
        features(registers, counters, provider.format, {sensor.width, sensor.height}, rate_hz(),
                 {[this] { return start_stream(); }, [this] { stop_stream(); }, [this] { return streaming(); },
                  [this] { control_faults.windowing_changed(monotonic_ns()); }}),
        handler(registers, counters,
                {[this](const ResendRequest& r) {
                   if (!session || !control_faults.answers_resend(session->due_ns(r.block_id, monotonic_ns()))) return;
                   session->resend(r.block_id, r.first_packet, r.last_packet);
                 },
                 [this] { stop_stream(); }}),
        server(std::move(server_in)),
        stream_socket(std::move(stream_socket_in)),
        stop_event(std::move(stop_event_in)) {
    fill_bootstrap(registers, {serial, local.address, local.netmask});
    registers.set(reg::kStreamSourcePort, bound_port(stream_socket.get()));
    registers.writable(reg::kStreamPacketSize, [this](std::uint32_t value) { return write_packet_size(value); });
    registers.writable(reg::kTimestampControl, [this](std::uint32_t value) { return write_timestamp_control(value); });
    registers.remember();
  }

  gvcp::Status start_stream() {
    if (streaming()) return gvcp::Status::kSuccess;
    StreamPlan plan;
    plan.route = route();
    if (plan.route.destination.sin_port == 0 || plan.route.destination.sin_addr.s_addr == 0) {
      return gvcp::Status::kWrongConfig;  // the stream channel is closed
    }
    plan.shown = features.region();
    plan.region = {sensor.x + plan.shown.x, sensor.y + plan.shown.y, plan.shown.width, plan.shown.height};
    plan.ir_format = features.ir_format();
    plan.rate_hz = features.rate_hz();
    plan.frames = features.single_frame() ? 1 : options.laps * provider.frame_ids.size();
    plan.keep_frames = options.keep_frames;
    stop_stream();
    const std::int64_t now_ns = monotonic_ns();
    frame_faults.begin_stream();
    control_faults.begin(now_ns);
    plan.fault_clock_ns = control_faults.clock_ns(now_ns);
    counters.change([now_ns](FakeCameraStats& stats) {
      if (stats.first_stream_ns == 0) stats.first_stream_ns = static_cast<std::uint64_t>(now_ns);
    });
    try {
      session =
          std::make_unique<StreamSession>(plan, provider, counters, StreamFaults{frame_faults, tallies, period_ns});
    } catch (const std::exception&) {  // out of memory or threads
      return gvcp::Status::kBusy;
    }
    return gvcp::Status::kSuccess;
  }

  void stop_stream() {
    if (!session) return;
    session->stop();
    if (!session->result()) result = session->result();
  }

  bool streaming() const { return session && session->running(); }
  double rate_hz() const { return options.rate_hz > 0.0 ? options.rate_hz : 1.0 / provider.format.frame_period_s; }

  // Packet size, do-not-fragment flag, and trigger of a test packet with which the client probes the link.
  WriteOutcome write_packet_size(std::uint32_t value) {
    const std::uint32_t size = value & reg::kPacketSizeMask;
    if (size < gvsp::kMinPacketSize || size > gvsp::kMaxPacketSize) return refuse(gvcp::Status::kInvalidParameter);
    set_do_not_fragment(stream_socket.get(), (value & reg::kDoNotFragment) != 0);
    if ((value & reg::kFireTestPacket) != 0) fire_test_packet(size);
    return value & (reg::kPacketSizeMask | reg::kDoNotFragment);
  }

  WriteOutcome write_timestamp_control(std::uint32_t value) {
    const std::int64_t now_ns = monotonic_ns();
    if ((value & reg::kTimestampReset) != 0) {
      clock_origin_ns = now_ns;
      counters.add(&FakeCameraStats::clock_resets);
    }
    if ((value & reg::kTimestampLatch) != 0) {
      const std::uint64_t camera_ns =
          streaming() ? session->camera_time_ns(now_ns) : static_cast<std::uint64_t>(now_ns - clock_origin_ns);
      registers.set(reg::kTimestampHigh, static_cast<std::uint32_t>(camera_ns >> 32U));
      registers.set(reg::kTimestampLow, static_cast<std::uint32_t>(camera_ns & 0xffffffffU));
    }
    return 0U;
  }

  void fire_test_packet(std::uint32_t packet_size) {
    const sockaddr_in to = route().destination;
    if (to.sin_port == 0) return;
    std::vector<std::uint8_t> packet(packet_size - gvsp::kUdpOverhead, 0);
    gvsp::write_header(packet, gvcp::Status::kSuccess, 0, gvsp::Content::kPayload, 0);
    // The kernel refuses a packet too large for the link; the client then receives nothing, which is the result.
    sendto(stream_socket.get(), packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof(to));
  }

  PacketRoute route() const {
    PacketRoute route;
    route.socket = stream_socket.get();
    route.destination =
        socket_address(registers.get(reg::kStreamAddress), static_cast<std::uint16_t>(registers.get(reg::kStreamPort)));
    route.packet_size = registers.get(reg::kStreamPacketSize) & reg::kPacketSizeMask;
    route.packet_delay_ns = registers.get(reg::kStreamPacketDelay);
    return route;
  }

  void reboot() {
    handler.drop_client();
    stop_stream();
    session.reset();
    registers.power_on();
    features.power_on();
  }

  void serve() {
    pthread_setname_np(pthread_self(), "fakecam-control");
    server.run(handler, control_faults, stop_event.get());
    stop_stream();
  }

  const FakeCameraOptions options;
  const FrameProvider provider;
  const Region sensor;  // in capture coordinates
  const std::string serial;
  Counters counters;
  RegisterMap registers{description()};
  const std::int64_t period_ns = std::llround(kNsPerSecond / rate_hz());
  FaultTallies tallies{options.faults};
  FrameFaults frame_faults{options.faults, period_ns};
  CameraFeatures features;
  CommandHandler handler;
  ControlFaults control_faults{tallies, period_ns, {[this] { handler.drop_client(); }, [this] { reboot(); }}};
  ControlServer server;
  UniqueFd stream_socket;
  UniqueFd stop_event;
  std::unique_ptr<StreamSession> session;  // kept after its end for resends
  std::int64_t clock_origin_ns = monotonic_ns();
  Status result;
  std::thread thread;
};

Result<std::unique_ptr<FakeCamera>> FakeCamera::start(const FakeCameraOptions& options, FrameProvider provider) {
  if (options.serial.size() > kMaxNameLength) {
    return bad_input("the camera's name '" + options.serial + "' is too long; GigE Vision has room for 15 characters");
  }
  if (provider.frame_ids.empty()) return bad_input("the capture has no frames; a camera needs at least one");
  if (options.rate_hz < 0.0 || !std::isfinite(options.rate_hz)) {
    return bad_input("the rate must be a positive number of frames a second, or 0 for the capture's own");
  }
  if (options.faults.size() > kMaxFaults) {
    return bad_input(fmt::format("{} faults; a camera takes at most {}", options.faults.size(), kMaxFaults));
  }
  ASSIGN_OR_RETURN(const auto sensor, sensor_of(options, provider));
  ASSIGN_OR_RETURN(const auto local, find_local_address(options.address));
  ASSIGN_OR_RETURN(auto server, ControlServer::bind(local, gvcp::kPort));
  ASSIGN_OR_RETURN(auto stream_socket, open_stream_socket(local.address));
  UniqueFd stop_event(eventfd(0, EFD_CLOEXEC));
  if (!stop_event) return failed("can't make an event descriptor: too many open files");
  auto impl = std::make_unique<Impl>(options, std::move(provider), sensor, std::move(server), std::move(stream_socket),
                                     std::move(stop_event), local);
  impl->thread = std::thread([camera = impl.get()] { camera->serve(); });
  return std::unique_ptr<FakeCamera>(new FakeCamera(std::move(impl)));
}

FakeCamera::FakeCamera(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

FakeCamera::~FakeCamera() { stop(); }

void FakeCamera::stop() noexcept {
  if (!impl_->thread.joinable()) return;
  eventfd_write(impl_->stop_event.get(), 1);
  impl_->thread.join();
  impl_->server.close();
}

FakeCameraStats FakeCamera::stats() const noexcept { return impl_->counters.read(); }

Geometry FakeCamera::sensor() const { return {impl_->sensor.width, impl_->sensor.height}; }

double FakeCamera::rate_hz() const { return impl_->rate_hz(); }

std::vector<InjectedFault> FakeCamera::injected() const { return impl_->tallies.read(); }

std::string FakeCamera::serial() const { return impl_->serial; }

bool FakeCamera::hears_broadcasts() const { return impl_->server.hears_broadcasts(); }

Status FakeCamera::result() const { return impl_->result; }

}  // namespace bolo::fakecam
