// The camera's clock runs slow or fast.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class ClockSkew final : public Effect {
 public:
  explicit ClockSkew(const EffectSetup& setup) : skew_(setup.number("skew")) {}
  double shift_s(std::int64_t, double nominal_s) override { return skew_ * nominal_s; }

 private:
  double skew_;
};

}  // namespace

EffectType clock_skew() {
  return {{"clock_skew",
           Stage::kTransport,
           true,
           "the frame period is not the one that t says",
           {{"skew", "", 5e-4, {-0.05, 0.05}, {{-1e-3, -1e-4}, {1e-4, 1e-3}}, "true period / stated - 1"}},
           {}},
          Order::kTransport,
          maker<ClockSkew>()};
}

}  // namespace bolo::sim::effects
