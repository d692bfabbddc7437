// Initial phases of the stimuli in their recordings, and a check of the files' descriptions.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

constexpr float kLeastContrast = 0.2F;       // least contrast, relative to the prediction's, by which a shift is scaled
constexpr double kLostCorrelation = 0.01;    // below the start frame's: with a lower one, the frame is searched
constexpr double kLostSteps = 0.3;           // deviation from the expected position, of the step between frames, or
constexpr double kLostShift_px = 0.2;        // at least this
constexpr double kBetterCorrelation = 1e-4;  // gain required to move to another position
constexpr double kLargestDelay_s = 0.015;    // of a chopper
constexpr double kClearMatch = 0.6;          // correlation that reveals a chopper with hot and cold exchanged
constexpr double kDelayStep_s = 0.0005;

struct Match {
  double correlation = -1.0;
  double shift = 0.0;
};

double correlation(const Eigen::Ref<const ArrayXf>& a, const Eigen::Ref<const ArrayXf>& b) {
  const ArrayXf x = a - a.mean();
  const ArrayXf y = b - b.mean();
  const float norm = std::sqrt(x.square().sum() * y.square().sum());
  return norm > 0.0F ? static_cast<double>((x * y).sum() / norm) : 0.0;
}

struct FrameMatcher {
  BarsModel model;
  std::span<const int> pixels;
  ArrayXf value = ArrayXf(std::ssize(pixels));
  ArrayXf slope = value;

  Match at(const ArrayXf& seen, std::size_t k, double shift) {
    model.frame(k, shift, pixels, value.data(), nullptr);
    return {correlation(seen, value), shift};
  }

  // Gauss-Newton with free level and contrast.
  Match refine(const ArrayXf& seen, std::size_t k, double shift, int rounds = 4) {
    for (int i = 0; i < rounds; ++i) {
      model.frame(k, shift, pixels, value.data(), slope.data());
      Eigen::Matrix<float, Eigen::Dynamic, 3> x(value.size(), 3);
      x.col(0).setOnes();
      x.col(1) = (value - value.mean()).matrix();
      x.col(2) = slope.matrix();
      const Eigen::Matrix3f normal = x.transpose() * x;
      const Eigen::Vector3f right = x.transpose() * (seen - value.mean()).matrix();
      const Eigen::Vector3f solved = normal.ldlt().solve(right);
      if (!solved.allFinite()) break;
      const float contrast = std::abs(solved[1]) > kLeastContrast ? solved[1] : 1.0F;
      shift += std::clamp(static_cast<double>(solved[2] / contrast), -1.0, 1.0);
    }
    return at(seen, k, shift);
  }
};

ArrayXf seen_at(const Recording& recording, Index k, std::span<const int> pixels) {
  return recording.values(k, std::vector<int>(pixels.begin(), pixels.end())).transpose().array();
}

// The middle frame of a pan, or the next used one; the first frame of a still.
std::size_t typical_frame(const Recording& r) {
  auto at = static_cast<std::size_t>(r.kind == Kind::kMovingBars ? r.frames() / 2 : 0);
  while (r.kind == Kind::kMovingBars && at + 1 < r.used.size() && r.used[at] == 0) ++at;
  return at;
}

// Phase of the bars in the typical frame of a pan, or in the mean of a still.
Match search(FrameMatcher& matcher, const Recording& r) {
  constexpr int kSteps = 96;
  const std::size_t at = typical_frame(r);
  ArrayXf seen = ArrayXf::Zero(matcher.value.size());
  if (r.kind == Kind::kMovingBars) {
    seen = seen_at(r, static_cast<Index>(at), matcher.pixels);
  } else {
    for (Index k = 0; k < r.frames(); ++k) seen += seen_at(r, k, matcher.pixels);
    seen /= static_cast<float>(r.frames());
  }
  const double period = std::get<capture::BarTarget>(r.stimulus).period_px;
  Match best;
  for (int i = 0; i < kSteps; ++i) {
    const Match match = matcher.at(seen, at, period * i / kSteps);
    if (match.correlation > best.correlation) best = match;
  }
  return matcher.refine(seen, at, best.shift, 6);
}

// Tracks from the middle outwards. A frame that fits badly is also searched one or two periods ahead and behind.
double follow_bars(const Session& session, std::size_t index, State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  StimulusState& stimulus = state.stimuli[index];
  FrameMatcher matcher{BarsModel(session, index, state), pixels};
  const std::size_t middle = typical_frame(recording);
  const Match start = search(matcher, recording);
  const double step = matcher.model.mean_speed() * session.period_s;
  stimulus.shift_px[middle] = start.shift;
  const auto walk = [&](int direction) {
    double shift = start.shift;
    for (auto k = static_cast<long>(middle) + direction; k >= 0 && k < recording.frames(); k += direction) {
      const auto frame = static_cast<std::size_t>(k);
      const double expected = shift + step * direction;
      if (recording.used[frame] == 0) {
        shift = expected;
        stimulus.shift_px[frame] = shift;
        continue;
      }
      const ArrayXf seen = seen_at(recording, k, pixels);
      Match best = matcher.refine(seen, frame, expected);
      if (best.correlation < start.correlation - kLostCorrelation ||
          std::abs(best.shift - expected) > kLostSteps * std::abs(step) + kLostShift_px) {
        for (const double jump : {1.0, -1.0, 2.0, -2.0, 3.0, 4.0, 5.0}) {
          const Match other = matcher.refine(seen, frame, expected + jump * step);
          if (other.correlation > best.correlation + kBetterCorrelation) best = other;
        }
      }
      shift = best.shift;
      stimulus.shift_px[frame] = shift;
    }
  };
  walk(1);
  walk(-1);
  return start.correlation;
}

double match_still(const Session& session, std::size_t index, State& state, std::span<const int> pixels) {
  FrameMatcher matcher{BarsModel(session, index, state), pixels};
  const Match match = search(matcher, session.recordings[index]);
  state.stimuli[index].phase_px = match.shift;
  return match.correlation;
}

// A possible error in the description of a bar target.
struct Doubt {
  std::string words;
  std::function<void(capture::BarTarget&)> mend;
};

std::vector<Doubt> doubts() {
  std::vector<Doubt> all{
      {"slant_px_per_row has the other sign (rows counted from the other end, or a mirrored picture)",
       [](auto& b) { b.slant_px_per_row = -b.slant_px_per_row; }},
      {"hot and cold bars are exchanged: bar_width_px is that of the cold ones",
       [](auto& b) { b.bar_width_px = b.period_px - b.bar_width_px; }}};
  const auto add = [&all](const std::string& key, double factor, std::function<void(capture::BarTarget&)> mend) {
    std::string number = std::to_string(factor);
    number.resize(4);
    all.push_back({key + " is about " + number + " times what the file says", std::move(mend)});
  };
  for (const double f : {0.5, 0.67, 0.8, 1.25, 1.5, 2.0}) {
    add("period_px, and bar_width_px with it,", f, [f](auto& b) { b.period_px *= f, b.bar_width_px *= f; });
    add("slant_px_per_row", f, [f](auto& b) { b.slant_px_per_row *= f; });
    add("bar_width_px", f, [f](auto& b) { b.bar_width_px = std::min(b.bar_width_px * f, 0.95 * b.period_px); });
  }
  return all;
}

// 1 - correlation of each recording's bars with the description after `mend`.
std::vector<double> mismatches(const Session& session, const State& state, std::span<const int> pixels,
                               const std::function<void(capture::BarTarget&)>& mend) {
  Session mended = session;
  std::vector<double> all;
  for (const std::size_t i : modelled(session)) {
    Recording& r = mended.recordings[i];
    if (!is_bars(r.kind)) continue;
    if (mend) mend(std::get<capture::BarTarget>(r.stimulus));
    FrameMatcher matcher{BarsModel(mended, i, state), pixels};
    all.push_back(1.0 - search(matcher, r).correlation);
  }
  return all;
}

double match_chopper(const Session& session, std::size_t index, State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  ArrayXf seen(recording.frames());
  for (Index k = 0; k < seen.size(); ++k) seen[k] = seen_at(recording, k, pixels).mean();
  Match best;
  for (double delay = -kLargestDelay_s; delay < kLargestDelay_s + 1e-5; delay += kDelayStep_s) {
    state.stimuli[index].delay_s = delay;
    const int one[] = {pixels[pixels.size() / 2]};
    const Series predicted = predict(session, index, state, one);
    const double found = correlation(seen, predicted.col(0).array());
    if (found > best.correlation) best = {found, delay};
  }
  state.stimuli[index].delay_s = best.shift;
  return best.correlation;
}

}  // namespace

std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels) {
  std::vector<double> matched(session.recordings.size(), 1.0);
  for (const std::size_t i : modelled(session)) {
    const Kind kind = session.recordings[i].kind;
    if (kind == Kind::kMovingBars) matched[i] = follow_bars(session, i, state, pixels);
    if (kind == Kind::kStillBars) matched[i] = match_still(session, i, state, pixels);
    if (kind == Kind::kChopper) matched[i] = match_chopper(session, i, state, pixels);
  }
  smooth_speeds(session, state);
  return matched;
}

std::vector<std::string> doubt_description(const Session& session, const State& state, std::span<const int> pixels) {
  constexpr double kPoor = 0.01;    // mismatch below which the description is right
  constexpr double kBetter = 0.35;  // largest mismatch of a better description, relative to the stated one's
  constexpr double kLeastSpeed = 0.8;
  constexpr double kMostSpeed = 1.25;
  std::vector<std::string> wrong;
  const std::vector<double> stated = mismatches(session, state, pixels, {});
  double least = kBetter * sum_of(stated);
  if (sum_of(stated) > kPoor * static_cast<double>(stated.size())) {
    for (const Doubt& doubt : doubts()) {
      const std::vector<double> mended = mismatches(session, state, pixels, doubt.mend);
      if (sum_of(mended) >= least) continue;
      least = sum_of(mended);
      wrong = {"the bar target's " + doubt.words};
    }
  }
  for (const std::size_t i : modelled(session)) {
    const Recording& r = session.recordings[i];
    if (r.kind == Kind::kMovingBars && wrong.empty()) {
      const double share = median(state.stimuli[i].speed_px_s) / std::get<capture::BarTarget>(r.stimulus).velocity_px_s;
      if (share > kLeastSpeed && share < kMostSpeed) continue;
      wrong.push_back(r.name + ": velocity_px_s is " + (share < 0.0 ? "of the other sign" : "off by a factor"));
    }
    if (r.kind != Kind::kChopper) continue;
    State swapped = state;
    StimulusState& s = swapped.stimuli[i];
    for (double& level : s.level_k) level = 2.0 * kReference - level;  // hot and cold exchanged
    if (match_chopper(session, i, swapped, pixels) > kClearMatch)
      wrong.push_back(r.name + ": on and off are exchanged");
  }
  return wrong;
}

}  // namespace bolo::diagnose
