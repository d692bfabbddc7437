#include "src/diagnose/diagnose.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "src/diagnose/learn.hpp"
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kCoarse = 1.5;  // times the profile's step, from which on values count as coarse

// A frozen stream tells nothing of the camera, whatever it looks at.
void leave_out_frozen(Session& session, std::vector<std::string>& warnings) {
  for (Recording& r : session.recordings) {
    const std::size_t distinct = r.statistics.distinct_frames();
    if (!has_model(r) || distinct >= kMinFrames) continue;
    warnings.push_back(r.name + ": is frozen: " + std::to_string(distinct) + " of its " +
                       std::to_string(r.statistics.frames()) +
                       " frames differ from the one before; used for events only");
    r.kind = Kind::kField;
  }
}

}  // namespace

Events find_events(Session session, const Options& options) {
  Events events;
  leave_out_frozen(session, events.warnings);
  events.raw = session;
  events.freezes = find_freezes(session, events.repeated);
  events.bad = find_dead_pixels(session);
  events.step_k = find_step(session);
  events.coarse = events.step_k > kCoarse * std::max(options.profile.quantisation_k, 1e-9);
  for (const Recording& r : session.recordings) {
    events.ceiling_k = std::min(events.ceiling_k, find_ceiling(r, events.step_k));
  }
  // In a field recording what moves is not known, so that steps of the scene would be taken for jumps.
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    if (session.recordings[i].kind != Kind::kUniform) continue;
    if (auto jump = find_jump(session, i, session.recordings[i].values, events.freezes)) {
      remove_jump(session, *jump, session.recordings[i].values);
      events.jumps.push_back(*jump);
    }
  }
  find_jumping_pixels(session, events.bad);
  events.session = std::move(session);
  return events;
}

FoundEffect named(const std::string& name, double confidence, std::map<std::string, Estimate> parameters) {
  FoundEffect e;
  e.name = name;
  e.stage = find_effect(name)->stage;
  e.confidence = confidence;
  e.parameters = std::move(parameters);
  return e;
}

bool allowed(const Options& options, const std::string& name) {
  return std::ranges::count(options.withheld, name) == 0;
}

void add(Findings& findings, const Options& options, FoundEffect effect, double z, const std::string& where) {
  if (allowed(options, effect.name)) {
    findings.effects.push_back(std::move(effect));
  } else {
    findings.remainders.push_back({effect.stage, where, z, std::nullopt, false});
  }
}

Result<Report> diagnose(const std::vector<std::filesystem::path>& captures, const Options& options,
                        const Progress& progress) {
  for (const std::string& name : options.withheld) {
    if (find_effect(name) == nullptr)
      return bad_input("--withhold " + name + ": no effect of the catalogue has this name");
  }
  const auto start = std::chrono::steady_clock::now();
  auto session = read_session(captures, progress);
  if (!session) return tl::unexpected(session.error());
  if (!progress("events and pixels", 0.03)) return failed("interrupted");
  const Events events = find_events(std::move(*session), options);
  if (!progress("noise", 0.06)) return failed("interrupted");
  const Noise noise = judge_noise(events, options);
  const auto fit = fit_means(events, noise, options, progress);
  if (!fit) return tl::unexpected(fit.error());
  std::vector<Remainder> left;
  if (fit->done) {
    if (!progress("looking at what is left", 0.85)) return failed("interrupted");
    left = test_remainder(events, noise, *fit, options.threads);
  }
  Report report = make_report(events, noise, *fit, left, options);
  auto learned = learn({fit->session, fit->done ? &fit->state : nullptr, fit->jumps, events.bad,
                        noise.statistics.filter, report.effects, options.profile},
                       captures, options, progress);
  if (!learned) return tl::unexpected(learned.error());
  report.learned = std::move(*learned);
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace bolo::diagnose
