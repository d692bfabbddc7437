// From a session to its events, and what they name.
#include <algorithm>
#include <cmath>

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
    for (Jump& jump : find_jumps(session, i, session.recordings[i].values, events.freezes)) {
      remove_jump(session, jump, session.recordings[i].values);
      events.jumps.push_back(jump);
    }
  }
  find_jumping_pixels(session, events.bad);
  events.session = std::move(session);
  return events;
}

FoundEffect named(const std::string& name, double confidence) {
  FoundEffect e;
  e.name = name;
  e.stage = find_effect(name)->stage;
  e.confidence = confidence;
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

}  // namespace bolo::diagnose
