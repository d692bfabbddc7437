#include <mutex>
#include <set>

#include "src/sim/simulator.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {
namespace {

constexpr double kPeriodS = 0.005;
constexpr double kShutterK = 300.0;
constexpr double kHotK = 325.0;
constexpr double kChopperColdK = 295.0;
constexpr std::array<double, 2> kChopperLevelsK{305.0, 320.0};
constexpr std::array<double, 5> kPulsesS{0.012, 0.030, 0.060, 0.120, 0.300};
constexpr double kGapS = 0.0837;  // no multiple of a frame: the pulses' phases vary
constexpr double kBarsColdK = 290.0;
constexpr double kBarsHotK = 315.0;

constexpr std::array<int, 6> kFrames{380, 240, 400, 340, 340, 300};  // of the six captures

bool is_moment(const sim::EffectSpec& effect) { return effect.name == "nuc_freeze" || effect.name == "offset_jump"; }

// All pulse lengths at all levels, within the capture.
capture::Chopper chopper(double duration_s) {
  capture::Chopper out;
  out.cold_k = kChopperColdK;
  double on_s = kGapS;
  for (const double level_k : kChopperLevelsK) {
    for (const double pulse_s : kPulsesS) {
      if (on_s + pulse_s > duration_s) return out;
      out.on_s.push_back(on_s);
      out.off_s.push_back(on_s + pulse_s);
      out.level_k.push_back(level_k);
      on_s += pulse_s + kGapS;
    }
  }
  return out;
}

capture::BarTarget bars(const Geometry& geometry, double velocity_px_s) {
  const double period_px = geometry.width < 64 ? 20.0 : 40.0;
  return {kBarsColdK, kBarsHotK, period_px, period_px / 2.0, 0.25, velocity_px_s};
}

capture::Stimulus stimulus_of(std::size_t i, const Geometry& geometry, double duration_s) {
  switch (i) {
    case 0:
      return capture::Uniform{kShutterK};
    case 1:
      return capture::Uniform{kHotK};
    case 2:
      return chopper(duration_s);
    case 3:
      return bars(geometry, 70.0);
    case 4:
      return bars(geometry, -320.0);
    default:
      return bars(geometry, 0.0);
  }
}

// Errors common to all captures of a session: one target, one room.
struct Bench {
  bool imperfect = false;
  double edge_px = 0.0;
  double reflection = 0.0;
};

Bench draw_bench(bool imperfect, Dice& dice) {
  return imperfect ? Bench{true, dice.between(0.0, 0.3), dice.between(0.0, 0.01)} : Bench{};
}

// The stimulus' errors: start phase always, others if the bench is imperfect.
sim::StimulusError draw_faults(const capture::Stimulus& stimulus, const Bench& bench, Dice& dice) {
  sim::StimulusError faults;
  const bool is_chopper = std::holds_alternative<capture::Chopper>(stimulus);
  const auto* const target = std::get_if<capture::BarTarget>(&stimulus);
  if (is_chopper) faults.start_s = dice.between(-0.005, 0.005);
  if (target != nullptr) faults.phase = dice.unit();
  if (!bench.imperfect) return faults;
  constexpr double kLeastK = 0.1;
  constexpr double kMostK = 1.0;
  faults.level_k = dice.signed_between(kLeastK, kMostK);
  faults.reflection = bench.reflection;
  if (is_chopper) faults.sweep_s = dice.between(0.0, 0.004);
  if (is_chopper) faults.level2_k = dice.signed_between(kLeastK, kMostK);
  if (is_chopper || target != nullptr) faults.cold_k = dice.signed_between(kLeastK, kMostK);
  if (target == nullptr) return faults;
  faults.edge_px = bench.edge_px;
  if (target->velocity_px_s == 0.0) return faults;
  faults.velocity = dice.signed_between(0.0, 0.01);
  faults.uneven = dice.between(0.0, 0.01);
  faults.uneven_period_s = dice.between(1.0, 3.0);  // slow: a capture is about one period
  faults.uneven_phase = dice.unit();
  return faults;
}

void add_effect(std::vector<CapturePlan>& plans, const sim::EffectSpec& effect, Dice& dice) {
  if (!is_moment(effect)) {
    for (CapturePlan& plan : plans) plan.effects.push_back(effect);
    return;
  }
  // The effect is in one or two captures.
  const std::set<std::size_t> where{dice.below(plans.size()), dice.below(plans.size())};
  for (const std::size_t i : where) {
    sim::EffectSpec placed = effect;
    placed.values["at_s"] = dice.between(0.2, 0.55) * static_cast<double>(plans[i].frames) * kPeriodS;
    plans[i].effects.push_back(std::move(placed));
  }
}

// Sets the levels of clipping effects within the stimuli's range.
void place_in_scene(sim::EffectSpec& effect, Dice& dice) {
  const double cut = dice.between(0.05, 0.25);
  if (effect.name == "saturation") {
    effect.values["level_k"] = kChopperLevelsK[1] - cut * (kChopperLevelsK[1] - kChopperColdK);
  }
  if (effect.name == "clipped_range") effect.values["level_k"] = kBarsColdK + cut * (kBarsHotK - kBarsColdK);
}

// The six captures. A momentary effect (a shutter, a jump) is in one or two of them.
std::vector<CapturePlan> plan_captures(const DrawOptions& options, const std::vector<sim::EffectSpec>& effects,
                                       Dice& dice) {
  std::vector<CapturePlan> plans;
  const Bench bench = draw_bench(options.imperfect, dice);
  double start_s = 0.0;
  for (std::size_t i = 0; i < kFrames.size(); ++i) {
    CapturePlan plan;
    plan.file = "capture-" + std::to_string(i + 1) + ".h5";
    plan.frames = static_cast<std::size_t>(std::max(20.0, std::round(kFrames[i] * options.frames_scale)));
    const double duration_s = static_cast<double>(plan.frames) * kPeriodS;
    plan.stimulus = stimulus_of(i, options.geometry, duration_s);
    plan.session_start_s = start_s;
    plan.noise_seed = dice.word() >> 1U;
    plan.faults = draw_faults(plan.stimulus, bench, dice);
    start_s += duration_s + dice.between(1.0, 3.0);
    plans.push_back(std::move(plan));
  }
  for (const sim::EffectSpec& effect : effects) add_effect(plans, effect, dice);
  return plans;
}

constexpr std::array<std::string_view, kKinds> kNames{"effect-free", "single", "pair", "outside",
                                                      "withheld",    "forms",  "bench"};

struct Choice {
  std::string_view effect;
  std::string_view form;
};

// Effects for sessions of this kind, in the order in which they are used.
std::vector<Choice> choices(Kind kind) {
  std::vector<Choice> out;
  for (const sim::EffectDescription& effect : sim::effect_descriptions()) {
    if (effect.in_catalogue == (kind == Kind::kOutside) || kind == Kind::kEffectFree || kind == Kind::kBench) continue;
    if (kind != Kind::kForms) out.push_back({effect.name, {}});
    for (std::size_t i = 1; kind == Kind::kForms && i < effect.forms.size(); ++i) {
      out.push_back({effect.name, effect.forms[i]});
    }
  }
  return out;
}

std::uint64_t session_seed(const DrawOptions& options, Kind kind, std::size_t index) {
  using splitmix::key;
  return key(key(key(options.seed, 0) + static_cast<std::uint64_t>(kind), 0) + index, 0);
}

Result<sim::EffectSpec> drawn(const Choice& choice, Dice& dice) {
  ASSIGN_OR_RETURN(auto effect, sim::draw_effect(choice.effect, dice.word()));
  effect.form = choice.form;
  place_in_scene(effect, dice);
  return effect;
}

Status draw_effects(const DrawOptions& options, Session& session, Dice& dice) {
  if (session.kind == Kind::kBench) session.misdescribed = kMisdescribed[session.index % kMisdescribed.size()];
  if (session.kind == Kind::kEffectFree || session.kind == Kind::kBench) return {};
  std::vector<Choice> all = choices(session.kind);
  if (!options.only.empty()) {
    std::erase_if(all, [&](const Choice& c) { return c.effect != options.only; });
  }
  if (all.empty()) {
    return bad_input("no effect " + (options.only.empty() ? "at all" : options.only) + " for sessions of the kind " +
                     std::string(name_of(session.kind)) + "; 'bolo simulate --list-effects' names them");
  }
  std::vector<Choice> chosen{all[session.index % all.size()]};
  if (session.kind == Kind::kPair) {
    std::vector<Choice> others = choices(Kind::kPair);
    std::erase_if(others, [&](const Choice& c) { return c.effect == chosen[0].effect; });
    chosen.push_back(others[dice.below(others.size())]);
  }
  for (const Choice& choice : chosen) {
    ASSIGN_OR_RETURN(auto effect, drawn(choice, dice));
    session.effects.push_back(std::move(effect));
  }
  if (session.kind == Kind::kWithheld) session.withheld = session.effects[0].name;
  return {};
}

Json json_of(const sim::EffectSpec& effect) {
  Json values = Json::object();
  for (const auto& [key, value] : effect.values) {
    if (std::isfinite(value)) values[key] = value;
  }
  return {{"name", effect.name}, {"form", effect.form}, {"values", std::move(values)}};
}

// The HDF5 library is not thread-safe.
std::mutex& hdf5_mutex() {
  static std::mutex mutex;
  return mutex;
}

sim::CameraSettings camera_of(const Session& session, const CapturePlan& plan) {
  sim::CameraSettings camera;
  camera.geometry = session.geometry;
  camera.rate_hz = 1.0 / kPeriodS;
  camera.readout.seed = plan.noise_seed;
  camera.threads = 1;
  camera.effects = plan.effects;
  camera.camera_seed = session.camera_seed;
  camera.session_start_s = plan.session_start_s;
  return camera;
}

// The file's description of the bench, with one error.
capture::Stimulus described(capture::Stimulus stimulus, std::string_view wrong) {
  if (auto* bars = std::get_if<capture::BarTarget>(&stimulus)) {
    if (wrong == "slant") bars->slant_px_per_row *= -1.0;
    if (wrong == "velocity") bars->velocity_px_s *= -1.0;
    if (wrong == "speed") bars->velocity_px_s *= 0.5;
    if (wrong == "period") bars->period_px *= 1.5, bars->bar_width_px *= 1.5;
    if (wrong == "width") bars->bar_width_px *= 0.5;
  }
  if (auto* chopper = std::get_if<capture::Chopper>(&stimulus); chopper != nullptr && wrong == "on_off") {
    const double highest = *std::ranges::max_element(chopper->level_k);
    for (double& level : chopper->level_k) level = chopper->cold_k;
    chopper->cold_k = highest;
  }
  return stimulus;
}

// Without the attributes of sim::write_capture(), which reveal seeds.
Status write_planes(const std::filesystem::path& file, const StreamFormat& format, const CapturePlan& plan,
                    std::string_view misdescribed, const std::vector<std::uint16_t>& counts) {
  const std::lock_guard lock(hdf5_mutex());
  capture::CaptureInfo info;
  info.format = format;
  info.camera_model = "camera";
  ASSIGN_OR_RETURN(auto writer, capture::CaptureWriter::create(file, info));
  RETURN_IF_ERROR(writer.write_stimulus(described(plan.stimulus, misdescribed)));
  for (std::size_t k = 0; k < plan.frames; ++k) {
    const std::uint16_t* const plane = counts.data() + k * format.geometry.pixels();
    RETURN_IF_ERROR(writer.append(static_cast<double>(k) * kPeriodS, k, plane));
  }
  return writer.close();
}

Status write_capture(const Session& session, const CapturePlan& plan, const std::filesystem::path& file) {
  if (session.reality == Reality::kSecond) {
    const StreamFormat format{session.geometry, PixelType::kUint16, {Unit::kKelvin, 0.01, 0.0}, kPeriodS, 1};
    return write_planes(file, format, plan, session.misdescribed, second::film(session, plan));
  }
  ASSIGN_OR_RETURN(auto field, sim::with_errors(sim::make_field(plan.stimulus), plan.faults, session.geometry));
  ASSIGN_OR_RETURN(const auto simulator, sim::Simulator::create(camera_of(session, plan), std::move(field)));
  std::vector<std::uint16_t> counts(session.geometry.pixels() * plan.frames);
  for (std::size_t k = 0; k < plan.frames; ++k) simulator->next(counts.data() + k * session.geometry.pixels(), nullptr);
  return write_planes(file, simulator->format(), plan, session.misdescribed, counts);
}

}  // namespace

std::string_view name_of(Kind kind) { return kNames[static_cast<std::size_t>(kind)]; }

std::optional<Kind> kind_named(std::string_view name) {
  const auto* const found = std::ranges::find(kNames, name);
  if (found == kNames.end()) return std::nullopt;
  return static_cast<Kind>(found - kNames.begin());
}

Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index) {
  if (options.reality == Reality::kSecond) return second::draw_session(options, kind, index);
  Session session;
  session.kind = kind;
  session.index = index;
  session.seed = session_seed(options, kind, index);
  session.geometry = options.geometry;
  Dice dice(session.seed, 1);
  session.camera_seed = dice.word() >> 1U;
  RETURN_IF_ERROR(draw_effects(options, session, dice));
  session.captures = plan_captures(options, session.effects, dice);
  return session;
}

nlohmann::json to_json(const Session& session) {
  const auto capture_json = [](const CapturePlan& plan) {
    return Json{{"file", plan.file},
                {"frames", plan.frames},
                {"session_start_s", plan.session_start_s},
                {"noise_seed", plan.noise_seed},
                {"effects", list_of(plan.effects, json_of)},
                {"stimulus_error", sim::stimulus_error_text(plan.faults)},
                {"bench", plan.bench}};
  };
  return {{"kind", name_of(session.kind)},
          {"reality", session.reality == Reality::kSecond ? "second" : "first"},
          {"index", session.index},
          {"seed", session.seed},
          {"effects", list_of(session.effects, json_of)},
          {"withheld", session.withheld},
          {"misdescribed", session.misdescribed},
          {"width", session.geometry.width},
          {"height", session.geometry.height},
          {"camera_seed", session.camera_seed},
          {"captures", list_of(session.captures, capture_json)}};
}

Result<std::vector<std::filesystem::path>> write_captures(const Session& session, const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const CapturePlan& plan : session.captures) {
    files.push_back(folder / plan.file);
    RETURN_IF_ERROR(write_capture(session, plan, files.back()));
  }
  return files;
}

}  // namespace bolo::tools::blind
