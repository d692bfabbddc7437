#include "src/pipeline/pipeline.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <utility>

#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "src/deblur/isa.hpp"
#include "src/pipeline/pipeline_impl.hpp"

namespace bolo::pipeline {
namespace {

// The pipeline waits this long for a frame before it checks for a stop. Sinks are notified of a silence this long at
// the next check: after at most twice the time.
constexpr std::int64_t kPollNs = 100'000'000;

constexpr double kGyroFrames = 400;  // interval of checks of the gyro's use

constexpr int kMaxQueueFrames = 4096;

std::string size_text(Geometry g) { return std::to_string(g.width) + "x" + std::to_string(g.height); }

Status check_pixels(const PipelineOptions& options, Geometry geometry) {
  if (options.region && !options.points.empty()) return bad_input("give a region or points, not both");
  if (options.region && !options.region->inside(geometry)) {
    const Region& r = *options.region;
    return bad_input("region " + std::to_string(r.x) + "," + std::to_string(r.y) + "," + std::to_string(r.width) + "," +
                     std::to_string(r.height) + " (x,y,width,height) is not inside the frame of " +
                     size_text(geometry));
  }
  const auto outside = [&](std::uint32_t pixel) { return pixel >= geometry.pixels(); };
  if (std::any_of(options.points.begin(), options.points.end(), outside)) {
    return bad_input("a point is not inside the frame of " + size_text(geometry));
  }
  return {};
}

Status check(const PipelineOptions& options, const StreamFormat& format) {
  if (options.workers < 1 || options.workers > kMaxWorkers) {
    return bad_input("workers = " + std::to_string(options.workers) + ": give 1 to " + std::to_string(kMaxWorkers));
  }
  if (options.queue_frames < 1 || options.queue_frames > kMaxQueueFrames) {
    return bad_input("queue_frames = " + std::to_string(options.queue_frames) + ": give 1 to " +
                     std::to_string(kMaxQueueFrames));
  }
  if (format.geometry.width < 1 || format.geometry.height < 1) {
    return bad_input("the source has no picture: " + size_text(format.geometry));
  }
  return check_pixels(options, format.geometry);
}

}  // namespace

Result<Pipeline::Timed> Pipeline::Timed::create(const PipelineOptions& options, const StreamFormat& format) {
  deblur::Settings settings = options.deblur;
  settings.period_s = format.frame_period_s;
  RETURN_IF_ERROR(deblur::validate(settings));
  const auto planes = static_cast<std::size_t>(deblur::Window(settings).slots());
  ASSIGN_OR_RETURN(
      auto corrections,
      corrections::Chain::create({options.undo, settings, options.maps, options.pixel_noise_k}, format, planes));
  ASSIGN_OR_RETURN(auto solvers, SolverLadder::create(settings, corrections->format(), options.output,
                                                      options.maps.row_delay_s, options.degrade));
  settings.iterations = solvers.full().iterations();
  return Timed{settings, std::move(corrections), std::move(solvers)};
}

QualityLevel Pipeline::Impl::choose_quality() noexcept {
  if (!options.degrade) return QualityLevel::kFull;
  return std::max(quality_control.next(stats.waiting(), monotonic_ns()), least);
}

void Pipeline::Impl::prepare(const deblur::WindowView& view) noexcept {
  if (quality < QualityLevel::kInverse) {
    solvers.at(quality).prepare(view, team);
  } else {
    solvers.at(quality).prepare(view);
  }
}

// False if there was no time left and raw planes are not allowed instead.
bool Pipeline::Impl::deblur(const deblur::Window::Ready& frame) noexcept {
  const std::int64_t start_ns = monotonic_ns();
  const std::int64_t start_cpu_ns = thread_cpu_ns();
  job = &frame;
  quality = choose_quality();
  raw = raw_of[frame.frame.token];
  given_up.store(frame.full && out_of_time(), std::memory_order_relaxed);
  if (!given_up.load(std::memory_order_relaxed)) {
    if (solves()) prepare(frame.view);
    if (quality < QualityLevel::kInverse) {
      team.run(
          team.size(), [](void* self, int part) { static_cast<Impl*>(self)->work(part); }, this);
    } else {
      work_alone();
    }
  }
  if (frame.full) quality_control.spent(thread_cpu_ns() - start_cpu_ns);
  if (given_up.load(std::memory_order_relaxed)) {
    if (!options.degrade) {
      if (options.must_keep_up) inlet.count_loss(LossCause::kPoolExhausted);
      return false;
    }
    quality = QualityLevel::kRaw;
    work_alone();
  }
  if (frame.full) stats.deblur_ns.add(static_cast<std::uint64_t>(monotonic_ns() - start_ns));
  return true;
}

// Without the other workers, whose threads may be the cause of the delay.
void Pipeline::Impl::work_alone() noexcept {
  for (int part = 0; part < team.size(); ++part) work(part);
}

void Pipeline::Impl::read_clock(std::int64_t now_ns) noexcept {
  if (utc.update(now_ns)) stats.clock_steps.add();
  stats.clock_synchronised.set(utc.state().synchronised ? 1 : 0);
  stats.clock_error_ns.set(utc.state().error_ns);
}

// A frame reaches the host within a period, which bounds the error of host_ns and receive_ns, but for transport jitter.
void Pipeline::Impl::stamp_utc(FrameMeta& meta) noexcept {
  meta.utc_ns = utc.at(host_time_ns(meta));
  const double way_ns = info.format.frame_period_s * kNsPerSecond +
                        (stats.source != nullptr ? stats.source->clock_jitter_ns.value() : 0.0);
  meta.utc_uncertainty_ns = utc.state().error_ns + std::llround(way_ns);
}

void Pipeline::Impl::publish(const deblur::Window::Ready& frame) noexcept {
  PublishedFrame published{.meta = frame.frame.meta, .raw = raw_of[frame.frame.token], .deblurred = deblurred.data()};
  if (!frame.full) published.meta.flags |= kFlagWarmUp;
  if (frame.full) {
    published.meta.flags |= flag_of(quality);
    stats.by_effort[static_cast<std::size_t>(quality)].add();
    stats.effort.set(quality);
    if (solves()) {
      published.noise_k = solvers.at(quality).noise_k();
      input_check.add_noise(solvers.at(quality).measured_noise_k());
      published.motion = solvers.at(quality).motion();
      if (const auto use = solvers.at(quality).gyro_use()) stats.gyro[static_cast<std::size_t>(*use)].add();
    }
  }
  for (const Flag& flag : band_saturated) {
    if (flag.value) published.meta.flags |= kFlagSaturated;
  }
  if ((published.meta.flags & kFlagWarmUp) != 0) stats.warm_up.add();
  if ((published.meta.flags & kFlagGap) != 0) stats.gap_frames.add();
  stats.published.add();
  published.publish_ns = monotonic_ns();
  read_clock(published.publish_ns);
  stamp_utc(published.meta);
  stats.latency.add(published.publish_ns - published.meta.receive_ns);
  stats.stages.deblur.add(published.publish_ns - work_began_ns);
  for (FrameSink* sink : sinks) sink->publish(published, stats);
  last_sign_ns = published.publish_ns;
  work_began_ns = monotonic_ns();
  stats.stages.publish.add(work_began_ns - published.publish_ns);
}

void Pipeline::Impl::publish_ready() noexcept {
  deblur::Window::Ready ready;
  while (window.next(ready)) {
    if (deblur(ready)) publish(ready);
  }
  for (const std::uint32_t slot : window.released()) inlet.give_back(slot);
}

PixelRange Pipeline::Impl::share_of_pixels(int part) const noexcept {
  const std::size_t pixels = info.format.geometry.pixels();
  const auto begin = [&](int p) { return pixels * static_cast<std::size_t>(p) / workers(); };
  return {begin(part), begin(part + 1)};
}

const void* Pipeline::Impl::corrected(const rt::FrameSlot& slot, bool restart_window) noexcept {
  if (!corrections->before()) return slot.data;
  const std::int64_t start_ns = monotonic_ns();
  corrections->begin(slot.meta, slot.data, restart_window, repeats);
  for (pass = 0; pass < corrections->passes(); ++pass) {
    corrections->begin_pass(pass);
    team.run(
        team.size(),
        [](void* self, int part) {
          auto* const impl = static_cast<Impl*>(self);
          impl->corrections->apply(impl->pass, impl->share_of_pixels(part));
        },
        this, true);
  }
  corrections->finish();
  stats.deblur_ns.add(static_cast<std::uint64_t>(monotonic_ns() - start_ns));
  return corrections->plane();
}

// Planes of the old corrections may be shown until their look-ahead has passed: they are returned one frame later.
void Pipeline::Impl::take_period() noexcept {
  if (spending != nullptr) spent.store(std::exchange(spending, nullptr), std::memory_order_release);  // partner:
  Timed* const timed = next_timed.exchange(nullptr, std::memory_order_acquire);                       // set_period()
  if (timed == nullptr) return;
  std::swap(corrections, timed->corrections);
  std::swap(solvers, timed->solvers);
  window.set_period(timed->settings.period_s);
  stats.period_s.set(timed->settings.period_s);
  restart_window_next = true;
  spending = timed;
}

// For a camera that is read faster than it takes pictures: the period of frames that do not repeat the one before.
void Pipeline::Impl::measure_fresh_period(const FrameMeta& meta, bool restart_window) noexcept {
  if (restart_window) fresh_period.restart();
  const double period_s = fresh_period.add(meta.frame_id - stats.repeats.value(), meta.camera_ns);
  if (period_s > 0.0) stats.fresh_period_s.set(period_s);
}

// False if nothing arrived in time.
bool Pipeline::Impl::process_next() noexcept {
  const FrameInlet::Arrival arrival = inlet.next(kPollNs);
  const std::int64_t now_ns = monotonic_ns();
  stats.polled_ns.set(now_ns);
  if (arrival.slot == nullptr) return false;
  rt::FrameSlot& slot = *arrival.slot;
  stats.taken.add();
  stats.stages.arrival.add(arrival.commit_ns - slot.meta.receive_ns);
  stats.stages.queue.add(now_ns - arrival.commit_ns);
  work_began_ns = now_ns;
  take_period();
  if (corrections->drops(slot.data)) {
    inlet.count_loss(LossCause::kMissing);
    stats.repeats.add();
    ++repeats;
    inlet.give_back(slot);
    restart_window_next = restart_window_next || arrival.restart_window;
    return true;
  }
  const bool restart_window = arrival.restart_window || std::exchange(restart_window_next, false);
  if (options.undo.drop_repeated) measure_fresh_period(slot.meta, restart_window);
  if (newest != nullptr) input_check.add_frame(slot.data, newest);
  newest = slot.data;
  raw_of[slot.index] = slot.data;
  const void* plane = corrected(slot, restart_window);
  if (gap) gap->offer(slot.meta, plane, restart_window);
  const bool restarted = window.push({slot.meta, plane, slot.index, std::exchange(repeats, 0)}, restart_window);
  if (restarted) stats.restarts.add();
  publish_ready();
  return true;
}

// One line when most frames begin to go without the gyro, and one when they no longer do.
std::optional<Notice> Pipeline::Impl::gyro_notice() {
  std::array<std::uint64_t, kGyroUses> fresh{};
  for (std::size_t i = 0; i < kGyroUses; ++i) fresh[i] = stats.gyro[i].value() - gyro_reported[i];
  if (sum_of(fresh) < kGyroFrames) return std::nullopt;
  for (std::size_t i = 0; i < kGyroUses; ++i) gyro_reported[i] += fresh[i];
  const auto most = static_cast<GyroUse>(std::ranges::max_element(fresh) - fresh.begin());
  if (most == std::exchange(last_gyro_use, most)) return std::nullopt;
  if (most == GyroUse::kUsed) return Notice{false, "the gyro tells the motion again", event::kGyro};
  return Notice{true,
                most == GyroUse::kSilent
                    ? "the gyro has no samples of the frames' time, so the motion comes from the frames alone"
                    : "the picture moves otherwise than the gyro says, which is ignored: its axes, signs, scale "
                      "(lens.focal_px) or delay (gyro.delay_s) are wrong",
                event::kGyro};
}

void Pipeline::Impl::idle_sinks() noexcept {
  const std::int64_t now_ns = monotonic_ns();
  if (now_ns - last_sign_ns < kPollNs) return;
  read_clock(now_ns);
  for (FrameSink* sink : sinks) sink->idle(stats);
  last_sign_ns = now_ns;
}

void Pipeline::Impl::loop(const std::atomic<bool>& stop_requested) noexcept {
  last_sign_ns = monotonic_ns();
  stats.polled_ns.set(last_sign_ns);
  while (!stop_requested.load(std::memory_order_relaxed) && !must_give_up()) {
    const bool finished = inlet.finished();  // read before the queue: a frame committed before finish() is then found
    if (!process_next() && finished) return;
    idle_sinks();
  }
}

void Pipeline::Impl::drain() noexcept {
  inlet.finish();  // makes next() on an empty queue return at once
  while (!must_give_up() && process_next()) continue;
  if (must_give_up()) return;
  window.finish();
  publish_ready();
}

// Measures the solver once, if the source does not wait for it.
Status Pipeline::Impl::keep_up() {
  if (!options.must_keep_up) return {};
  ASSIGN_OR_RETURN(auto trial, SolverLadder::create(settings, corrections->format(), options.output,
                                                    options.maps.row_delay_s, options.degrade));
  const Pace pace = trial.measure(settings, corrections->format(), options.output, team.size());
  if (pace.least == QualityLevel::kFull) return {};
  char times[96];
  std::snprintf(times, sizeof times, " takes some %.0f ms a frame of %s, but frames come every %.0f ms",
                pace.full_s * 1e3, size_text(info.format.geometry).c_str(), settings.period_s * 1e3);
  const std::string slow = text + times;
  if (!options.degrade) return bad_input(slow + "; choose a faster solver, give it more workers, or let it degrade");
  least = pace.least;
  if (options.warn) options.warn(slow + ": effort is \"" + std::string(name(least)) + "\" from the start");
  return {};
}

Result<std::unique_ptr<Pipeline>> Pipeline::create(std::unique_ptr<FrameSource> source,
                                                   const std::vector<FrameSink*>& sinks,
                                                   const PipelineOptions& options) {
  ASSIGN_OR_RETURN(SourceInfo info, source->open());
  RETURN_IF_ERROR(check(options, info.format));
  ASSIGN_OR_RETURN(auto timed, Timed::create(options, info.format));

  auto impl = std::make_unique<Impl>(std::move(source), std::move(info), std::move(timed), options);
  impl->warn(impl->team.status());
  if (const std::string little = deblur::weak_inertia_warning(impl->settings); !little.empty() && options.warn) {
    options.warn(little);
  }
  RETURN_IF_ERROR(impl->keep_up());
  const SinkFormat format{.source = impl->info,
                          .deblurred_type = options.output,
                          .deblur = impl->settings,
                          .solver_text = impl->text,
                          .iterations_asked = options.deblur.iterations,
                          .isa = std::string(deblur::best_isa()),
                          .maps = !options.maps.empty(),
                          .motion = impl->settings.method == deblur::Method::kMotion,
                          .undone = impl->corrections->beyond_maps() || impl->settings.gyro != nullptr,
                          .row_delay_s = options.maps.row_delay_s,
                          .region = options.region,
                          .points = options.points};
  impl->all_sinks = sinks;
  RETURN_IF_ERROR(impl->sinks.open(sinks, format));
  return std::unique_ptr<Pipeline>(new Pipeline(std::move(impl)));
}

Status Pipeline::run(const std::atomic<bool>& stop_requested) {
  impl_->warn(rt::apply_to_this_thread(impl_->options.thread));
  impl_->stop = &stop_requested;
  Status started = impl_->source->start(impl_->inlet);
  if (started) impl_->loop(stop_requested);
  impl_->source->stop();
  impl_->drain();
  impl_->sinks.close();
  impl_->stop = nullptr;
  return started;
}

Status Pipeline::set_period(double period_s) {
  StreamFormat format = impl_->info.format;
  format.frame_period_s = period_s;
  ASSIGN_OR_RETURN(auto timed, Timed::create(impl_->options, format));
  delete impl_->spent.exchange(nullptr, std::memory_order_acquire);  // partners: take_period()
  delete impl_->next_timed.exchange(new Timed(std::move(timed)), std::memory_order_acq_rel);
  return {};
}

Pipeline::Pipeline(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Pipeline::~Pipeline() = default;

const PipelineStats& Pipeline::stats() const noexcept { return impl_->stats; }
const SourceInfo& Pipeline::source() const noexcept { return impl_->info; }

std::vector<Notice> Pipeline::take_notices() {
  std::vector<Notice> notices = impl_->source->take_notices();
  for (FrameSink* sink : impl_->all_sinks) {
    std::ranges::move(sink->take_notices(), std::back_inserter(notices));
  }
  if (impl_->gap) std::ranges::move(impl_->gap->take_notices(), std::back_inserter(notices));
  if (const std::uint64_t steps = impl_->stats.clock_steps.value(); steps != impl_->steps_reported.exchange(steps)) {
    notices.push_back({true,
                       "somebody set the host's clock: UTC of the frames stepped with it, their other times did not",
                       event::kClockStep});
  }
  for (std::string& line : take_doubts()) notices.push_back({true, std::move(line), event::kSettingsDoubted});
  if (auto notice = impl_->gyro_notice()) notices.push_back(std::move(*notice));
  return notices;
}

std::vector<std::string> Pipeline::take_doubts() { return impl_->input_check.take(); }

std::span<FrameSink* const> Pipeline::sinks() const noexcept { return impl_->all_sinks; }

Status Pipeline::trigger_nuc() { return impl_->source->trigger_nuc(); }
const deblur::Settings& Pipeline::settings() const noexcept { return impl_->settings; }
std::string_view Pipeline::isa() const noexcept { return impl_->solvers.full().isa(); }
const std::string& Pipeline::solver_text() const noexcept { return impl_->text; }

void apply_profile(const model::CameraProfile& profile, model::PixelMaps maps, PipelineOptions& options) {
  const double late_s = 0.5 * profile.undo.integration_s;
  options.deblur.tau_s = profile.tau_s + late_s;
  options.deblur.gyro_setup = profile.gyro;
  options.maps = std::move(maps);
  for (float& tau_s : options.maps.tau_s) tau_s += static_cast<float>(late_s);
  options.undo = profile.undo;
  options.pixel_noise_k = profile.noise_k;
}

}  // namespace bolo::pipeline
