#include "diagnosis.hpp"

#include <algorithm>
#include <cmath>

#include "learn.hpp"

namespace bolo::diagnose {

FoundEffect named(const std::string& name, double confidence) {
  FoundEffect e;
  e.name = name;
  e.stage = find_effect(name)->stage;
  e.confidence = confidence;
  return e;
}

bool Diagnosis::allowed(const std::string& name) const { return std::ranges::count(options_.withheld, name) == 0; }

void Diagnosis::remain(const std::string& stage, const std::string& where, double z) {
  remainders_.push_back({stage, where, z, std::nullopt, false});
}

void Diagnosis::found(FoundEffect effect, double z, const std::string& where) {
  if (allowed(effect.name)) {
    report_.effects.push_back(std::move(effect));
  } else {
    remain(effect.stage, where, z);
  }
}

bool Diagnosis::has(const std::string& effect) const {
  return std::ranges::any_of(report_.effects, [&](const FoundEffect& e) { return e.name == effect; });
}

double Diagnosis::nominal_noise() const {
  if (!session_.recordings.front().kelvin) return noise_.white_k;
  const model::CameraProfile& p = options_.profile;
  return std::sqrt(p.noise_k * p.noise_k + p.quantisation_k * p.quantisation_k / 12.0);
}

// A frozen stream tells nothing of the camera, whatever it looks at.
void Diagnosis::leave_out_frozen() {
  for (Recording& r : session_.recordings) {
    const std::size_t distinct = r.statistics.distinct_frames();
    if (!has_model(r) || distinct >= kMinFrames) continue;
    report_.warnings.push_back(r.name + ": is frozen: " + std::to_string(distinct) + " of its " +
                               std::to_string(r.statistics.frames()) +
                               " frames differ from the one before; used for events only");
    r.kind = Kind::kField;
  }
}

void Diagnosis::judge_events() {
  leave_out_frozen();
  raw_ = session_;
  freezes_ = find_freezes(session_, repeated_);
  bad_ = find_dead_pixels(session_);
  step_k_ = find_step(session_);
  coarse_ = step_k_ > 1.5 * std::max(options_.profile.quantisation_k, 1e-9);
  for (const Recording& r : session_.recordings) ceiling_k_ = std::min(ceiling_k_, find_ceiling(r, step_k_));
  // In a field recording what moves is not known, so that steps of the scene would be taken for jumps.
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    if (session_.recordings[i].kind != Kind::kUniform) continue;
    for (Jump& jump : find_jumps(session_, i, session_.recordings[i].values, freezes_)) {
      remove_jump(session_, jump, session_.recordings[i].values);
      jumps_.push_back(jump);
    }
  }
  find_jumping_pixels(session_, bad_);
}

// Effects that show in the values themselves.
void Diagnosis::judge_values() {
  const auto pixels = static_cast<double>(session_.width) * static_cast<double>(session_.height);
  if (!bad_.jumping.empty() && (bad_.jumping.size() > 1 || bad_.step_k > 8.0 * floor_k_)) {
    FoundEffect e = named("rts", 0.99);
    const auto count = static_cast<double>(bad_.jumping.size());
    const auto seen = static_cast<double>(session_.good.size());
    e.parameters["fraction"] = interval(count / seen, std::sqrt(count) / seen);
    e.parameters["step_k"] = interval(bad_.step_k, bad_.step_k / std::sqrt(count) * 0.4);
    found(std::move(e), 10.0, "some pixels jump between two levels");
  }
  const std::size_t dead = bad_.stuck.size() + bad_.noisy.size();
  if (dead > 0) {
    FoundEffect e = named("dead_pixels", 0.999);
    const auto count = static_cast<double>(dead);
    e.parameters["fraction"] = interval(count / pixels, std::sqrt(count) / pixels);
    found(std::move(e), 10.0, "some pixels are stuck or nothing but noise");
  }
  if (coarse_ && options_.profile.quantisation_k > 0.0 && session_.recordings.front().kelvin) {
    FoundEffect e = named("coarse_quantisation", 0.999);
    e.of_noise = true;
    e.parameters["step_k"] = interval(step_k_, 0.001 * step_k_);
    found(std::move(e), 10.0, "values are multiples of a coarser step");
  }
}

// Jumps and freezes were taken out before the fits; they lie between the nominal camera and what is left.
void Diagnosis::name_jumps() {
  const auto add = [this](const std::string& name, double confidence, std::map<std::string, Estimate> parameters,
                          const std::string& where) {
    FoundEffect e = named(name, confidence);
    e.gap_before = report_.gap_before;
    e.gap_after = report_.gap_after;
    e.parameters = std::move(parameters);
    found(std::move(e), 20.0, where);
  };
  const auto jump = std::ranges::find(jumps_, false, &Jump::after_freeze);
  if (jump != jumps_.end()) {
    const double size = std::abs(jump->global_k);
    add("offset_jump", 0.99, {{"jump_k", interval(size, 0.01 * size + 0.003)}}, "the offset jumps at one frame");
  }
  // A stream that is frozen to its end is no shutter that opened again.
  const auto over = std::ranges::find_if(freezes_, [this](const Freeze& f) {
    return f.last + 1 < static_cast<std::size_t>(session_.recordings[f.recording].frames());
  });
  if (over == freezes_.end()) return;
  const Freeze& freeze = *over;
  std::map<std::string, Estimate> parameters;
  parameters["freeze_frames"] = interval(static_cast<double>(freeze.last - freeze.first + 1), 1.0);
  for (const Jump& thawed : jumps_) {
    if (thawed.after_freeze) parameters["offset_k"] = interval(thawed.pixel_k, 0.05 * thawed.pixel_k);
  }
  add("nuc_freeze", 0.999, std::move(parameters), "frames are frozen for a while");
}

Result<Report> Diagnosis::run() {
  for (const Recording& r : session_.recordings) {
    report_.inputs.push_back(r.name);
    report_.frames += static_cast<std::size_t>(r.frames());
  }
  report_.warnings = session_.warnings;
  if (!progress_("events and pixels", 0.03)) return failed("interrupted");
  judge_events();
  if (!progress_("noise", 0.06)) return failed("interrupted");
  judge_noise();
  judge_values();
  if (const Status means = judge_means(); !means) return tl::unexpected(means.error());
  name_jumps();
  conclude();
  return report_;
}

Result<Learned> Diagnosis::learn(const std::vector<std::filesystem::path>& captures, const Report& report) const {
  const LearnTask task{session_,        fitted_ ? &state_ : nullptr, jumps_, bad_, noise_.filter, report.effects,
                       options_.profile};
  Learned learned = learn_constants(task);
  if (!options_.maps) return learned;
  if (!progress_("every pixel", 0.95)) return failed("interrupted");
  auto maps = learn_maps(task, captures, options_.threads);
  if (!maps) return tl::unexpected(maps.error());
  learned.maps = std::move(*maps);
  return learned;
}

}  // namespace bolo::diagnose
