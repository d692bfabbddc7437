// Rows are read one after another.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class RowDelay final : public Effect {
 public:
  explicit RowDelay(const EffectSetup& setup) : delay_s_(setup.number("row_delay_s")), halves_(setup.form("halves")) {}
  void configure(CameraModel& model) override {
    const int height = model.geometry.height;
    const int turn = halves_ ? (height + 1) / 2 : height;
    for (int row = 0; row < height; ++row) model.row_delay_s[static_cast<std::size_t>(row)] += delay_s_ * (row % turn);
  }

 private:
  double delay_s_;
  bool halves_;
};

}  // namespace

EffectType row_delay() {
  return {{"row_delay",
           Stage::kReadout,
           true,
           "row r is read r delays after row 0; halves: two halves are read at once",
           {{"row_delay_s", "s", 2.8e-5, {-1e-4, 1e-4}, {{1e-5, 4.1e-5}}, "from one sensor row to the next"}},
           {"rolling", "halves"}},
          Order::kPixel,
          maker<RowDelay>()};
}

}  // namespace bolo::sim::effects
