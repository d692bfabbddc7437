#include "tools/lab/eval/loop_camera.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "src/pipeline/apply_profile.hpp"
#include "src/pipeline/pipeline.hpp"
#include "src/sim/simulator.hpp"

namespace bolo::tools::loop {
namespace {

constexpr double kRateHz = 200.0;
constexpr double kPeriodS = 1.0 / kRateHz;
constexpr std::uint64_t kStreet = 5;

double scene_start(const blind::Session& session) {
  const blind::CapturePlan& last = session.captures.back();
  return last.session_start_s + static_cast<double>(last.frames) * kPeriodS + 1.0;
}

sim::CameraSettings camera_of(const blind::Session& session, std::vector<sim::EffectSpec> effects) {
  sim::CameraSettings camera;
  camera.geometry = session.geometry;
  camera.rate_hz = kRateHz;
  camera.readout.seed = session.seed ^ 0x5CE4EU;
  camera.threads = 1;
  camera.effects = std::move(effects);
  camera.camera_seed = session.camera_seed;
  camera.session_start_s = scene_start(session);
  return camera;
}

// The effects of a map: their shapes come from a seed, so they are measured.
bool has_map(std::string_view name) {
  constexpr std::array<std::string_view, 7> kMaps{"fpn_offset", "fpn_gain",    "vignetting", "self_heating",
                                                  "drift",      "dead_pixels", "tau_spread"};
  return std::ranges::find(kMaps, name) != kMaps.end();
}

// Frames of a camera without noise that looks at `field`, K.
Result<std::vector<std::vector<float>>> measure(const blind::Session& session, std::unique_ptr<const sim::Field> field,
                                                std::size_t frames) {
  std::vector<sim::EffectSpec> effects;
  std::ranges::copy_if(session.effects, std::back_inserter(effects), [](const auto& e) { return has_map(e.name); });
  sim::CameraSettings camera = camera_of(session, std::move(effects));
  camera.readout.noise_k = 0.0;
  camera.readout.quantisation_k = 0.0;
  camera.readout.type = PixelType::kFloat32;
  const auto simulator = sim::Simulator::create(camera, std::move(field));
  if (!simulator) return tl::unexpected(simulator.error());
  std::vector<std::vector<float>> shown(frames, std::vector<float>(session.geometry.pixels()));
  for (std::vector<float>& frame : shown) (*simulator)->next(frame.data(), nullptr);
  return shown;
}

Status measure_maps(const blind::Session& session, double tau_s, model::PixelMaps& maps) {
  constexpr double kCold = 290.0;
  constexpr double kHot = 310.0;
  const auto cold = measure(session, sim::make_uniform(kCold), 1);
  if (!cold) return tl::unexpected(cold.error());
  const auto hot = measure(session, sim::make_uniform(kHot), 1);
  if (!hot) return tl::unexpected(hot.error());
  const auto step = measure(session, sim::make_chopper({kCold, {0.0501}, {0.5}, {kHot}}), 16);
  if (!step) return tl::unexpected(step.error());
  constexpr std::size_t kFrom = 12;
  constexpr std::size_t kTo = 15;
  maps.geometry = session.geometry;
  for (std::size_t p = 0; p < session.geometry.pixels(); ++p) {
    const auto at = [p](const std::vector<float>& frame) { return static_cast<double>(frame[p]); };
    const double shows = (at(hot->front()) - at(cold->front())) / (kHot - kCold);
    const bool dead = std::abs(shows - 1.0) > 0.3;
    maps.dead.push_back(dead ? 1 : 0);
    maps.gain.push_back(dead ? 1.0F : static_cast<float>(1.0 / shows));
    maps.offset.push_back(dead ? 0.0F : static_cast<float>(kCold - at(cold->front()) / shows));
    const double left = (at(hot->front()) - at((*step)[kTo])) / (at(hot->front()) - at((*step)[kFrom]));
    const bool measured = !dead && left > 0.0 && left < 1.0;
    maps.tau_s.push_back(
        static_cast<float>(measured ? -static_cast<double>(kTo - kFrom) * kPeriodS / std::log(left) : tau_s));
  }
  if (std::ranges::count(maps.dead, 1) == 0) maps.dead.clear();
  return {};
}

double value_of(const sim::EffectSpec& effect, std::string_view key) {
  const auto given = effect.values.find(key);
  if (given != effect.values.end()) return given->second;
  const sim::EffectDescription* const description = sim::find_effect(effect.name);
  const auto parameter = std::ranges::find(description->parameters, key, &sim::Parameter::key);
  return parameter->standard;
}

void set_constants(const sim::EffectSpec& effect, model::CameraProfile& profile) {
  const auto value = [&effect](std::string_view key) { return value_of(effect, key); };
  model::Undo& undo = profile.undo;
  const std::string& name = effect.name;
  if (name == "tau_global") profile.tau_s *= value("scale");
  if (name == "noise_level") profile.noise_k *= value("scale");
  if (name == "row_delay") profile.row_delay_s = value("row_delay_s");
  if (name == "coarse_quantisation") profile.quantisation_k = value("step_k");
  model::undo_effects(undo, [&](std::string_view which, std::string_view key) -> std::optional<double> {
    if (which != name) return std::nullopt;
    return key.empty() ? 1.0 : value(key);
  });
  if (name == "iir") undo.filter = effect.form == "box" ? model::FrameFilter::kBox : model::FrameFilter::kRecursive;
  if (name == "iir") undo.filter_weight = value("alpha");
}

class ErrorSink final : public pipeline::FrameSink {
 public:
  explicit ErrorSink(const Recording& scene) : scene_(scene) {}
  Status open(const pipeline::SinkFormat&) override { return {}; }
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats&) noexcept override {
    if ((frame.meta.flags & kFlagWarmUp) != 0) return;
    const std::vector<float>& truth = scene_.truth[frame.meta.frame_id];
    const auto* const values = static_cast<const float*>(frame.deblurred);
    for (std::size_t p = 0; p < truth.size(); ++p) {
      const auto error = static_cast<double>(values[p] - truth[p]);
      squares_ += error * error;
    }
    count_ += static_cast<double>(truth.size());
  }
  void close() noexcept override {}
  double rmse() const { return std::sqrt(squares_ / std::max(1.0, count_)); }
  bool any() const { return count_ > 0.0; }

 private:
  const Recording& scene_;
  double squares_ = 0.0;
  double count_ = 0.0;
};

}  // namespace

Result<Recording> record_scene(const blind::Session& session, bool with_effects) {
  std::vector<sim::EffectSpec> effects;
  if (with_effects) effects = session.effects;
  for (sim::EffectSpec& effect : effects) {
    const bool moment = effect.name == "nuc_freeze" || effect.name == "offset_jump";
    if (moment) effect.values["at_s"] = 0.4 * static_cast<double>(kSceneFrames) * kPeriodS;
  }
  const sim::CameraSettings camera = camera_of(session, std::move(effects));
  return record_street(camera, {kStreet, kSceneSpeedPxS, kSceneFrames});
}

Result<diagnose::Learned> true_profile(const blind::Session& session) {
  diagnose::Learned known;
  for (const sim::EffectSpec& effect : session.effects) set_constants(effect, known.profile);
  if (std::ranges::any_of(session.effects, [](const auto& e) { return has_map(e.name); })) {
    const Status measured = measure_maps(session, known.profile.tau_s, known.maps);
    if (!measured) return tl::unexpected(measured.error());
  }
  known.maps.row_delay_s = known.profile.row_delay_s;
  return known;
}

Result<double> deblurred_error(const Recording& scene, const diagnose::Learned& known) {
  pipeline::PipelineOptions options;
  pipeline::apply_profile(known.profile, known.maps, options);
  options.deblur.lookahead = 1;
  options.output = PixelType::kFloat32;
  options.workers = 1;
  ErrorSink sink(scene);
  auto made = pipeline::Pipeline::create(std::make_unique<RecordingSource>(scene), {&sink}, options);
  if (!made) return tl::unexpected(made.error());
  const std::atomic<bool> stop{false};
  if (Status ran = (*made)->run(stop); !ran) return tl::unexpected(ran.error());
  if (!sink.any()) return failed("no frame of the scene had a full window");
  return sink.rmse();
}

}  // namespace bolo::tools::loop
