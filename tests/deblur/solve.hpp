// Shared by the solver tests: float streams in kelvin, solved as whole frames or in parts.
#pragma once

#include "src/deblur/isa.hpp"
#include "src/deblur/solver.hpp"
#include "tests/test.hpp"

namespace bolo::deblur::testing {

constexpr StreamFormat kelvin(Geometry geometry, double period_s = 0.005) {
  return {geometry, PixelType::kFloat32, {Unit::kKelvin, 1.0, 0.0}, period_s};
}

inline std::unique_ptr<Solver> make(const Settings& settings, const StreamFormat& format,
                                    PixelType output = PixelType::kFloat32, double row_delay_s = 0.0) {
  return *must(Solver::create(settings, format, output, row_delay_s));
}

template <typename T = float>
std::vector<T> whole_frame(Solver& solver, const WindowView& view, Geometry geometry) {
  std::vector<T> out(geometry.pixels());
  solver.prepare(view);
  solver.solve(view, {0, 0, geometry.width, geometry.height}, out.data());
  return out;
}

// A test on an instruction set.
class OnIsa : public ::testing::TestWithParam<std::string_view> {
 protected:
  void SetUp() override { ASSERT_TRUE(force_isa(GetParam())); }
  void TearDown() override { force_isa(""); }
};

// Pointers to the planes of a window; the planes must not move.
template <typename T>
std::vector<const void*> pointers_to(const std::vector<std::vector<T>>& planes) {
  std::vector<const void*> pointers;
  for (const auto& plane : planes) pointers.push_back(plane.data());
  return pointers;
}

// Parts and points of a prepared window equal the whole frame bit by bit, and nothing else is written.
template <typename T>
void expect_parts(Solver& solver, const WindowView& view, Geometry geometry, const std::vector<T>& whole,
                  std::initializer_list<Region> parts, const std::vector<std::uint32_t>& points) {
  constexpr T kUntouched{1};
  for (const Region& part : parts) {
    std::vector<T> out(geometry.pixels(), kUntouched);
    solver.solve(view, part, out.data());
    for (std::size_t i = 0; i < out.size(); ++i) {
      const int x = static_cast<int>(i) % geometry.width;
      const int y = static_cast<int>(i) / geometry.width;
      const bool inside = x >= part.x && x < part.x + part.width && y >= part.y && y < part.y + part.height;
      ASSERT_EQ(out[i], inside ? whole[i] : kUntouched) << x << ", " << y;
    }
  }
  std::vector<T> out(points.size());
  solver.solve_points(view, points, out.data());
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(out[i], whole[points[i]]) << points[i];
}

}  // namespace bolo::deblur::testing
