#include "bolo/daemon/daemon.hpp"

#include <pthread.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <string_view>
#include <thread>

#include <nlohmann/json.hpp>

#include "bolo/core/clock.hpp"
#include "bolo/daemon/health.hpp"
#include "bolo/deblur/isa.hpp"
#include "drivers/shm/camera_block.hpp"
#include "src/daemon/compose.hpp"
#include "src/daemon/control.hpp"

namespace bolo::daemon {
namespace {

constexpr timespec kLookPeriod{0, 100'000'000};  // how late a signal's or the source's end may be noticed

sigset_t our_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&signals, signal);
  return signals;
}

rlim_t memory_limit() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  return limit.rlim_cur;
}

}  // namespace

void block_signals() {
  const sigset_t signals = our_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
}

struct Daemon::Impl {
  DaemonConfig config;
  std::shared_ptr<spdlog::logger> log;
  std::vector<std::unique_ptr<pipeline::FrameSink>> sinks;  // outlive the pipeline
  genicam::GenicamSource* camera = nullptr;                 // owned by the pipeline
  replay::ReplaySource* replay = nullptr;                   // owned by the pipeline
  usb::UsbBulkSource* usb = nullptr;                        // owned by the pipeline
  std::unique_ptr<pipeline::Pipeline> pipeline;

  std::atomic<bool> stop_requested{false};
  std::atomic<bool> ended{false};
  Status result;  // of the pipeline; written before `ended`, read after the thread is joined

  std::unique_ptr<ControlServer> control;  // goes first: it asks the camera

  Status compose();
  Status listen();
  std::string answer(std::string_view request) const;
  std::string answer_state() const;
  void watch();
  bool take_signal();
  void look(Health& health);
  void tell(bool warning, const std::string& text) const;
  void tell_camera_notices() const;
  void lock_memory() const;
  void tell_end() const;
};

Status Daemon::Impl::compose() {
  Result<ComposedSource> source = make_source(config);
  if (!source) return tl::unexpected<Error>(source.error());
  for (const std::string& warning : source->warnings) log->warn(warning);
  camera = source->camera;
  replay = source->replay;
  usb = source->usb;
  sinks = make_sinks(config);
  std::vector<pipeline::FrameSink*> lent;
  for (const auto& sink : sinks) lent.push_back(sink.get());
  if (Status status = deblur::choose_isa(config.isa); !status) return status;
  pipeline::PipelineOptions options = config.pipeline;
  options.warn = [log = log](const std::string& what) { log->warn(what); };
  auto made = pipeline::Pipeline::create(std::move(source->source), lent, options);
  if (!made) return tl::unexpected<Error>(made.error());
  pipeline = std::move(*made);
  if (camera != nullptr) {
    for (const std::string& warning : camera->warnings()) log->warn(warning);
  }
  const std::string& serial = pipeline->source().camera_serial;
  if (!config.profile.serial.empty() && !serial.empty() && serial != config.profile.serial) {
    log->warn("the profile is of camera {}, but this is camera {}", config.profile.serial, serial);
  }
  return {};
}

// A place that was not asked for may fail: frames matter more than commands.
Status Daemon::Impl::listen() {
  if (config.control.socket.empty()) return {};
  auto made = ControlServer::start(config.control.socket, config.control.mode,
                                   [this](std::string_view request) { return answer(request); });
  if (made) {
    control = std::move(*made);
    return {};
  }
  if (config.control.socket != default_control_socket(config.name)) return tl::unexpected<Error>(made.error());
  log->warn(made.error().message);  // nobody asked for this place
  return {};
}

// On the control server's thread.
std::string Daemon::Impl::answer(std::string_view request) const {
  const auto refused = [](const std::string& why) { return nlohmann::json{{"ok", false}, {"error", why}}.dump(); };
  if (request == "state") return answer_state();
  if (request != "nuc") return refused("unknown request; there are: nuc, state");
  if (camera == nullptr)
    return refused(usb != nullptr ? "a USB camera cannot be told to correct its pixels"
                                  : "a capture is replayed: there is no camera to correct");
  if (const Status done = camera->correct(); !done) return refused(done.error().message);
  return nlohmann::json{{"ok", true}, {"nucs", camera->status()->corrections.value()}}.dump();
}

std::string Daemon::Impl::answer_state() const {
  const pipeline::PipelineStats& stats = pipeline->stats();
  nlohmann::ordered_json json{{"ok", true},
                              {"name", config.name},
                              {"received", stats.inlet.received()},
                              {"published", stats.published.value()},
                              {"lost_total", stats.inlet.losses().total()},
                              {"camera", nullptr}};
  if (stats.source != nullptr) json["camera"] = shm::camera_json(shm::camera_block(*stats.source), monotonic_ns());
  return json.dump();
}

// True when it asks for the end.
bool Daemon::Impl::take_signal() {
  const sigset_t signals = our_signals();
  const int signal = sigtimedwait(&signals, nullptr, &kLookPeriod);
  if (signal == SIGHUP) log->info("SIGHUP: the configuration is read at start only; restart to apply a new one");
  if (signal != SIGTERM && signal != SIGINT) return false;
  log->info("{}: stopping", signal == SIGTERM ? "SIGTERM" : "SIGINT");
  return true;
}

void Daemon::Impl::tell(bool warning, const std::string& text) const {
  log->log(warning ? spdlog::level::warn : spdlog::level::info, text);
}

void Daemon::Impl::tell_camera_notices() const {
  if (usb != nullptr) {
    for (const usb::Notice& notice : usb->take_notices()) tell(notice.warning, notice.text);
  }
  if (camera == nullptr) return;
  for (const genicam::Notice& notice : camera->take_notices()) tell(notice.warning, notice.text);
}

// Before frames flow, for locking stalls whoever touches new memory meanwhile. What threads and drivers take later is
// locked too, unless a limit could then make their allocations fail.
void Daemon::Impl::lock_memory() const {
  if (!config.lock_memory) return;
  const bool unlimited = memory_limit() == RLIM_INFINITY || geteuid() == 0;
  if (mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0) return;
  log->warn(
      "memory is not locked ({}): raise LimitMEMLOCK (ulimit -l, now {} KiB), or set pipeline.lock_memory = false",
      std::strerror(errno), memory_limit() >> 10);
}

void Daemon::Impl::look(Health& health) {
  const pipeline::PipelineStats& stats = pipeline->stats();
  const Snapshot now{monotonic_ns(), stats.inlet.received(), loss_counts(stats), stats.source != nullptr};
  for (const Notice& notice : health.look(now)) tell(notice.warning, notice.text);
  tell_camera_notices();
}

void Daemon::Impl::watch() {
  Health health(pipeline->source().format.frame_period_s, monotonic_ns());
  while (!ended.load(std::memory_order_acquire)) {  // partner: the pipeline thread's store in run()
    if (take_signal()) break;
    look(health);
  }
}

void Daemon::Impl::tell_end() const {
  const pipeline::PipelineStats& stats = pipeline->stats();
  const auto counts = stats.latency.counts();
  const auto percentile = [&counts](double fraction) { return rt::LatencyHistogram::percentile_ms(counts, fraction); };
  log->info("ended: {} frames in, {} out, lost: {}; latency p50 {:.2f} ms, p99 {:.2f} ms, max {:.2f} ms",
            stats.inlet.received(), stats.published.value(), loss_words(loss_counts(stats)), percentile(0.5),
            percentile(0.99), percentile(1.0));
}

Daemon::Daemon(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Daemon::~Daemon() = default;

Result<std::unique_ptr<Daemon>> Daemon::create(const DaemonConfig& config, std::shared_ptr<spdlog::logger> log) {
  auto impl = std::make_unique<Impl>();
  impl->config = config;
  impl->log = std::move(log);
  if (const Status status = impl->compose(); !status) return tl::unexpected<Error>(status.error());
  if (const Status status = impl->listen(); !status) return tl::unexpected<Error>(status.error());
  return std::unique_ptr<Daemon>(new Daemon(std::move(impl)));
}

Status Daemon::run() {
  Impl& self = *impl_;
  self.log->info("{}: {}", self.config.name, describe(self.config, *self.pipeline));
  self.lock_memory();
  std::thread runner([&self] {
    self.result = self.pipeline->run(self.stop_requested);
    self.ended.store(true, std::memory_order_release);  // partner: the load in watch()
  });
  self.watch();
  self.stop_requested.store(true, std::memory_order_relaxed);
  runner.join();
  self.tell_camera_notices();
  self.tell_end();
  if (!self.result) return self.result;
  return self.replay != nullptr ? self.replay->result() : Status{};
}

}  // namespace bolo::daemon
