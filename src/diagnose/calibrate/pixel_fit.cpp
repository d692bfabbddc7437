// The time constant of every pixel, by passes over the frames.
#include "src/core/statistics.hpp"
#include "src/diagnose/calibrate/pulses.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kLongestStep = 0.3;  // largest change of ln tau in one pass

// Results of one pixel, kept between intervals.
struct Kept {
  double score = 0.0, information = 0.0, squares = 0.0;
  double by_noise = 0.0;  // part of the information that noise of variance 1 would give
  double delay = 0.0, weight = 0.0;
  Decay last;
};

struct Pass {
  const FrameSeries& frames;
  const DecayTable& table;
  const std::vector<SwitchBetween>& switches;
  PixelTaus& taus;
  std::vector<std::size_t> pixels;
  std::vector<IntervalSums> sums = std::vector<IntervalSums>(frames.geometry.pixels());
  std::vector<Kept> all_kept = std::vector<Kept>(frames.geometry.pixels());

  Status run(const Progress& progress) {
    if (taus.node.empty()) taus.node.assign(frames.geometry.pixels(), DecayTable::kMiddle);
    for (std::size_t i = 0; i < table.intervals().size(); ++i) {
      const Interval& interval = table.intervals()[i];
      const auto take = [&](std::size_t k, std::span<const float> frame) { add(i, k - interval.first, frame); };
      Status read = frames.for_each("fitting every pixel", progress, take, interval.first, interval.end());
      if (!read) return read;
      for (const std::size_t p : pixels) end(i, p);
    }
    conclude();
    return {};
  }

  void add(std::size_t i, std::size_t k, std::span<const float> frame) {
    for (const std::size_t p : pixels) {
      if (k == 0) sums[p] = {.base = frame[p]};
      sums[p].add(table.at(i, taus.node[p]), k, frame[p]);
    }
  }

  // Adds the interval to the pixel's fit, and the switch between it and the interval before.
  void end(std::size_t i, std::size_t p) {
    const Interval& interval = table.intervals()[i];
    const Regressors& x = table.at(i, taus.node[p]);
    const IntervalSums& s = sums[p];
    Kept& kept = all_kept[p];
    const double amplitude = s.amplitude(x);
    kept.score += amplitude * s.uy;
    kept.information += amplitude * amplitude * x.uu;
    kept.by_noise += x.uu / x.ee;
    kept.squares += s.squares(x);
    const double mean = s.base + s.y / static_cast<double>(interval.count);
    const Decay now{mean - amplitude * x.e_mean, amplitude, frames.t_s[interval.first]};
    const auto at = std::ranges::find(switches, i, [](const SwitchBetween& b) { return b.before + 1; });
    if (i > 0 && at != switches.end()) {
      const double tau_s = table.tau_s(taus.node[p]);
      if (const auto t_s = crossing(kept.last, now, tau_s, at->from_s, at->to_s)) {
        const double weight = std::pow(kept.last.level - now.level, 2);  // squared difference of the curves' slopes
        kept.delay += weight * (*t_s - at->t_s);
        kept.weight += weight;
      }
    }
    kept.last = now;
  }

  void conclude() {
    const double freedom = freedom_of(table.intervals());
    const auto all = [this](float value) { return std::vector<float>(frames.geometry.pixels(), value); };
    constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    taus = {std::move(taus.node), all(kNone), all(kInfinity), all(0.0F), all(kNone)};
    for (const std::size_t p : pixels) {
      const Kept& kept = all_kept[p];
      // Residual at the pixel's own tau, which lies between two nodes.
      const double taken = kept.information > 0.0 ? kept.score * kept.score / kept.information : 0.0;
      const double sigma = std::sqrt(std::max(0.0, kept.squares - taken) / std::max(1.0, freedom));
      taus.sigma[p] = static_cast<float>(sigma);
      const double information = kept.information - sigma * sigma * kept.by_noise;
      taus.score += kept.score;
      taus.score2 += kept.score * kept.score;
      taus.information += information;
      if (!(information > 0.05 * kept.information)) continue;
      const double step = std::clamp(kept.score / information, -kLongestStep, kLongestStep);
      taus.tau_s[p] = static_cast<float>(table.tau_s(taus.node[p]) * std::exp(step));
      taus.error[p] = static_cast<float>(std::max(sigma, 1e-9) / std::sqrt(information));
      if (kept.weight > 0.0) taus.delay_s[p] = static_cast<float>(kept.delay / kept.weight);
    }
  }
};

}  // namespace

DecayTable::DecayTable(const std::vector<double>& t_s, const std::vector<Interval>& intervals, double middle_tau_s)
    : middle_tau_s_(middle_tau_s) {
  for (const Interval& interval : intervals) {
    if (interval.count >= kLeastCount) intervals_.push_back(interval);
  }
  for (const Interval& interval : intervals_) {
    for (int node = 0; node < kNodes; ++node) regressors_.emplace_back(t_s, interval, tau_s(node));
  }
}

double DecayTable::tau_s(int node) const { return middle_tau_s_ * std::exp(kNodeStep * (node - kMiddle)); }

Status pass(const FrameSeries& frames, const DecayTable& table, const std::vector<SwitchBetween>& switches,
            const std::vector<std::int8_t>& follows, PixelTaus& taus, const Progress& progress) {
  return Pass{frames, table, switches, taus, following(follows)}.run(progress);
}

std::vector<std::size_t> following(const std::vector<std::int8_t>& follows) {
  return places_where(follows.size(), [&](std::size_t p) { return follows[p] != 0; });
}

std::vector<std::int8_t> nearest_nodes(const DecayTable& table, const PixelTaus& taus) {
  std::vector<std::int8_t> nodes(taus.tau_s.size(), DecayTable::kMiddle);
  for (std::size_t p = 0; p < nodes.size(); ++p) {
    if (!std::isfinite(taus.tau_s[p])) continue;
    const double away = std::log(taus.tau_s[p] / table.tau_s(DecayTable::kMiddle));
    const double node = std::round(away / DecayTable::kNodeStep) + DecayTable::kMiddle;
    nodes[p] = static_cast<std::int8_t>(std::clamp(node, 0.0, DecayTable::kNodes - 1.0));
  }
  return nodes;
}

}  // namespace bolo::diagnose
