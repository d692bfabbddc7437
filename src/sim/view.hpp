// What reaches the pixels: the field, seen through what lies between.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/sim/field.hpp"

namespace bolo::sim {

// A grid of points spaced a pixel apart: columns column, column + 1 ... of rows row, row + 1 ... The first column may
// lie between two pixels, and all may lie beyond the frame.
struct Patch {
  double column = 0.0;
  int row = 0;
  int width = 0;
  int height = 0;
  std::size_t points() const noexcept { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
};

// A view belongs to one band of rows and keeps its working space.
class View {
 public:
  virtual ~View() = default;
  // The signal at `patch`, row by row, at t. Thread: one at a time.
  virtual void draw(double t_s, const Patch& patch, std::span<float> out) = 0;
  // How many times longer than for the bare field its steps in time may be, as the eye blurs what jumps.
  virtual double patience() const { return 1.0; }
  // This view through a blur, when it is known in closed form; else nullptr. Thread: setup.
  virtual std::unique_ptr<View> blurred(const Blur& /*blur*/) const { return nullptr; }
};

// The bare field. Lends it.
std::unique_ptr<View> bare_view(const Field& field);

// A view that changes each point by itself: change(value, x, y).
template <typename Change>
class PointView final : public View {
 public:
  PointView(std::unique_ptr<View> inner, Change change) : inner_(std::move(inner)), change_(std::move(change)) {}
  void draw(double t_s, const Patch& patch, std::span<float> out) override {
    inner_->draw(t_s, patch, out);
    std::size_t i = 0;
    for (int y = 0; y < patch.height; ++y) {
      for (int x = 0; x < patch.width; ++x, ++i) out[i] = change_(out[i], patch.column + x, patch.row + y);
    }
  }
  double patience() const override { return inner_->patience(); }

 private:
  std::unique_ptr<View> inner_;
  Change change_;
};

template <typename Change>
std::unique_ptr<View> point_view(std::unique_ptr<View> inner, Change change) {
  return std::make_unique<PointView<Change>>(std::move(inner), std::move(change));
}

}  // namespace bolo::sim
