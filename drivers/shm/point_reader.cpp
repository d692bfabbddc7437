#include "drivers/shm/point_reader.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "bolo/deblur/isa.hpp"
#include "bolo/deblur/solver.hpp"
#include "bolo/deblur/window.hpp"
#include "drivers/shm/shm_reader.hpp"

namespace bolo::shm {
namespace {

Result<deblur::Method> method_of(std::uint32_t code) {
  switch (code) {
    case BOLO_METHOD_ADMM:
      return deblur::Method::kAdmm;
    case BOLO_METHOD_DUAL:
      return deblur::Method::kDual;
    case BOLO_METHOD_EXACT:
      return deblur::Method::kExact;
    case BOLO_METHOD_INVERSE:
      return deblur::Method::kInverse;
    case BOLO_METHOD_MMAE:
      return deblur::Method::kMmae;
    default:
      return bad_input("its solver is unknown here: use the same release on both sides");
  }
}

Result<deblur::Settings> settings_of(const bolo_shm_header& header, const bolo_shm_settings& told) {
  const Result<deblur::Method> method = method_of(told.method);
  if (!method) return tl::unexpected<Error>(method.error());
  deblur::Settings s;
  s.method = *method;
  s.tau_s = header.tau_s;
  s.period_s = header.frame_period_s;
  s.window = static_cast<int>(header.window);
  s.lookahead = static_cast<int>(header.lookahead);
  s.levels = static_cast<int>(told.levels);
  s.iterations = static_cast<int>(told.iterations);
  s.kappa = told.kappa;
  s.lambda = told.lambda;
  s.auto_lambda = (told.flags & BOLO_SETTINGS_AUTO_LAMBDA) != 0;
  s.noise_k = told.noise_k;
  if (const Status good = deblur::validate(s); !good) return tl::unexpected<Error>(good.error());
  return s;
}

StreamFormat format_of(const bolo_shm_header& header) {
  StreamFormat format;
  format.geometry = {static_cast<int>(header.width), static_cast<int>(header.height)};
  format.scale = {header.unit == BOLO_UNIT_KELVIN ? Unit::kKelvin : Unit::kCount, header.scale, header.offset};
  format.frame_period_s = header.frame_period_s;
  format.row_step = static_cast<int>(header.row_step);
  return format;
}

// Solvers made while it lives use one instruction set.
class WithIsa {
 public:
  explicit WithIsa(std::string_view isa) : before_(deblur::best_isa()) { deblur::force_isa(isa); }
  ~WithIsa() { deblur::force_isa(before_); }
  WithIsa(const WithIsa&) = delete;
  WithIsa& operator=(const WithIsa&) = delete;

 private:
  std::string_view before_;
};

}  // namespace

struct PointReader::Impl {
  ShmReader reader;
  deblur::Settings settings;
  StreamFormat format;  // of the planes that the solver sees
  model::PixelMaps maps;
  std::string isa;
  std::vector<std::uint32_t> copied;  // pixels of the frame that are copied
  std::vector<std::uint32_t> solved;  // of the copied ones
  bool measured_noise = false;        // the frame's own, told with it
  double solver_noise_k = 0.0;
  std::unique_ptr<deblur::Solver> solver;
  std::vector<std::vector<std::uint16_t>> samples;  // one a frame of the window

  Status make_solver(double noise_k);
  Outcome fill_window(std::uint64_t first, std::uint64_t last, std::uint64_t target, deblur::Window& window,
                      deblur::Window::Ready& ready);
};

Status PointReader::Impl::make_solver(double noise_k) {
  if (Status good = deblur::check_isa(isa); !good) return good;
  const WithIsa same(isa);
  deblur::Settings with_noise = settings;
  with_noise.noise_k = noise_k;
  auto made = deblur::Solver::create(with_noise, format, PixelType::kUint16, maps);
  if (!made) return tl::unexpected<Error>(made.error());
  solver = std::move(*made);
  solver_noise_k = noise_k;
  return {};
}

// Pushes frames as the writer did; where the writer began a new window, frames before it are too old to stand in this
// one, for frame `target` had a full window.
PointReader::Outcome PointReader::Impl::fill_window(std::uint64_t first, std::uint64_t last, std::uint64_t target,
                                                    deblur::Window& window, deblur::Window::Ready& ready) {
  for (std::uint64_t number = first; number <= last; ++number) {
    bolo_shm_slot head{};
    std::vector<std::uint16_t>& plane = samples[number - first];
    if (!reader.read_samples(number, copied, head, plane.data())) return Outcome::kOverwritten;
    const FrameMeta meta{head.frame_id, head.camera_ns, head.receive_ns, head.flags};
    window.push({meta, plane.data(), static_cast<std::uint32_t>(number - first)}, false);
    while (window.next(ready)) {
      if (ready.frame.token == target - first && ready.full) return Outcome::kSolved;
    }
  }
  return Outcome::kWarmUp;
}

Result<PointReader> PointReader::open(const std::string& name, std::vector<std::uint32_t> pixels,
                                      const model::PixelMaps& maps) {
  Result<ShmReader> reader = ShmReader::open(name);
  if (!reader) return tl::unexpected<Error>(reader.error());
  const std::string where = "shared memory '" + name + "'";
  const bolo_shm_header header = reader->header();
  const std::optional<bolo_shm_settings> told = reader->settings();
  if (!told) return bad_input(where + ": its writer does not tell the solver's settings; restart a newer one");
  if ((told->flags & BOLO_SETTINGS_UNDONE) != 0) {
    return bad_input(where + ": its profile changes frames around the solver; read the deblurred planes instead");
  }
  if ((told->flags & BOLO_SETTINGS_MAPS) != 0 && maps.empty()) {
    return bad_input(where + ": its pixels have parameters of their own; give the writer's maps");
  }
  const Result<deblur::Settings> settings = settings_of(header, *told);
  if (!settings) return at(where, settings.error());
  auto impl = std::unique_ptr<Impl>(new Impl{.reader = std::move(*reader),
                                             .settings = *settings,
                                             .format = format_of(header),
                                             .maps = maps,
                                             .isa = told->isa,
                                             .copied = {},
                                             .solved = {},
                                             .solver = nullptr,
                                             .samples = {}});
  const std::size_t all = impl->format.geometry.pixels();
  if (std::any_of(pixels.begin(), pixels.end(), [all](std::uint32_t pixel) { return pixel >= all; })) {
    return bad_input(where + ": a point is not inside the frame of " + std::to_string(header.width) + "x" +
                     std::to_string(header.height));
  }
  if (pixels.empty()) return bad_input(where + ": no points to solve");
  const bool models = settings->auto_lambda || settings->method == deblur::Method::kMmae;
  impl->measured_noise = models && settings->noise_k == 0.0;
  if (models || !maps.empty()) {
    impl->copied.resize(all);
    std::iota(impl->copied.begin(), impl->copied.end(), 0U);
    impl->solved = std::move(pixels);
  } else {
    impl->format.geometry = {static_cast<int>(pixels.size()), 1};
    impl->solved.resize(pixels.size());
    std::iota(impl->solved.begin(), impl->solved.end(), 0U);
    impl->copied = std::move(pixels);
  }
  impl->samples.assign(static_cast<std::size_t>(settings->window) + static_cast<std::size_t>(settings->lookahead),
                       std::vector<std::uint16_t>(impl->copied.size()));
  if (const Status good = impl->make_solver(settings->noise_k); !good) return at(where, good.error());
  return PointReader(std::move(impl));
}

PointReader::Outcome PointReader::solve(std::uint64_t number, std::span<std::uint16_t> out) {
  Impl& self = *impl_;
  const std::uint64_t last = number + static_cast<std::uint64_t>(self.settings.lookahead);
  const auto before = static_cast<std::uint64_t>(self.settings.window - 1);
  if (last >= published()) return Outcome::kNotYet;
  bolo_shm_slot head{};
  if (!self.reader.read_samples(number, {}, head, nullptr)) return Outcome::kOverwritten;
  if ((head.flags & BOLO_FLAG_WARM_UP) != 0) return Outcome::kWarmUp;
  deblur::Window window(self.settings);
  deblur::Window::Ready ready;
  const std::uint64_t first = number > before ? number - before : 0;
  if (const Outcome filled = self.fill_window(first, last, number, window, ready); filled != Outcome::kSolved) {
    return filled;
  }
  // The writer's own noise, so that there is nothing to refuse.
  if (self.measured_noise && head.noise_k != self.solver_noise_k) (void)self.make_solver(head.noise_k);
  self.solver->prepare(ready.view);
  self.solver->solve_points(ready.view, self.solved, out.data());
  return Outcome::kSolved;
}

std::uint64_t PointReader::published() const noexcept { return impl_->reader.published(); }
int PointReader::lookahead() const noexcept { return impl_->settings.lookahead; }

PointReader::PointReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PointReader::PointReader(PointReader&&) noexcept = default;
PointReader& PointReader::operator=(PointReader&&) noexcept = default;
PointReader::~PointReader() = default;

}  // namespace bolo::shm
