#include "tools/bolod/daemon.hpp"

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <exception>
#include <future>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include <fmt/format.h>
#include <malloc.h>
#include <pthread.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include "drivers/shm/camera_block.hpp"
#include "drivers/shm/shm_gyro.hpp"
#include "drivers/shm/shm_sink.hpp"
#include "drivers/v4l2/v4l2_sink.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/deblur/isa.hpp"
#include "src/pipeline/host_clock.hpp"
#include "src/rt/thread.hpp"
#include "tools/bolod/control.hpp"
#include "tools/bolod/log.hpp"
#include "tools/bolod/metrics.hpp"
#include "tools/bolod/ros2.hpp"
#include "tools/bolod/service_manager.hpp"
#include "tools/bolod/setup_guard.hpp"
#include "tools/bolod/supervisor.hpp"

namespace bolo::daemon {
namespace {

Result<ComposedSource> make_replay(const ReplayOptions& options) {
  ASSIGN_OR_RETURN(capture::CaptureReader reader, capture::CaptureReader::open(options.file));
  ComposedSource composed;
  composed.warnings = reader.warnings();
  auto source =
      std::make_unique<replay::ReplaySource>(std::make_shared<const capture::CaptureReader>(std::move(reader)),
                                             options.pace, options.laps, replay::Values::kCounts);
  composed.replay = source.get();
  composed.source = std::move(source);
  return composed;
}

namespace event = pipeline::event;

constexpr std::int64_t kRetryNs = 2'000'000'000;  // for removed or occupied resources
constexpr std::chrono::seconds kReadPatience{2};  // for reading the configuration from disk
constexpr timespec kPollPeriod{0, 100'000'000};   // maximum delay until a signal or the source's end is noticed

sigset_t our_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&signals, signal);
  return signals;
}

std::string_view name_of(int signal) {
  if (signal == SIGHUP) return "SIGHUP";
  return signal == SIGTERM ? "SIGTERM" : "SIGINT";
}

// Locked memory is never given back.
void keep_memory_small() {
  // Returns large freed blocks (a connection's buffers) to the system; glibc keeps them from the second connection on.
  constexpr int kLargeBytes = 128 << 10;
  mallopt(M_MMAP_THRESHOLD, kLargeBytes);
  // One arena instead of a permanent one per thread of each connection: nothing allocates while frames flow.
  mallopt(M_ARENA_MAX, 1);
}

// Locks the program before there are threads, whose stacks would be locked whole. lock_memory() reports a refusal.
void lock_program() { mlockall(MCL_CURRENT); }

rlim_t memory_limit() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  return limit.rlim_cur;
}

}  // namespace

Result<DaemonConfig> read_config_to_run(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(DaemonConfig config, read_config(file));
  RETURN_IF_ERROR(at(file.string(), rt::check_cpus(config.pipeline.thread.cpus, rt::configured_cpus())));
  return config;
}

Result<ComposedSource> make_source(const DaemonConfig& config) {
  if (config.source == SourceType::kReplay) return make_replay(config.replay);
  ComposedSource composed;
  if (config.source == SourceType::kV4l2) {
    composed.source = std::make_unique<v4l2_source::V4l2Source>(config.video);
    return composed;
  }
  auto source = std::make_unique<genicam::GenicamSource>(config.camera);
  composed.camera = source.get();
  composed.source = std::move(source);
  return composed;
}

bool waits_for_frames(const DaemonConfig& config) {
  return config.source == SourceType::kReplay && config.replay.pace == replay::Pace::kAsFastAsPossible;
}

std::vector<std::shared_ptr<pipeline::SinkSection>> sink_sections() {
  using v4l2::V4l2Section;
  return {
      std::make_shared<shm::ShmSection>(),
      std::make_shared<V4l2Section>("v4l2",
                                    "frames as a camera of the system, for programs that know only such: v4l2loopback"),
      std::make_shared<V4l2Section>("v4l2_second", "another such device, as raw frames beside sharp ones",
                                    v4l2::V4l2Options{.device = "/dev/video11", .plane = v4l2::Plane::kRaw}),
  };
}

Result<std::unique_ptr<Gyro>> make_gyro(const DaemonConfig& config) {
  if (config.gyro.empty()) return nullptr;
  return shm::ShmGyro::create(config.gyro.substr(kShmGyro.size()));
}

std::vector<std::unique_ptr<pipeline::FrameSink>> make_sinks(const DaemonConfig& config) {
  std::vector<std::unique_ptr<pipeline::FrameSink>> sinks;
  for (const auto& section : config.sinks) sinks.push_back(section->make(config.sink_context()));
  return sinks;
}

namespace {

std::string describe_sinks(const DaemonConfig& config) {
  std::string words;
  for (const auto& section : config.sinks) {
    const std::string sink = section->describe(config.sink_context());
    if (!sink.empty()) words += (words.empty() ? "" : ", ") + sink;
  }
  return words.empty() ? "nowhere: shm.enable is false" : words;
}

}  // namespace

std::string describe(const DaemonConfig& config, const pipeline::Pipeline& pipeline) {
  const pipeline::SourceInfo& source = pipeline.source();
  const std::string from = config.source == SourceType::kReplay ? config.replay.file.filename().string() : "camera";
  const std::string serial = source.camera_serial.empty() ? "" : " " + source.camera_serial;
  const StreamFormat& format = source.format;
  const deblur::Settings& settings = pipeline.settings();
  return fmt::format("{} {}{}, {}x{} at {:.4g} Hz -> {}, window {}, look-ahead {}, tau {:.4g} ms, {} worker{} -> {}",
                     from, source.camera_model, serial, format.geometry.width, format.geometry.height,
                     1.0 / format.frame_period_s, pipeline.solver_text(), settings.window, settings.lookahead,
                     settings.tau_s * 1e3, config.pipeline.workers, config.pipeline.workers == 1 ? "" : "s",
                     describe_sinks(config));
}

void block_signals() {
  const sigset_t signals = our_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
}

void ignore_signals() {
  for (const int signal : {SIGPIPE, SIGXFSZ, SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO, SIGPWR, SIGSTKFLT}) {
    ::signal(signal, SIG_IGN);
  }
  for (int signal = SIGRTMIN; signal <= SIGRTMAX; ++signal) ::signal(signal, SIG_IGN);
}

struct Daemon::Impl {
  DaemonConfig config;
  std::shared_ptr<spdlog::logger> log;
  std::vector<std::unique_ptr<pipeline::FrameSink>> sinks;  // from make_sinks(); outlive the pipeline
  std::unique_ptr<Gyro> gyro;                               // outlives the pipeline; null: none
  genicam::GenicamSource* camera = nullptr;                 // owned by the pipeline
  replay::ReplaySource* replay = nullptr;                   // owned by the pipeline
  std::unique_ptr<pipeline::Pipeline> pipeline;

  std::atomic<bool> stop_requested{false};
  std::atomic<bool> ended{false};
  pipeline::PeriodChange period_change;
  Status result;  // of the pipeline; written before `ended`, read after the thread is joined

  std::optional<Supervisor> supervisor;    // set by create()
  std::unique_ptr<ControlServer> control;  // this and the next are destroyed first: they query all others
  std::unique_ptr<RequestServer> metrics;
  std::int64_t next_metrics_try_ns = 0;
  std::int64_t next_control_check_ns = 0;
  bool control_missed = false;                // already logged
  std::future<Result<DaemonConfig>> reading;  // reload of the file

  Status compose() {
    ASSIGN_OR_RETURN(ComposedSource source, make_source(config));
    for (const std::string& warning : source.warnings) log->warn(warning);
    camera = source.camera;
    replay = source.replay;
    sinks = make_sinks(config);
    ASSIGN_OR_RETURN(gyro, make_gyro(config));
    std::vector<pipeline::FrameSink*> lent;
    for (const auto& sink : sinks) {
      if (sink != nullptr) lent.push_back(sink.get());
    }
    if (Status status = deblur::choose_isa(config.isa); !status) return status;
    pipeline::PipelineOptions options = config.pipeline;
    options.deblur.gyro = gyro.get();
    options.must_keep_up = !waits_for_frames(config);
    options.degrade = options.degrade && options.must_keep_up;
    options.warn = [log = log](const std::string& what) { log->warn(what); };
    ASSIGN_OR_RETURN(pipeline, pipeline::Pipeline::create(std::move(source.source), lent, options));
    if (camera != nullptr) {
      for (const std::string& warning : camera->warnings()) log->warn(warning);
    }
    const std::string& serial = pipeline->source().camera_serial;
    if (!config.profile.serial.empty() && !serial.empty() && serial != config.profile.serial) {
      log->warn("the profile is of camera {}, but this is camera {}", config.profile.serial, serial);
    }
    return {};
  }

  Result<std::unique_ptr<ControlServer>> make_control() {
    return ControlServer::start(config.control.socket, config.control.mode,
                                [this](std::string_view request) { return answer(request); });
  }

  // A failure at the default path is only a warning: frames matter more than commands.
  Status listen() {
    if (config.control.socket.empty()) return {};
    auto made = make_control();
    if (made) {
      control = std::move(*made);
      return {};
    }
    if (config.control.socket != default_control_socket(config.name)) return tl::unexpected<Error>(made.error());
    log->warn(made.error().message);  // default path: not requested
    return {};
  }

  // Recreates the socket after a cleanup of temporary files has removed it.
  void keep_listening() {
    if (control == nullptr || monotonic_ns() < next_control_check_ns) return;
    next_control_check_ns = monotonic_ns() + kRetryNs;
    if (control->is_there()) return;
    auto made = make_control();
    if (made) {
      control = std::move(*made);
      control_missed = false;
      log->warn("control socket {} was taken away; it is there again", config.control.socket);
    } else if (!std::exchange(control_missed, true)) {
      log->warn("{}; it is tried again all the time", made.error().message);
    }
  }

  // Retries an occupied port: frames matter more than metrics.
  void serve_metrics() {
    if (!config.metrics.enabled || metrics != nullptr || monotonic_ns() < next_metrics_try_ns) return;
    const bool first = std::exchange(next_metrics_try_ns, monotonic_ns() + kRetryNs) == 0;
    auto made = metrics_server(config.metrics, [this] {
      return collect_metrics({config.name, *pipeline, supervisor->flows()});
    });
    if (made) {
      metrics = std::move(*made);
      if (!first) log->info("metrics are served at {}", config.metrics.listen);
    } else if (first) {
      log->warn("{}; it is tried again all the time", made.error().message);
    }
  }

  // Runs on the control server's thread.
  std::string answer(std::string_view request) const {
    // May contain text of the camera that is not UTF-8.
    const auto refused = [](const std::string& why) {
      shm::JsonMembers json;
      json.add("ok", false);
      json.add("error", printable(why));
      return json.text();
    };
    if (request == "state") return state_json(config, *pipeline);
    if (request != "nuc") return refused("unknown request; there are: nuc, state");
    if (const Status done = pipeline->trigger_nuc(); !done) return refused(done.error().message);
    const pipeline::SourceStatus* status = pipeline->stats().source;
    shm::JsonMembers json;
    json.add("ok", true);
    json.add("nucs", status != nullptr ? status->corrections.value() : 0);
    return json.text();
  }

  void watch(OnHangup on_hangup) {
    Ros2Process ros2(config.ros2, config.name);
    bool stopping = false;
    // Steps that lack memory are taken again the next time: frames go on without it.
    while (!stopping && !ended.load(std::memory_order_acquire)) {  // partner: the pipeline thread's store in run()
      attempt([&] { take_signal(on_hangup, stopping); });
      attempt([&] { supervisor->poll(); });
      attempt([&] { ros2.poll([this](const std::string& what) { log->warn(what); }); });
      attempt([&] { follow_period(); });
      attempt([&] { serve_metrics(); });
      attempt([&] { keep_listening(); });
    }
    service::notify_stopping();
  }

  // Adopts the frame period measured by the camera's clock once it clearly differs from the configured one.
  void follow_period() {
    const pipeline::SourceStatus* source = pipeline->stats().source;
    const double fresh_s = pipeline->stats().fresh_period_s.value();
    const double measured_s = fresh_s > 0.0 ? fresh_s : source != nullptr ? source->measured_period_s.value() : 0.0;
    const double before_s = period_change.update(measured_s, pipeline->settings().period_s, monotonic_ns());
    if (before_s == 0.0) return;
    const Status taken = pipeline->set_period(measured_s);
    const bool repeats = fresh_s > 0.0 && pipeline->stats().repeats.value() > 0;
    const std::string_view advice = camera == nullptr || repeats ? "" : "; set source.true_rate_hz, or find out why";
    log->warn("by the camera's clock {:.5g} {}frames come a second, not {:.5g}, and they are solved {}{}",
              1.0 / measured_s, repeats ? "new " : "", 1.0 / before_s,
              taken ? "so from now on" : "as before: " + taken.error().message, taken ? advice : "");
  }

  // `stopping` becomes true when the daemon should end, whatever is thrown afterwards.
  void take_signal(OnHangup on_hangup, bool& stopping) {
    const sigset_t signals = our_signals();
    const int signal = sigtimedwait(&signals, nullptr, &kPollPeriod);
    if (signal < 0) return;
    if (signal == SIGHUP && on_hangup == OnHangup::kReload) return reload();
    if (signal == SIGHUP && ignored(SIGHUP)) return;
    stopping = true;
    log->info("{}: stopping", name_of(signal));
  }

  // An invalid file changes nothing.
  void reload() {
    service::notify_reloading();
    const Result<DaemonConfig> read = tried([this] { return read_again(); });
    if (read) {
      apply(*read);
    } else {
      const std::string text = "reload: " + read.error().message + "; all stays as it was";
      log_notice(*log, spdlog::level::err, {true, text, event::kReload});
    }
    service::notify_ready(read ? "read its file again" : "could not read its file again");
  }

  // Reads on a separate thread, which a hanging disk may block; a file that arrives too late is ignored.
  Result<DaemonConfig> read_again() {
    if (config.file.empty()) return bad_input("there is no file that could have changed");
    const auto comes_within = [this](std::chrono::seconds wait) {
      return reading.wait_for(wait) == std::future_status::ready;
    };
    if (!reading.valid() || comes_within(std::chrono::seconds(0))) {
      std::packaged_task<Result<DaemonConfig>()> task(
          [file = config.file] { return tried([&] { return read_config_to_run(file); }); });
      reading = task.get_future();
      std::thread(std::move(task)).detach();
    }
    if (!comes_within(kReadPatience)) {
      return bad_input(fmt::format("{}: cannot be read within {} s", config.file.string(), kReadPatience.count()));
    }
    return reading.get();
  }

  void apply(const DaemonConfig& read) {
    const ConfigChange change = compare(config, read);
    log->set_level(read.log.level);
    if (camera != nullptr) camera->set_nuc(read.camera.nuc);
    for (std::size_t i = 0; i < read.sinks.size(); ++i) {
      if (sinks[i] != nullptr) sinks[i]->reload(*read.sinks[i]);
    }
    for (const std::string& key : change.live) config.texts[key] = read.texts.at(key);
    if (!change.restart.empty()) {
      const std::string text = fmt::format("reload: needs a restart: {}", fmt::join(change.restart, ", "));
      log_notice(*log, spdlog::level::warn, {true, text, event::kReload});
    }
    const std::string taken =
        change.live.empty() ? "nothing to take up" : fmt::format("took up {}", fmt::join(change.live, ", "));
    log_notice(*log, spdlog::level::info, {false, "reload: " + taken, event::kReload});
  }

  // Locks the memory in use and, without a limit, pages touched later: with a limit, allocations could fail.
  void lock_memory() const {
    if (!config.lock_memory) return;
    const bool unlimited = memory_limit() == RLIM_INFINITY || geteuid() == 0;
    if (mlockall(MCL_CURRENT | MCL_ONFAULT | (unlimited ? MCL_FUTURE : 0)) == 0) return;
    log->warn(
        "memory is not locked ({}): raise LimitMEMLOCK (ulimit -l, now {} KiB), or set pipeline.lock_memory = false",
        std::strerror(errno), memory_limit() >> 10);
  }
};

Daemon::Daemon(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Daemon::~Daemon() = default;

Result<std::unique_ptr<Daemon>> Daemon::create(const DaemonConfig& config, std::shared_ptr<spdlog::logger> log) {
  if (config.lock_memory) {
    keep_memory_small();
    lock_program();
  }
  const std::jthread guard = guard_setup();
  auto impl = std::make_unique<Impl>();
  impl->config = config;
  impl->log = std::move(log);
  RETURN_IF_ERROR(impl->compose());
  impl->supervisor.emplace(Supervisor::Subject{*impl->log, *impl->pipeline, config.camera.stall_ms});
  RETURN_IF_ERROR(impl->listen());
  impl->serve_metrics();
  return std::unique_ptr<Daemon>(new Daemon(std::move(impl)));
}

Status Daemon::run(OnHangup on_hangup) {
  Impl& self = *impl_;
  log_notice(*self.log, spdlog::level::info,
             {false, self.config.name + ": " + describe(self.config, *self.pipeline), event::kStart});
  self.lock_memory();
  std::thread runner([&self] {
    try {
      self.result = self.pipeline->run(self.stop_requested);
    } catch (const std::exception& e) {  // out of memory or threads
      self.result = failed("cannot go on: " + describe_exception(e));
    }
    self.ended.store(true, std::memory_order_release);  // partner: the load in watch()
  });
  const Status watched = tried([&] {
    self.watch(on_hangup);
    return Status{};
  });
  self.stop_requested.store(true, std::memory_order_relaxed);
  runner.join();
  RETURN_IF_ERROR(at("cannot go on", watched));
  attempt([&] { self.supervisor->log_end(); });
  if (!self.result) return self.result;
  return self.replay != nullptr ? self.replay->result() : Status{};
}

}  // namespace bolo::daemon
