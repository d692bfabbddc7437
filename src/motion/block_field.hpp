// Values of blocks of 8 x 8 pixels.
#pragma once

#include <cstddef>
#include <vector>

namespace bolo::motion {

struct Vec2 {
  float x = 0.0F;
  float y = 0.0F;

  constexpr Vec2 operator+(Vec2 o) const { return {x + o.x, y + o.y}; }
  constexpr Vec2 operator-(Vec2 o) const { return {x - o.x, y - o.y}; }
  constexpr Vec2 operator*(float k) const { return {k * x, k * y}; }
};

// Row-major, one value a block.
template <typename T>
class BlockField {
 public:
  BlockField() = default;
  BlockField(int across, int down)
      : across_(across), down_(down), values_(static_cast<std::size_t>(across) * static_cast<std::size_t>(down)) {}

  int across() const noexcept { return across_; }
  int down() const noexcept { return down_; }
  std::size_t size() const noexcept { return values_.size(); }
  T& at(int column, int row) noexcept { return values_[index(column, row)]; }
  const T& at(int column, int row) const noexcept { return values_[index(column, row)]; }
  T* row(int r) noexcept { return values_.data() + index(0, r); }
  const T* row(int r) const noexcept { return values_.data() + index(0, r); }
  auto begin() noexcept { return values_.begin(); }
  auto end() noexcept { return values_.end(); }
  auto begin() const noexcept { return values_.begin(); }
  auto end() const noexcept { return values_.end(); }
  T& operator[](std::size_t i) noexcept { return values_[i]; }
  const T& operator[](std::size_t i) const noexcept { return values_[i]; }

 private:
  std::size_t index(int column, int row) const noexcept {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(across_) + static_cast<std::size_t>(column);
  }

  int across_ = 0;
  int down_ = 0;
  std::vector<T> values_;
};

using VectorField = BlockField<Vec2>;
using ScalarField = BlockField<float>;

// One row of means over 3 x 3 blocks; the border is mirrored (its blocks count twice). Thread: worker.
void mean_of_9(const ScalarField& from, int row, ScalarField& to) noexcept;
// The same with the weights of a Gaussian of 0.6 blocks.
void gauss_of_9(const ScalarField& from, int row, ScalarField& to) noexcept;
// One row of medians of each component over 3 x 3 blocks; the border is repeated.
void median_of_9(const VectorField& from, int row, VectorField& to) noexcept;

}  // namespace bolo::motion
