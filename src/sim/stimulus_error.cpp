#include "src/sim/stimulus_error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <variant>

#include "src/core/statistics.hpp"
#include "src/core/text.hpp"
#include "src/sim/effect.hpp"

namespace bolo::sim {
namespace {

enum Kind : unsigned { kUniform = 1, kChopper = 2, kBars = 4, kScene = 8, kAll = 15 };

struct Item {
  std::string_view name;
  double StimulusError::*value;
  Range range;
  unsigned kinds;  // applicable stimuli
};

constexpr std::array<Item, 14> kItems{{{"sweep_s", &StimulusError::sweep_s, {-1.0, 1.0}, kChopper},
                                       {"softness_s", &StimulusError::softness_s, {0.0, 1.0}, kChopper},
                                       {"start_s", &StimulusError::start_s, {-100.0, 100.0}, kChopper | kBars},
                                       {"cold_k", &StimulusError::cold_k, {-50.0, 50.0}, kChopper | kBars},
                                       {"level_k", &StimulusError::level_k, {-50.0, 50.0}, kUniform | kChopper | kBars},
                                       {"level2_k", &StimulusError::level2_k, {-50.0, 50.0}, kChopper},
                                       {"velocity", &StimulusError::velocity, {-0.9, 10.0}, kBars},
                                       {"uneven", &StimulusError::uneven, {-0.9, 0.9}, kBars},
                                       {"uneven_period_s", &StimulusError::uneven_period_s, {0.01, 1000.0}, kBars},
                                       {"uneven_phase", &StimulusError::uneven_phase, {-1.0, 1.0}, kBars},
                                       {"phase", &StimulusError::phase, {-1.0, 1.0}, kBars},
                                       {"edge_px", &StimulusError::edge_px, {0.0, 20.0}, kBars},
                                       {"reflection", &StimulusError::reflection, {0.0, 0.9}, kAll},
                                       {"surroundings_k", &StimulusError::surroundings_k, {1.0, 2000.0}, kAll}}};

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

Status take(StimulusError& error, std::string_view item) {
  const std::size_t equals = item.find('=');
  if (equals == std::string_view::npos) return bad_input("'" + std::string(item) + "': expected key=value");
  const std::string_view name = item.substr(0, equals);
  const auto* const found = std::ranges::find(kItems, name, &Item::name);
  if (found == kItems.end()) return bad_input(did_you_mean("key", name, mapped(kItems, &Item::name)));
  const std::optional<double> value = number_of(item.substr(equals + 1));
  if (!value || *value < found->range.low || *value > found->range.high) {
    return bad_input(std::string(item) + ": expected " + shortest(found->range.low) + " to " +
                     shortest(found->range.high));
  }
  error.*found->value = *value;
  return {};
}

// The real field with the stimulus of the nominal one.
class Misdescribed final : public Field {
 public:
  Misdescribed(std::unique_ptr<const Field> nominal, std::unique_ptr<const Field> real, const StimulusError& error)
      : nominal_(std::move(nominal)),
        real_(std::move(real)),
        share_(error.reflection),
        surroundings_k_(error.surroundings_k) {}

  void sample_from(double t_s, double column, int row, std::span<float> out) const noexcept override {
    shown().sample_from(t_s, column, row, out);
    if (share_ == 0.0) return;
    for (float& k : out) k = static_cast<float>(mixed(static_cast<double>(k)));
  }
  void instants(double from_s, double to_s, double response_s, std::vector<double>& out) const override {
    shown().instants(from_s, to_s, response_s, out);
  }
  Extremes extremes() const override {
    const Extremes bare = shown().extremes();
    return {mixed(bare.low_k), mixed(bare.high_k)};
  }
  std::unique_ptr<const Field> blurred(const Blur& blur) const override {
    std::unique_ptr<const Field> bare = shown().blurred(blur);
    if (bare == nullptr) return nullptr;
    StimulusError mix;
    mix.reflection = share_;
    mix.surroundings_k = surroundings_k_;
    return std::make_unique<Misdescribed>(std::move(bare), nullptr, mix);
  }
  capture::Stimulus stimulus(double from_s, double to_s) const override { return nominal_->stimulus(from_s, to_s); }

 private:
  const Field& shown() const noexcept { return real_ != nullptr ? *real_ : *nominal_; }
  double mixed(double kelvin) const noexcept { return (1.0 - share_) * kelvin + share_ * surroundings_k_; }

  std::unique_ptr<const Field> nominal_;
  std::unique_ptr<const Field> real_;  // nullptr: nominal except for the reflection
  double share_;
  double surroundings_k_;
};

unsigned kind_of(const capture::Stimulus& stimulus) {
  if (std::holds_alternative<capture::Uniform>(stimulus)) return kUniform;
  if (std::holds_alternative<capture::Chopper>(stimulus)) return kChopper;
  if (std::holds_alternative<capture::BarTarget>(stimulus)) return kBars;
  return kScene;
}

std::unique_ptr<const Field> real_chopper(capture::Chopper chopper, const StimulusError& error, int width) {
  const double first_k = chopper.level_k.empty() ? 0.0 : chopper.level_k.front();
  const double others_k = std::isnan(error.level2_k) ? error.level_k : error.level2_k;
  for (double& level_k : chopper.level_k) level_k += level_k == first_k ? error.level_k : others_k;
  chopper.cold_k += error.cold_k;
  if (error.sweep_s != 0.0 || error.softness_s != 0.0) return make_swept_chopper(std::move(chopper), error, width);
  for (auto* times : {&chopper.on_s, &chopper.off_s}) {
    for (double& t_s : *times) t_s += error.start_s;
  }
  return make_chopper(std::move(chopper));
}

std::unique_ptr<const Field> real_bars(capture::BarTarget target, const StimulusError& error) {
  target.cold_k += error.cold_k;
  target.hot_k += error.level_k;
  return make_soft_bars(target, error);
}

}  // namespace

Result<StimulusError> parse_stimulus_error(std::string_view text) {
  StimulusError error;
  while (true) {
    const std::size_t comma = text.find(',');
    RETURN_IF_ERROR(take(error, text.substr(0, comma)));
    if (comma == std::string_view::npos) return error;
    text.remove_prefix(comma + 1);
  }
}

std::string stimulus_error_text(const StimulusError& error) {
  const StimulusError none;
  std::string text;
  for (const Item& item : kItems) {
    if (same(error.*item.value, none.*item.value)) continue;
    text += (text.empty() ? "" : ",") + std::string(item.name) + "=" + shortest(error.*item.value);
  }
  return text;
}

Result<std::unique_ptr<const Field>> with_errors(std::unique_ptr<const Field> nominal, const StimulusError& error,
                                                 Geometry view) {
  const StimulusError none;
  const capture::Stimulus stimulus = nominal->stimulus(0.0, 1.0);
  const unsigned kind = kind_of(stimulus);
  for (const Item& item : kItems) {
    if ((item.kinds & kind) == 0 && !same(error.*item.value, none.*item.value)) {
      return bad_input(std::string(item.name) + " has no meaning with this stimulus; leave it out");
    }
  }
  std::unique_ptr<const Field> real;
  if (const auto* uniform = std::get_if<capture::Uniform>(&stimulus)) {
    real = make_uniform(uniform->temperature_k + error.level_k);
  } else if (const auto* chopper = std::get_if<capture::Chopper>(&stimulus)) {
    real = real_chopper(*chopper, error, view.width);
  } else if (const auto* bars = std::get_if<capture::BarTarget>(&stimulus)) {
    real = real_bars(*bars, error);
  }
  return std::make_unique<Misdescribed>(std::move(nominal), std::move(real), error);
}

}  // namespace bolo::sim
