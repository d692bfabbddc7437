// Brings pixels and their samples to a method: parts of the frame and single points.
#pragma once

#include <memory>

#include "src/deblur/method.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::deblur {

class PlaneSolver final : public Solver {
 public:
  PlaneSolver(const StreamTask& task, std::unique_ptr<PixelMethod> method);

  void prepare(const WindowView& window, Crew& crew) noexcept override;
  void solve(const WindowView& window, const Region& part, void* out) const noexcept override;
  void solve_points(const WindowView& window, std::span<const std::uint32_t> pixels, void* out) const noexcept override;
  int iterations() const noexcept override { return method_->iterations(); }
  std::string_view isa() const noexcept override { return method_->isa(); }

 private:
  // A run whose first estimate goes to `out`; pixels of `row`.
  PixelRun run_into(void* out, int row) const noexcept;
  int row_of(std::size_t pixel) const noexcept;

  StreamTask task_;
  Grid grid_;
  std::unique_ptr<PixelMethod> method_;
  Pattern pattern_;
};

}  // namespace bolo::deblur
