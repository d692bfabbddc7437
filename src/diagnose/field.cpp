#include "src/diagnose/field.hpp"

#include "src/diagnose/field_parts.hpp"

namespace bolo::diagnose {
namespace {

// Local motion in a still recording: a tile changes more than the quiet ones.
constexpr double kOwnMotion = 6.0;  // above the quiet tiles, in standard deviations of those
constexpr double kLeastOwn = 1.5;   // times the change of the quiet tiles
constexpr int kTiles = 8;           // along the width and the height
// Largest share of blocks with local motion for which a scene counts as tracked.
constexpr double kMostOwn = 0.35;
constexpr std::size_t kFewestTriplets = 12;
// Patterns need more triplets, or one per two frames: a scene at rest but for some jerks stays on the same pixels in
// both halves of the data.
constexpr std::size_t kFewestOfPattern = 48;

// Least pattern that both halves of the data share, in standard errors or noise; more than without effects.
constexpr double kPatternIsSure = 6.0;
constexpr double kLeastPattern = 0.4;  // slow pixel noise looks like a pattern for a while
// Above so many standard errors half of that suffices: the prediction errors of a sharp scene are counted as noise.
constexpr double kPatternIsClear = 100.0;
constexpr double kLeastColumn = 0.2;
constexpr double kHelps = 0.95;       // largest gap after, of that before
constexpr double kLeastGrowth = 1.0;  // over the recording, relative to the mean: from 0.5 to 1.5 times it
constexpr double kLeastGain = 0.0015;
constexpr double kMostLikeness = 0.2;  // correlation of neighbouring pixels' gains
constexpr double kClearTime = 3.5;     // in standard errors, model error included
constexpr double kLeastTau = 0.025;    // smallest reported relative deviation of the time constant
constexpr double kLeastDelay_s = 5e-6;

void note_jumps(Events& events, std::size_t index, std::span<const Observation::Jump> jumps) {
  for (const Observation::Jump& seen : jumps) {
    events.jumps.push_back({.recording = index,
                            .frame = seen.frame,
                            .global_k = seen.size,
                            .after_freeze = thaws(events.freezes, index, seen.frame)});
  }
}

// Removes and returns the steps of the whole picture that the frame statistics show.
std::vector<Observation::Jump> take_jumps(Recording& r) {
  std::vector<Observation::Jump> jumps = observe(r).jumps;
  for (const Observation::Jump& seen : jumps) {
    r.values.bottomRows(r.values.rows() - static_cast<Index>(seen.frame)).array() -= static_cast<float>(seen.size);
  }
  return jumps;
}

// Statistics of the quarter with the least slow variation.
struct Quiet {
  double ratio = 0.0;   // typical value of these
  double spread = 0.0;  // of one of these
};

Quiet quiet_of(const std::vector<double>& ratio) {
  constexpr double kBetween = 0.97;  // standard deviations of a Gaussian between the two quantiles
  const double quarter = quantile(ratio, 0.25);
  return {quarter, std::max(quarter - quantile(ratio, 0.05), 0.0) / kBetween};
}

// Time series of a still picture's tiles: means of their pixels, less the frame's median, outliers clipped.
Series tiles_of(const Session& session, const Recording& r) {
  constexpr float kClip = 2.5F;  // standard deviations of a pixel
  Series x = r.values(r.used_frames(), Eigen::all);
  x.rowwise() -= x.colwise().mean().eval();
  for (Index k = 0; k < x.rows(); ++k) x.row(k).array() -= median(std::vector<float>(x.row(k).begin(), x.row(k).end()));
  const double sigma = std::sqrt(median(mapped(session.grid.all(), [&x](int p) {
    return static_cast<double>((x.col(p).tail(x.rows() - 1) - x.col(p).head(x.rows() - 1)).squaredNorm()) / 2.0 /
           static_cast<double>(x.rows() - 1);
  })));
  const float most = kClip * static_cast<float>(std::max(sigma, r.step));
  const auto across = static_cast<Index>(session.grid.columns.size());
  const auto down = static_cast<Index>(session.grid.rows.size());
  Series tiles = Series::Zero(x.rows(), Index{kTiles} * kTiles);
  std::vector<float> pixels(static_cast<std::size_t>(tiles.cols()), 0.0F);
  for (Index p = 0; p < x.cols(); ++p) {
    const Index tile = p / across * kTiles / down * kTiles + p % across * kTiles / across;
    tiles.col(tile) += x.col(p).cwiseMax(-most).cwiseMin(most);
    pixels[static_cast<std::size_t>(tile)] += 1.0F;
  }
  for (Index t = 0; t < tiles.cols(); ++t)
    tiles.col(t) /= std::sqrt(std::max(1.0F, pixels[static_cast<std::size_t>(t)]));
  return tiles;
}

// True if an object moves in front of a still camera: some tiles vary more than most, slowly or from frame to frame.
bool something_moves(const Session& session, const Recording& r) {
  const Series tiles = tiles_of(session, r);
  std::vector<double> ratio;
  std::vector<double> rough;
  for (Index t = 0; t < tiles.cols(); ++t) {
    const ArrayXd x = tiles.col(t).cast<double>().array();
    rough.push_back(step_variance(x));
    ratio.push_back(wander(x));
  }
  return std::ranges::any_of(std::array{&ratio, &rough}, [](const std::vector<double>* all) {
    const Quiet quiet = quiet_of(*all);
    const double most = std::max(quiet.ratio + kOwnMotion * quiet.spread, kLeastOwn * quiet.ratio);
    return std::ranges::any_of(*all, [most](double one) { return one > most; });
  });
}

void find_noisy_pixels(Events& events, const Recording& r) {
  std::vector<int> both;
  std::ranges::set_union(events.bad.noisy, noisy_pixels(r.statistics), std::back_inserter(both));
  events.bad.noisy = std::move(both);
  leave_out_dead(events.session, events.bad);
}

// Adds an effect unless it is listed already. `alike`: another effect with the same signature.
void add_named(Findings& out, const std::string& effect, double z, Estimates parameters, Gaps gap, const char* where,
               const char* alike = nullptr) {
  if (std::ranges::any_of(out.effects, [&](const Finding& known) { return known.effect.name == effect; })) return;
  FoundEffect& e = out.add(effect, z, where, std::move(parameters));
  e.gap = gap;
  if (alike != nullptr) e.alternatives = {{alike, gap.after}};
  out.effects.back().z = std::max(z, 2.0 * kRemainderLimit);
}

void name_parts(const FieldParts& parts, Findings& out) {
  // Uneven patterns have a low z however strong they are; they count if they also help to predict the other half.
  const bool helps = parts.gap.after < kHelps * parts.gap.before;
  const auto clear = [&](const Measured& m, double agreement, double least) {
    return (m.z > kPatternIsSure || (helps && agreement > kPatternIsSure)) &&
           m.value > (m.z > kPatternIsClear ? 0.5 : 1.0) * least * parts.noise;
  };
  // A pattern that grows while the scene drifts looks like gains.
  const bool gain = parts.gain.z > std::max(kPatternIsSure, parts.growth.z) && parts.gain.value > kLeastGain &&
                    std::abs(parts.gain_likeness) < kMostLikeness;
  const Offsets& offset = gain ? parts.beside_gain : parts.offset;
  if (gain) {
    add_named(out, "fpn_gain", parts.gain.z, {{"pixel", parts.gain.estimate()}}, parts.gap,
              "pixels show more or less of the scene's changes than others");
  }
  const bool named = clear(offset.pixel, offset.pixel_agreement, kLeastPattern) ||
                     clear(offset.column, offset.column_agreement, kLeastColumn);
  if (parts.after_freeze || !named) return;
  if (parts.gap.after >= parts.gap.before) return;  // caused by the scene: what one half shows does not help the other
  if (parts.growth.value > kLeastGrowth && parts.growth.z > kPatternIsSure) {
    const double change = parts.growth.value * offset.pixel.value;
    add_named(out, "drift", parts.growth.z, {{"change_k", interval(change, parts.growth.error * offset.pixel.value)}},
              parts.gap, "a pattern stays with the pixels while the scene moves on, and grows", "fpn_offset");
  } else {
    add_named(out, "fpn_offset", std::max(offset.pixel.z, offset.column.z),
              {{"pixel_k", offset.pixel.estimate()}, {"column_k", offset.column.estimate()}}, parts.gap,
              "a pattern stays with the pixels while the scene moves on",
              !gain && parts.gain.value > kLeastGain ? "fpn_gain" : nullptr);
  }
}

// Compares the time constants found from motion with the profile's. Returns the reduction of the squared gap.
double name_times(const FromMotion& motion, const Options& options, Findings& out) {
  double closed = 0.0;
  const auto judge = [&](const char* effect, const char* key, const FromMotion::Figure& found, double nominal,
                         double unit, double least, const char* alike) {
    const double off = std::abs(found.value.value - nominal);
    const double z = off / found.value.error();
    if (z < kClearTime || off < least) return;
    if (allowed(options, effect)) closed += found.gap.before * found.gap.before - found.gap.after * found.gap.after;
    add_named(out, effect, z, {{key, interval(found.value.value / unit, found.value.error() / unit)}}, found.gap,
              "the moving scene tells another time than the profile", alike);
  };
  const double tau_s = options.profile.tau_s;
  if (motion.tau_s) judge("tau_global", "scale", *motion.tau_s, tau_s, tau_s, kLeastTau * tau_s, "iir");
  if (motion.row_delay_s) {
    judge("row_delay", "row_delay_s", *motion.row_delay_s, options.profile.row_delay_s, 1.0, kLeastDelay_s, nullptr);
  }
  return closed;
}

// Effects visible in the values of any field recording.
void name_values(const Events& events, Field& field) {
  std::size_t missed = std::accumulate(events.repeated.begin(), events.repeated.end(), std::size_t{0});
  for (const auto& [file, one] : field.seen) missed += one.lost_before.size();
  if (missed > 0) {
    const double frames = sum_of(events.session.recordings, &Recording::frames);
    const double rate = 1e3 * static_cast<double>(missed) / frames;
    add_named(field.findings, "frame_loss", 10.0,
              {{"per_thousand", interval(rate, rate / std::sqrt(static_cast<double>(missed)))}}, field.gap,
              "frames repeat the one before, or leap beyond the next one");
  }
  if (std::isfinite(events.ceiling_k)) {
    add_named(field.findings, "saturation", 20.0,
              {{"level_k", interval(events.ceiling_k, events.session.recordings.front().step)}}, field.gap,
              "values pile up at a ceiling");
  }
}

// Initial estimate of the noise of a value, from the profile and from moments when the scene is still.
double first_noise(const Recording& r, const Options& options) {
  const double seen = quantile(r.statistics.of_new_frames(r.statistics.scatter), 0.1) / std::numbers::sqrt2;
  return r.kelvin ? std::min(options.profile.noise_k, std::max(seen, 1e-4)) : std::max(seen, 0.5);
}

// Judges a recording with a moving scene; if tracking fails, only its jumps.
Result<FieldParts> judge_moving(const Recording& r, Events& events, const Options& options) {
  ASSIGN_OR_RETURN(auto motion, follow_field(r, events.session.known, first_noise(r, options), options.profile.tau_s));
  FieldParts parts;
  if (motion.triplets.size() >= kFewestTriplets) {
    const Mask known = events.bad.dead(events.session);
    parts = take_field_apart(motion.frames, motion.triplets, known, options.maps);
    parts.followed = parts.followed && parts.moving <= kMostOwn;
    parts.patterns = motion.triplets.size() >= std::min(kFewestOfPattern, r.used_frames().size() / 2);
    for (std::size_t p = 0; parts.followed && parts.patterns && p < parts.dead.size(); ++p) {
      if (parts.dead[p] != 0 && known[p] == 0) events.bad.noisy.push_back(static_cast<int>(p));
    }
  }
  parts.after_freeze = motion.after_freeze;
  parts.lost = std::move(motion.lost);
  parts.jumps = std::move(motion.jumps);
  return parts;
}

// True if the field has one temperature at any time, so that nothing in it moves.
bool is_even(const Recording& r) { return r.kind == Kind::kUniform || r.kind == Kind::kChopper; }

}  // namespace

bool Field::tells(const Effect& effect) const {
  using enum WithoutBench;
  const WithoutBench by = effect.without_bench;
  return (still && by == kStill) || (patterns && by == kMoving) || ((still || moving) && by == kBoth) ||
         (tells_tau && effect.name == "tau_global") || (tells_delay && effect.name == "row_delay") ||
         std::ranges::any_of(findings.effects, [&](const Finding& f) { return f.effect.name == effect.name; });
}

bool is_still(const Session& session, const Recording& r) {
  constexpr double kStillRatio = 3.0;
  // Changes by noise are independent between pixels (0.01 in captures of an Atto 320), unless the camera filters them
  // (0.37 in a Lepton's of its shutter); those by motion belong to edges (0.89 and 0.96 in an A65's and a Lepton's).
  constexpr double kMostLike = 0.45;
  const std::vector<Index> used = r.used_frames();
  if (used.size() < kMinFrames || median(r.statistics.of_new_frames(r.statistics.likeness)) > kMostLike) return false;
  const auto ratio =
      mapped(session.grid.all(), [&](int p) { return wander(r.values(used, p).cast<double>().array()); });
  return quantile(ratio, 0.25) < kStillRatio;
}

void prepare_field(Events& events) {
  if (has_bench(events.session)) return;
  std::erase_if(events.bad.stuck, [&events](int p) {  // clipped pixels are not stuck
    return std::ranges::any_of(events.session.recordings, [&](const Recording& r) {
      return r.statistics.mean[static_cast<std::size_t>(p)] >= events.ceiling_k;
    });
  });
  for (std::size_t i = 0; i < events.session.recordings.size(); ++i) {
    Recording& r = events.session.recordings[i];
    if (is_even(r)) continue;  // declared even, though in counts
    // Noise is measured on still recordings; moving ones become scenes. There a jerk over an uneven sky looks like an
    // offset step, so jumps are searched along the motion.
    Recording still = r;
    const std::vector<Observation::Jump> jumps = take_jumps(still);
    r.kind = Kind::kScene;
    if (!is_still(events.session, still) || something_moves(events.session, still)) continue;
    r = std::move(still);
    r.kind = Kind::kField;
    note_jumps(events, i, jumps);
    find_noisy_pixels(events, r);
  }
  find_jumping_pixels(events.session, events.bad, events.coarse ? events.step_k : 0.0, Kind::kField);
}

Result<Field> judge_field(Events& events, const Noise& noise, const Options& options, const Progress& progress) {
  Field out;
  double cells = 0.0;
  double before = 0.0;
  double after = 0.0;
  double closed = 0.0;   // reduction of the squared gap by time constants from motion
  std::size_t most = 0;  // most predictions of a recording that identified patterns
  const bool bench = has_bench(events.session);
  for (const Recording& r : events.session.recordings) {
    if (has_model(r)) continue;
    if (!progress("following the scene", 0.9)) return failed("interrupted");
    Observation& seen = out.seen[r.name] = observe(r);
    if (!is_even(r)) {
      ASSIGN_OR_RETURN(seen.motion, learn_from_motion(r, events.session, options.profile));
    }
    if (bench || r.kind == Kind::kChopper || r.used_frames().size() < kMinFrames) continue;
    if (r.kind == Kind::kField || r.kind == Kind::kUniform) {
      out.still = out.still || noise.statistics.frames > 0;
      continue;
    }
    ASSIGN_OR_RETURN(auto parts, judge_moving(r, events, options));
    note_jumps(events, static_cast<std::size_t>(&r - events.session.recordings.data()), parts.jumps);
    seen.jumps = std::move(parts.jumps);
    if (!parts.followed) {
      out.why = " (" + r.name + ": something moves by itself, or the motion is not followed)";
      continue;
    }
    out.moving = true;
    const auto count = static_cast<double>(parts.cells);
    cells += count;
    before += count * parts.gap.before * parts.gap.before;
    after += count * parts.gap.after * parts.gap.after;
    out.gaps[r.name] = parts.gap.before;
    if (parts.patterns) {
      name_parts(parts, out.findings);
      if (parts.cells > most) out.maps = std::move(parts.maps);
      most = std::max(most, parts.cells);
    }
    out.patterns = out.patterns || parts.patterns;
    seen.lost_before = std::move(parts.lost);
    if (out.scene.empty()) {
      out.scene = parts.scene;
      for (auto& row : out.scene) {
        for (plot::Plot& one : row) one.plane.unit = r.kelvin ? "K" : "counts";
      }
    }
    if (!seen.motion) continue;
    out.tells_tau = out.tells_tau || seen.motion->tau_s.has_value();
    out.tells_delay = out.tells_delay || seen.motion->row_delay_s.has_value();
    closed += name_times(*seen.motion, options, out.findings);
  }
  out.judged = out.moving || out.still;
  if (cells > 0.0) {
    out.gap.before = std::sqrt(before / cells + std::max(0.0, closed));
    out.gap.after = std::sqrt(after / cells);
  }
  if (out.judged) name_values(events, out);
  return out;
}

}  // namespace bolo::diagnose
