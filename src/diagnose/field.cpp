#include "src/diagnose/field.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "src/core/statistics.hpp"
#include "src/diagnose/field_motion.hpp"
#include "src/diagnose/field_parts.hpp"

namespace bolo::diagnose {
namespace {

// A pixel of a still recording sees something move when it varies more, against its change from frame to frame, than
// others do.
constexpr double kOwnMotion = 6.0;  // standard deviations of the quiet pixels' ratios
constexpr double kLeastOwn = 1.3;   // times their usual ratio
constexpr Index kAround = 2;        // pixels of the grid about it that go with it
constexpr std::size_t kFewestSights = 12;

// Both halves of the data must show a part by so many standard errors, and by so much of the noise: recordings without
// any effect stay below both.
constexpr double kClear = 6.0;
constexpr double kLeastPattern = 0.4;  // slow noise of pixels is a pattern for a while
constexpr double kLeastColumn = 0.2;
constexpr double kLeastFlicker = 0.08;
constexpr double kLeastGainMap = 0.002;
constexpr double kLeastTau = 0.045;  // of a logarithm
constexpr double kClearTau = 3.0;
constexpr double kLeastDelay_s = 4e-6;

constexpr std::array kStillTells{"coarse_quantisation", "dead_pixels", "flicker",     "frame_loss",
                                 "heavy_tail",          "iir",         "noise_level", "nuc_freeze",
                                 "offset_jump",         "one_over_f",  "saturation",  "stripes"};
// The noise's level and colour are not among them: texture finer than a pixel, moved, looks like noise.
constexpr std::array kMotionTells{"coarse_quantisation", "dead_pixels", "flicker",    "fpn_gain",
                                  "fpn_offset",          "frame_loss",  "nuc_freeze", "offset_jump",
                                  "row_delay",           "saturation",  "tau_global"};

bool has_bench(const Session& session) { return std::ranges::any_of(session.recordings, has_model); }

// Steps of the whole picture, as the frames' own statistics show them.
void take_jumps(Events& events, std::size_t index) {
  Recording& r = events.session.recordings[index];
  for (const Observation::Jump& seen : observe(r).jumps) {
    Jump jump{.recording = index, .frame = seen.frame, .global_k = seen.size};
    jump.after_freeze = std::ranges::any_of(
        events.freezes, [&](const Freeze& f) { return f.recording == index && f.last + 1 == seen.frame; });
    jump.removed = true;
    r.values.bottomRows(r.values.rows() - static_cast<Index>(seen.frame)).array() -= static_cast<float>(seen.size);
    events.jumps.push_back(jump);
  }
}

// A straight line in time, of all pixels alike: a camera that warms, or a scene.
void take_drift(Recording& r) {
  Line line;
  std::vector<float> frame(static_cast<std::size_t>(r.values.cols()));
  for (const Index k : r.used_frames()) {
    std::ranges::copy(r.values.row(k), frame.begin());
    line.add(static_cast<double>(k), median(frame));
  }
  if (line.count() < kMinFrames) return;
  const double slope = line.slope();
  for (Index k = 0; k < r.values.rows(); ++k)
    r.values.row(k).array() -= static_cast<float>(slope * static_cast<double>(k));
}

// Of each pixel: its variance over that between two frames.
std::vector<double> wander(const Session& session, const Recording& r) {
  return mapped(session.grid.all(), [&](int p) {
    const ArrayXd x = r.values(r.used_frames(), p).cast<double>().array();
    const Index n = x.size();
    if (n < 3) return 1.0;
    const double variance = (x - x.mean()).square().mean();
    return variance / std::max(1e-12, (x.tail(n - 1) - x.head(n - 1)).square().mean() / 2.0);
  });
}

// The quarter of the pixels that wander least.
struct Quiet {
  double ratio = 0.0;   // usual of these
  double spread = 0.0;  // of one pixel's
};

Quiet quiet_of(const std::vector<double>& ratio) {
  constexpr double kBetween = 0.97;  // standard deviations of a Gaussian between the two quantiles
  const double quarter = quantile(ratio, 0.25);
  return {quarter, std::max(quarter - quantile(ratio, 0.05), 0.0) / kBetween};
}

// Whether the camera stands still: a quarter of the pixels wander no more than noise does, and these are as noisy as
// one another, however much of the scene each of them sees.
bool stands_still(const Session& session, const Recording& r) {
  constexpr double kStillRatio = 3.0;
  constexpr double kAlike = 0.35;
  const std::vector<Index> used = r.used_frames();
  if (used.size() < kMinFrames) return false;
  const std::vector<double> ratio = wander(session, r);
  const double quarter = quiet_of(ratio).ratio;
  if (quarter >= kStillRatio) return false;
  std::vector<double> noise;
  for (Index p = 0; p < r.values.cols(); ++p) {
    if (ratio[static_cast<std::size_t>(p)] > quarter) continue;
    const ArrayXd x = r.values(used, p).cast<double>().array();
    noise.push_back(std::sqrt((x.tail(x.size() - 1) - x.head(x.size() - 1)).square().mean()));
  }
  const double usual = median(noise);
  return kSigmaOfMad * median(mapped(noise, [usual](double v) { return std::abs(v - usual); })) < kAlike * usual;
}

// Marks the pixels where something moves in a recording that stands still otherwise.
void leave_out_movers(Session& session, const Recording& r) {
  constexpr Index kEnough = 8;  // of the pixels, one in so many
  const std::vector<double> ratio = wander(session, r);
  const Quiet quiet = quiet_of(ratio);
  const double most = std::max(quiet.ratio + kOwnMotion * quiet.spread, kLeastOwn * quiet.ratio);
  const auto across = static_cast<Index>(session.grid.columns.size());
  const auto down = static_cast<Index>(session.grid.rows.size());
  std::vector<char> good = session.good;
  for (Index p = 0; p < across * down; ++p) {
    if (ratio[static_cast<std::size_t>(p)] <= most) continue;
    for (Index y = std::max<Index>(0, p / across - kAround); y <= std::min(down - 1, p / across + kAround); ++y) {
      for (Index x = std::max<Index>(0, p % across - kAround); x <= std::min(across - 1, p % across + kAround); ++x) {
        good[static_cast<std::size_t>(y * across + x)] = 0;
      }
    }
  }
  if (std::ranges::count(good, 1) * kEnough >= across * down) session.good = std::move(good);
}

class Namer {
 public:
  Namer(const Options& options, const Findings& known, Field& field)
      : options_(options), known_(known), field_(field) {}

  void name(const std::string& name, double z, std::map<std::string, Estimate> parameters, const std::string& where) {
    for (const Findings* of : std::array<const Findings*, 2>{&known_, &field_.findings}) {
      if (std::ranges::find(of->effects, name, &FoundEffect::name) != of->effects.end()) return;
    }
    FoundEffect e = named(name, 1.0 - 0.5 * std::erfc(std::min(z, 6.0) / 2.0), std::move(parameters));
    e.gap_before = gap_before;
    e.gap_after = gap_after;
    add(field_.findings, options_, std::move(e), std::max(z, 2.0 * kRemainderLimit), where);
  }
  double gap_before = 1.0;
  double gap_after = 1.0;

 private:
  const Options& options_;
  const Findings& known_;  // of the noise
  Field& field_;
};

Estimate estimate(const Measured& m) { return interval(m.value, m.error); }

void name_parts(const FieldParts& parts, Namer& out) {
  const auto clear = [&](const Measured& m, double least) { return m.z > kClear && m.value > least * parts.noise; };
  const bool pattern = clear(parts.offset, kLeastPattern);
  const bool columns = clear(parts.offset_column, kLeastColumn);
  if (pattern || columns) {
    out.name("fpn_offset", std::max(parts.offset.z, parts.offset_column.z),
             {{"pixel_k", estimate(parts.offset)}, {"column_k", estimate(parts.offset_column)}},
             "a pattern stays with the pixels while the scene moves on");
  }
  if (parts.gain.z > kClear && parts.gain.value > kLeastGainMap) {
    out.name("fpn_gain", parts.gain.z, {{"rms", estimate(parts.gain)}},
             "what a pixel is off by grows with the scene's temperature");
  }
  if (clear(parts.flicker, kLeastFlicker)) {
    out.name("flicker", parts.flicker.z, {{"sigma_k", estimate(parts.flicker)}}, "whole frames differ by an offset");
  }
}

void name_motion(const FromMotion& motion, const Options& options, Namer& out) {
  if (motion.tau_s) {
    const double nominal = options.profile.tau_s;
    const double off = std::log(motion.tau_s->value / nominal);
    const double error = (motion.tau_s->high - motion.tau_s->low) / (2.0 * 1.96) / motion.tau_s->value;
    if (std::abs(off) > kLeastTau && std::abs(off) > kClearTau * error) {
      out.name("tau_global", std::abs(off) / error,
               {{"scale", interval(motion.tau_s->value / nominal, error * motion.tau_s->value / nominal)}},
               "contrast falls with speed otherwise than the time constant says");
    }
  }
  if (motion.row_delay_s) {
    const double error = (motion.row_delay_s->high - motion.row_delay_s->low) / (2.0 * 1.96);
    const double off = motion.row_delay_s->value - options.profile.row_delay_s;
    if (std::abs(off) > kLeastDelay_s && std::abs(off) > kClear * error) {
      out.name("row_delay", std::abs(off) / error, {{"row_delay_s", *motion.row_delay_s}},
               "the picture shears when the motion changes");
    }
  }
}

// What the values themselves say, of any field recording.
void name_values(const Events& events, Namer& out) {
  const std::size_t repeated = sum_of(events.repeated) > 0.0 ? static_cast<std::size_t>(sum_of(events.repeated)) : 0;
  if (repeated > 0) {
    const double frames = sum_of(events.session.recordings, [](const Recording& r) { return r.frames(); });
    const double rate = 1e3 * static_cast<double>(repeated) / frames;
    out.name("frame_loss", 10.0, {{"per_thousand", interval(rate, rate / std::sqrt(static_cast<double>(repeated)))}},
             "frames repeat the one before");
  }
  if (std::isfinite(events.ceiling_k)) {
    out.name("saturation", 20.0, {{"level_k", interval(events.ceiling_k, events.session.recordings.front().step)}},
             "values pile up at a ceiling");
  }
}

std::vector<char> dead_of(const Events& events) {
  std::vector<char> dead(
      static_cast<std::size_t>(events.session.width) * static_cast<std::size_t>(events.session.height), 0);
  for (const auto* of : {&events.bad.stuck, &events.bad.noisy}) {
    for (const int p : *of) dead[static_cast<std::size_t>(p)] = 1;
  }
  return dead;
}

// A value's noise where there is no profile to ask, or the scene is still for a moment.
double first_noise(const Recording& r, const Options& options) {
  std::vector<double> scatter;
  for (std::size_t k = 1; k < r.statistics.frames(); ++k) {
    if (r.statistics.repeated[k] == 0) scatter.push_back(r.statistics.scatter[k]);
  }
  const double seen = quantile(std::move(scatter), 0.1) / std::numbers::sqrt2;
  return r.kelvin ? std::min(options.profile.noise_k, std::max(seen, 1e-4)) : std::max(seen, 0.5);
}

// Of one recording whose scene moves; nothing when it cannot be followed.
Result<std::optional<FieldParts>> judge_moving(const std::filesystem::path& file, const Recording& r, Events& events,
                                               const Options& options) {
  auto frames = read_field(file, r);
  if (!frames) return tl::unexpected(frames.error());
  for (const Jump& jump : events.jumps) {
    if (&events.session.recordings[jump.recording] != &r) continue;
    for (Index i = 0; i < frames->values.rows(); ++i) {
      if (frames->frame[static_cast<std::size_t>(i)] < static_cast<Index>(jump.frame)) continue;
      frames->values.row(i).array() -= static_cast<float>(jump.global_k);
    }
  }
  const FieldMotion motion = follow_field(*frames, first_noise(r, options));
  if (motion.sights.size() < kFewestSights) return std::optional<FieldParts>();
  FieldParts parts = take_field_apart(*frames, motion.sights, dead_of(events));
  const std::vector<char> known = dead_of(events);
  for (std::size_t p = 0; p < parts.dead.size(); ++p) {
    if (parts.dead[p] != 0 && known[p] == 0) events.bad.noisy.push_back(static_cast<int>(p));
  }
  return std::optional(std::move(parts));
}

}  // namespace

bool Field::tells(std::string_view effect) const {
  return (still && std::ranges::count(kStillTells, effect) != 0) ||
         (moving && std::ranges::count(kMotionTells, effect) != 0);
}

void prepare_field(Events& events) {
  if (has_bench(events.session)) return;
  for (std::size_t i = 0; i < events.session.recordings.size(); ++i) {
    take_jumps(events, i);
    Recording& r = events.session.recordings[i];
    take_drift(r);
    // Noise is measured of fields that stand still; what moves is a scene.
    r.kind = stands_still(events.session, r) ? Kind::kField : Kind::kScene;
    if (r.kind == Kind::kField) leave_out_movers(events.session, r);
  }
}

Result<Field> judge_field(const std::vector<std::filesystem::path>& files, Events& events, const Noise& noise,
                          const Options& options, const Progress& progress) {
  Field out;
  Namer namer(options, noise.findings, out);
  double cells = 0.0;
  double before = 0.0;
  double after = 0.0;
  const bool bench = has_bench(events.session);
  for (const Recording& r : events.session.recordings) {
    if (has_model(r)) continue;
    const auto file = std::ranges::find(files, r.name, [](const auto& path) { return path.filename().string(); });
    if (file == files.end()) continue;
    if (!progress("following the scene", 0.9)) return failed("interrupted");
    auto motion = learn_from_motion(*file, r, events.session, options.profile);
    if (!motion) return tl::unexpected(motion.error());
    if (*motion) out.motion[r.name] = **motion;
    if (bench || r.used_frames().size() < kMinFrames) continue;
    if (r.kind == Kind::kField) {
      out.still = out.still || noise.statistics.frames > 0;
      continue;
    }
    const auto parts = judge_moving(*file, r, events, options);
    if (!parts) return tl::unexpected(parts.error());
    if (!*parts) continue;
    out.moving = true;
    const auto count = static_cast<double>((*parts)->cells);
    cells += count;
    before += count * (*parts)->gap_before * (*parts)->gap_before;
    after += count * (*parts)->gap_after * (*parts)->gap_after;
    out.gaps[r.name] = namer.gap_before = (*parts)->gap_before;
    namer.gap_after = (*parts)->gap_after;
    name_parts(**parts, namer);
    if (*motion) name_motion(**motion, options, namer);
  }
  out.judged = out.moving || out.still;
  if (cells > 0.0) {
    out.gap_before = namer.gap_before = std::sqrt(before / cells);
    out.gap_after = namer.gap_after = std::sqrt(after / cells);
  }
  if (out.judged) name_values(events, namer);
  return out;
}

}  // namespace bolo::diagnose
