// `bolo-lab eval loop`: benefit of a diagnosis to the deblurring: camera -> diagnosis -> profile -> pipeline.

#include <algorithm>

#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/report.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tools/lab/blind/session.hpp"
#include "tools/lab/recording.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::loop {
namespace {

constexpr double kRateHz = 200.0;
constexpr double kPeriodS = 1.0 / kRateHz;
constexpr std::uint64_t kStreet = 5;
constexpr double kSceneSpeedPxS = 60.0;
constexpr std::size_t kSceneFrames = 260;

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

// Effects that are maps of pixels: drawn from a seed, so their shapes are measured.
bool has_map(std::string_view name) {
  constexpr std::array<std::string_view, 7> kMaps{"fpn_offset", "fpn_gain",    "vignetting", "self_heating",
                                                  "drift",      "dead_pixels", "tau_spread"};
  return std::ranges::find(kMaps, name) != kMaps.end();
}

// Frames of a noiseless camera that films `field`, K.
Result<std::vector<std::vector<float>>> measure(const blind::Session& session, std::unique_ptr<const sim::Field> field,
                                                std::size_t frames) {
  std::vector<sim::EffectSpec> effects;
  std::ranges::copy_if(session.effects, std::back_inserter(effects), [](const auto& e) { return has_map(e.name); });
  sim::CameraSettings camera = camera_of(session, std::move(effects));
  camera.readout.noise_k = 0.0;
  camera.readout.quantisation_k = 0.0;
  camera.readout.type = PixelType::kFloat32;
  ASSIGN_OR_RETURN(const auto simulator, sim::Simulator::create(camera, std::move(field)));
  std::vector<std::vector<float>> shown(frames, std::vector<float>(session.geometry.pixels()));
  for (std::vector<float>& frame : shown) simulator->next(frame.data(), nullptr);
  return shown;
}

Status measure_maps(const blind::Session& session, double tau_s, model::PixelMaps& maps) {
  constexpr double kCold = 290.0;
  constexpr double kHot = 310.0;
  ASSIGN_OR_RETURN(const auto cold, measure(session, sim::make_uniform(kCold), 1));
  ASSIGN_OR_RETURN(const auto hot, measure(session, sim::make_uniform(kHot), 1));
  ASSIGN_OR_RETURN(const auto step, measure(session, sim::make_chopper({kCold, {0.0501}, {0.5}, {kHot}}), 16));
  constexpr std::size_t kFrom = 12;
  constexpr std::size_t kTo = 15;
  maps.geometry = session.geometry;
  for (std::size_t p = 0; p < session.geometry.pixels(); ++p) {
    const auto at = [p](const std::vector<float>& frame) { return static_cast<double>(frame[p]); };
    const double shows = (at(hot.front()) - at(cold.front())) / (kHot - kCold);
    const bool dead = std::abs(shows - 1.0) > 0.3;
    maps.dead.push_back(dead ? 1 : 0);
    maps.gain.push_back(dead ? 1.0F : static_cast<float>(1.0 / shows));
    maps.offset.push_back(dead ? 0.0F : static_cast<float>(kCold - at(cold.front()) / shows));
    const double left = (at(hot.front()) - at(step[kTo])) / (at(hot.front()) - at(step[kFrom]));
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
    for (std::size_t p = 0; p < truth.size(); ++p) squares_.add(static_cast<double>(values[p] - truth[p]), 0.0);
  }
  void close() noexcept override {}
  const SquareSum& squares() const { return squares_; }

 private:
  const Recording& scene_;
  SquareSum squares_;
};

// The session's camera films a passing street after the session, with its effects or without: the same noise either
// way. Momentary effects occur in the middle.
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

// The session's hidden effects as the pipeline's corrections: constants as drawn; maps as measured by a bench without
// noise or error at the scene's time.
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

// RMSE of the deblurred scene, K, over all frames with a full window behind them, one frame of look-ahead.
Result<double> deblurred_error(const Recording& scene, const diagnose::Learned& known) {
  pipeline::PipelineOptions options;
  pipeline::apply_profile(known.profile, known.maps, options);
  options.deblur.lookahead = 1;
  options.output = PixelType::kFloat32;
  options.workers = 1;
  ErrorSink sink(scene);
  ASSIGN_OR_RETURN(auto made, pipeline::Pipeline::create(std::make_unique<RecordingSource>(scene), {&sink}, options));
  const std::atomic<bool> stop{false};
  RETURN_IF_ERROR(made->run(stop));
  if (sink.squares().count == 0) return failed("no frame of the scene had a full window");
  return sink.squares().root_mean();
}

Result<std::vector<std::string>> effects_of(const cxxopts::ParseResult& given) {
  std::vector<std::string> all;
  for (const sim::EffectDescription& effect : sim::effect_descriptions()) {
    if (effect.in_catalogue) all.emplace_back(effect.name);
  }
  if (given.count("effects") == 0) return all;
  auto named = given["effects"].as<std::vector<std::string>>();
  for (const std::string& name : named) {
    if (std::ranges::find(all, name) != all.end()) continue;
    return bad_input("--effects " + name + ": no effect of the catalogue; 'bolo simulate --list-effects' names them");
  }
  return named;
}

Result<diagnose::Report> diagnosed(const blind::Session& session, int threads) {
  ASSIGN_OR_RETURN(const auto scratch, ScratchFolder::make());
  ASSIGN_OR_RETURN(const auto files, blind::write_captures(session, scratch.path()));
  diagnose::Options options;
  options.threads = threads;
  options.maps = true;
  return diagnose::diagnose(files, options,
                            [](const std::string&, double) { return !interrupted().load(std::memory_order_relaxed); });
}

// RMSE of the deblurred scene, K: for the camera without the effect and the nominal profile; then with the effect, for
// the nominal, the diagnosed and the true profile.
Result<Json> row_of(const blind::DrawOptions& draw, int threads) {
  ASSIGN_OR_RETURN(const auto session, blind::draw_session(draw, blind::Kind::kSingle, 0));
  ASSIGN_OR_RETURN(const auto report, diagnosed(session, threads));
  ASSIGN_OR_RETURN(const auto scene, record_scene(session, true));
  ASSIGN_OR_RETURN(const auto clean, record_scene(session, false));
  ASSIGN_OR_RETURN(const auto truth, true_profile(session));
  ASSIGN_OR_RETURN(const double without_k, deblurred_error(clean, {}));
  ASSIGN_OR_RETURN(const double nominal_k, deblurred_error(scene, {}));
  ASSIGN_OR_RETURN(const double diagnosed_k, deblurred_error(scene, report.learned));
  ASSIGN_OR_RETURN(const double true_k, deblurred_error(scene, truth));
  const bool worth_it = nominal_k - true_k >= 0.01 * nominal_k;
  return Json{{"effect", draw.only},
              {"without_k", without_k},
              {"nominal_k", nominal_k},
              {"diagnosed_k", diagnosed_k},
              {"true_k", true_k},
              {"hurts", nominal_k / without_k - 1.0},
              {"recovered_share", worth_it ? Json((nominal_k - diagnosed_k) / (nominal_k - true_k)) : Json()},
              {"found", list_of(report.effects, [](const auto& found) { return found.name; })}};
}

Status evaluate(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const auto effects, effects_of(given));
  blind::DrawOptions draw;
  draw.seed = given["seed"].as<std::uint64_t>();
  ASSIGN_OR_RETURN(draw.frames_scale, number_of<double>(given, "frames-scale", 0.1, 10.0));
  ASSIGN_OR_RETURN(const int threads, number_of<int>(given, "threads", 1, 64));
  Progress progress("effects", effects.size());
  Json rows = Json::array();
  for (const std::string& effect : effects) {
    draw.only = effect;
    auto row = row_of(draw, threads);
    if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
    if (!row) return at(effect, row.error());
    rows.push_back(std::move(*row));
    progress.update(rows.size());
  }
  print_report({{"seed", draw.seed}, {"rows", rows}}, given.count("json") != 0);
  return {};
}

}  // namespace

}  // namespace bolo::tools::loop

int bolo::tools::eval_loop_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo-lab eval loop",
      "For each effect: simulates a bench session and a moving scene of one camera, diagnoses the session without "
      "being\ntold, and deblurs the scene with the nominal profile, the diagnosed one, and the true one: RMSE against "
      "the "
      "truth, K.\nhurts: nominal against the camera without the effect. recovered_share: (nominal - diagnosed) / "
      "(nominal - true), where\ntrue parameters gain 1 % or more.");
  add_option<std::vector<std::string>>(cli, "effects", "Of the catalogue, separated by commas (default: all)", nullptr,
                                       "A,B");
  add_option<std::uint64_t>(cli, "seed", "Another one draws other strengths and another camera", "1", "N");
  add_option<int>(cli, "threads", "Of a diagnosis", "2", "W");
  add_option<double>(cli, "frames-scale", "Of the bench captures' lengths", "1", "S");
  add_option<bool>(cli, "json", "Print the table as JSON");
  return run_verb("loop", std::move(cli), argc, argv, loop::evaluate);
}
