#include "src/deblur/solver.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <utility>

#include "src/deblur/auto_lambda_solver.hpp"
#include "src/deblur/grid.hpp"
#include "src/deblur/method.hpp"
#include "src/deblur/mmae_solver.hpp"
#include "src/deblur/motion_solver.hpp"

namespace bolo::deblur {
namespace {

constexpr std::size_t kPacked = 256;  // points at a time: their samples fit the first two caches

// The samples of single pixels side by side, a row of floats for each received frame of a window.
class PackedSamples {
 public:
  PackedSamples() noexcept {
    for (std::size_t s = 0; s < planes_.size(); ++s) planes_[s] = values_[s].data();
  }

  void take(const WindowView& window, PixelType type, std::span<const std::uint32_t> pixels) noexcept {
    for (std::size_t s = 0; s < window.planes.size(); ++s) {
      if (window.planes[s] == nullptr) continue;
      type == PixelType::kUint16 ? pick<std::uint16_t>(window.planes[s], pixels, values_[s].data())
                                 : pick<float>(window.planes[s], pixels, values_[s].data());
    }
  }
  const void* const* planes() const noexcept { return planes_.data(); }

 private:
  template <typename T>
  static void pick(const void* plane, std::span<const std::uint32_t> pixels, float* to) noexcept {
    const T* from = static_cast<const T*>(plane);
    for (std::size_t i = 0; i < pixels.size(); ++i) to[i] = static_cast<float>(from[pixels[i]]);
  }

  alignas(64) std::array<std::array<float, kPacked>, kMaxSlots> values_;
  std::array<const void*, kMaxSlots> planes_;
};

// Passes pixels and their samples to a method: parts of the frame and single points.
class PlaneSolver final : public Solver {
 public:
  PlaneSolver(const StreamTask& task, std::unique_ptr<PixelMethod> method)
      : task_(task), grid_(reduce(task.settings, 0.0)), method_(std::move(method)) {}

  void prepare(const WindowView& window, Crew& /*crew*/) noexcept override {
    const Pattern pattern = pattern_of(window);
    if (pattern == pattern_) return;
    pattern_ = pattern;
    method_->prepare(pattern);
  }

  void solve(const WindowView& window, const Region& part, void* out) const noexcept override {
    const auto width = static_cast<std::size_t>(task_.input.geometry.width);
    const bool together = part.x == 0 && part.width == task_.input.geometry.width && !task_.delays_rows();
    const int step = together ? part.height : 1;
    for (int row = part.y; row < part.y + part.height; row += step) {
      const std::size_t first = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(part.x);
      const std::size_t count = static_cast<std::size_t>(step) * static_cast<std::size_t>(part.width);
      PixelRun run = run_into(out, row);
      run.planes = window.planes.data();
      run.begin = first;
      run.end = first + count;
      method_->run(run);
    }
  }

  void solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                    void* out) const noexcept override {
    PackedSamples samples;
    for (std::size_t done = 0; done < pixels.size();) {
      std::span<const std::uint32_t> some = pixels.subspan(done, std::min(kPacked, pixels.size() - done));
      const int row = row_of(some.front());
      if (task_.delays_rows()) {  // the published bins differ from row to row
        const auto other = std::find_if(some.begin(), some.end(), [&](std::uint32_t p) { return row_of(p) != row; });
        some = some.first(static_cast<std::size_t>(other - some.begin()));
      }
      samples.take(window, task_.input.type, some);
      PixelRun run = run_into(static_cast<std::byte*>(out) + done * bytes_of(task_.output), row);
      run.input = PixelType::kFloat32;
      run.whole = task_.input.type == PixelType::kUint16;
      run.planes = samples.planes();
      run.end = some.size();
      method_->run(run);
      done += some.size();
    }
  }

  int iterations() const noexcept override { return method_->iterations(); }
  std::string_view isa() const noexcept override { return method_->isa(); }

 private:
  // A run whose first estimate goes to `out`; pixels of `row`.
  PixelRun run_into(void* out, int row) const noexcept {
    PixelRun run = run_for(task_);
    run.out = out;
    run.delay = task_.row_delay(row);
    run.published = published_bins(grid_, pattern_, run.delay);
    return run;
  }

  int row_of(std::size_t pixel) const noexcept {
    return static_cast<int>(pixel / static_cast<std::size_t>(task_.input.geometry.width));
  }

  StreamTask task_;
  Grid grid_;
  std::unique_ptr<PixelMethod> method_;
  Pattern pattern_;
};

Status validate(const StreamFormat& input) {
  if (input.geometry.width < 1 || input.geometry.height < 1) return bad_input("deblur: the stream's frames are empty");
  const double scale = input.scale.scale;
  if (input.scale.unit == Unit::kKelvin && (!std::isfinite(scale) || scale == 0.0)) {
    return bad_input("deblur: the stream's scale must be a number other than 0 (kelvin a value)");
  }
  return {};
}

Status check_row_delay(const Settings& settings, const StreamFormat& input, double row_delay_s) {
  const double span_s = row_delay_s * input.row_step * (input.geometry.height - 1);
  if (std::isfinite(span_s) && std::abs(span_s) <= (settings.window - 1) * settings.period_s) return {};
  std::ostringstream text;
  text << "row_delay_s is " << row_delay_s << ": reading " << input.geometry.height
       << " rows would take longer than the window of " << settings.window << " frames";
  return bad_input(text.str());
}

}  // namespace

PixelRun run_for(const StreamTask& task) noexcept {
  const bool kelvin = task.output == PixelType::kFloat32 && task.input.scale.unit == Unit::kKelvin;
  PixelRun run;
  run.input = task.input.type;
  run.output = task.output;
  run.scale = kelvin ? static_cast<float>(task.input.scale.scale) : 1.0F;
  run.offset = kelvin ? static_cast<float>(task.input.scale.offset) : 0.0F;
  return run;
}

// Without a prior any input that explains the samples is optimal; the inverse filter is the one that is constant
// between samples. Bins longer than a frame leave no such freedom.
std::unique_ptr<PixelMethod> make_method(const StreamTask& task) {
  const Settings& settings = task.settings;
  const bool no_prior = settings.lambda == 0.0 && (1 << settings.levels) >= settings.window - 1;
  if (settings.method == Method::kInverse || no_prior) return make_inverse(task);
  if (settings.method == Method::kExact) return make_exact(task);
  if (reduce(settings, 1.0).parts > 1) return make_interior(task);
  if (settings.method == Method::kDual) return make_dual(task);
  return make_admm(task);
}

Result<std::unique_ptr<Solver>> Solver::create(const Settings& settings, const StreamFormat& input, PixelType output,
                                               double row_delay_s) {
  if (const Status good = deblur::validate(settings); !good) return tl::unexpected<Error>(good.error());
  if (const Status good = validate(input); !good) return tl::unexpected<Error>(good.error());
  if (const Status good = check_row_delay(settings, input, row_delay_s); !good) {
    return tl::unexpected<Error>(good.error());
  }
  const StreamTask task{settings, input, output, row_delay_s * input.row_step / settings.period_s};
  if (settings.method == Method::kMmae) return std::make_unique<MmaeSolver>(task);
  if (settings.method == Method::kMotion) return std::make_unique<MotionSolver>(task);
  if (settings.auto_lambda && settings.method != Method::kInverse) {
    return std::make_unique<AutoLambdaSolver>(task);
  }
  return std::make_unique<PlaneSolver>(task, make_method(task));
}

}  // namespace bolo::deblur
