// From what was found to the report's figures and its verdict.
#include <algorithm>
#include <cmath>

#include "diagnosis.hpp"
#include "observations.hpp"

namespace bolo::diagnose {
namespace {

double square(double v) { return v * v; }

// What would test the simulator, where nothing does.
std::string needs_of(const Session& session) {
  return std::string(
             "captures of a known stimulus: a closed shutter or a flat black body for noise and offsets, a chopper or "
             "a "
             "pan over bars for the time constant") +
         (session.recordings.front().kelvin ? "" : "; in kelvin, not in counts");
}

}  // namespace

void Diagnosis::conclude() {
  for (const Effect* effect : catalogue()) {
    if (!effect->told_by(session_) && allowed(effect->name)) {
      report_.not_identifiable.push_back({effect->name, effect->needs});
    }
  }
  conclude_noise();
  conclude_gap();
  conclude_verdict();
  observe_rest();
  report_.withheld = options_.withheld;
}

// By how much the noise's variance, and its parts, differ from what is expected.
void Diagnosis::conclude_noise() {
  const double nominal = nominal_noise();
  if (noise_.frames == 0 || nominal <= 0.0) return;
  const auto share = [nominal](double sigma) { return square(sigma / nominal); };
  const double stripes = share(noise_.rows.value) + share(noise_.columns.value);
  report_.noise_gap_before =
      std::sqrt(1.0 + std::abs(share(noise_.total_k) - 1.0) + share(noise_.flicker.value) + stripes);
  double left = 0.0;
  if (!has("flicker")) left += share(noise_.flicker.value);
  if (!has("stripes")) left += stripes;
  const bool spectral =
      has("iir") || has("one_over_f") || has("noise_level") || has("heavy_tail") || has("coarse_quantisation");
  if (!spectral) left += std::abs(share(noise_.sigma_tvh) - 1.0);
  report_.noise_gap_after = std::sqrt(1.0 + left);
  for (FoundEffect& e : report_.effects) {
    if (!e.of_noise) continue;
    e.gap_before = report_.noise_gap_before;
    e.gap_after = report_.noise_gap_after;
  }
  const double explained = std::sqrt(std::max(0.0, square(noise_.total_k) - left * square(nominal)));
  report_.noise = {{"total", "K", noise_.total_k, nominal, explained},
                   {"sigma_tvh (pixel)", "K", noise_.sigma_tvh, nominal, spectral ? noise_.sigma_tvh : nominal},
                   {"sigma_t (frame)", "K", noise_.flicker.value, 0.0, has("flicker") ? noise_.flicker.value : 0.0},
                   {"sigma_tv (row)", "K", noise_.rows.value, 0.0, has("stripes") ? noise_.rows.value : 0.0},
                   {"sigma_th (column)", "K", noise_.columns.value, 0.0, has("stripes") ? noise_.columns.value : 0.0}};
}

bool Diagnosis::testable() const { return std::ranges::any_of(session_.recordings, has_model); }

void Diagnosis::observe_rest() {
  for (const int pixel : bad_.stuck) {
    report_.defects.stuck.push_back(place_of(static_cast<std::size_t>(pixel), session_.width));
  }
  for (const int pixel : bad_.noisy) {
    report_.defects.noisy.push_back(place_of(static_cast<std::size_t>(pixel), session_.width));
  }
  for (const Recording& r : session_.recordings) {
    if (!has_model(r)) report_.observations.push_back(observe(r));
  }
  if (testable()) return;
  report_.verdict = "not_testable";
  report_.needs = needs_of(session_);
  // Nothing was predicted, so that nothing can be said of how well.
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  report_.gap_before = report_.gap_after = report_.closed_fraction = kUnknown;
  if (noise_.frames == 0) report_.noise_gap_before = report_.noise_gap_after = report_.noise_floor_k = kUnknown;
  for (FoundEffect& e : report_.effects) {
    if (!e.of_noise) e.gap_before = e.gap_after = kUnknown;
  }
}

void Diagnosis::conclude_gap() {
  // One figure: what the mean misses and what the noise's own statistics miss, in quadrature.
  const auto both = [this](double mean, double noise) {
    return fitted_ ? std::sqrt(std::max(0.0, mean * mean + noise * noise - 1.0)) : noise;
  };
  report_.gap_before = both(report_.gap_before, report_.noise_gap_before);
  report_.gap_after = both(report_.gap_after, report_.noise_gap_after);
  // The most telling effect first.
  std::ranges::stable_sort(report_.effects, std::greater{}, [](const FoundEffect& e) {
    return std::max(e.gap_before, 1.0) / std::max(e.gap_after, 0.5);
  });
  if (report_.gap_before <= 1.001) return;
  report_.closed_fraction = std::clamp((report_.gap_before - report_.gap_after) / (report_.gap_before - 1.0), 0.0, 1.0);
}

void Diagnosis::conclude_verdict() {
  std::ranges::sort(remainders_, std::greater{}, &Remainder::z);
  const double tests = std::max<double>(1.0, static_cast<double>(remainders_.size()));
  const double worst = remainders_.empty() ? 0.0 : remainders_.front().z;
  report_.unexplained.p_value = std::min(1.0, tests * std::erfc(worst / std::sqrt(2.0)));
  if (worst > kRemainderLimit) {
    const Remainder& first = remainders_.front();
    report_.unexplained.stage = first.misfit ? stage_of_misfits(remainders_) : first.stage;
    report_.unexplained.where = first.where;
    report_.verdict = "unknown_effect";
  } else if (report_.effects.empty()) {
    report_.verdict = "no_gap";
  } else {
    report_.verdict = report_.gap_after > 1.2 ? "partly_explained" : "explained";
  }
  report_.location.stage = report_.effects.empty() ? report_.unexplained.stage : report_.effects.front().stage;
}

}  // namespace bolo::diagnose
