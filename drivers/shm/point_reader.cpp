#include "drivers/shm/point_reader.hpp"

#include <algorithm>
#include <mutex>
#include <numeric>
#include <utility>

#include "src/corrections/pixel_correction.hpp"
#include "src/deblur/isa.hpp"
#include "src/deblur/solver.hpp"
#include "src/deblur/window.hpp"

namespace bolo::shm {
namespace {

Result<deblur::Settings> settings_of(const bolo_shm_header& header, const bolo_shm_settings& shared) {
  if (shared.method > BOLO_METHOD_MOTION) {
    return bad_input("its solver is unknown here: use the same release on both sides");
  }
  deblur::Settings s;
  s.method = static_cast<deblur::Method>(shared.method);
  s.tau_s = header.tau_s;
  s.period_s = header.frame_period_s;
  s.window = static_cast<int>(header.window);
  s.lookahead = static_cast<int>(header.lookahead);
  s.levels = static_cast<int>(shared.levels);
  s.iterations = static_cast<int>(shared.iterations);
  s.kappa = shared.kappa;
  s.lambda = shared.lambda;
  s.auto_lambda = (shared.flags & BOLO_SETTINGS_AUTO_LAMBDA) != 0;
  s.noise_k = shared.noise_k;
  RETURN_IF_ERROR(deblur::validate(s));
  return s;
}

// While it lives, new solvers use one instruction set. That choice is global to the process, hence the mutex.
class WithIsa {
 public:
  explicit WithIsa(std::string_view isa) : alone_(mutex()), before_(deblur::best_isa()) { deblur::force_isa(isa); }
  ~WithIsa() { deblur::force_isa(before_); }

 private:
  static std::mutex& mutex() {
    static std::mutex only;
    return only;
  }

  std::lock_guard<std::mutex> alone_;
  std::string_view before_;
};

}  // namespace

struct PointReader::Impl {
  ShmReader reader;
  deblur::Settings settings;
  StreamFormat format;  // of the planes passed to the solver
  double row_delay_s = 0.0;
  std::optional<corrections::PixelCorrection> correction{};  // none: nothing to correct
  std::string isa;
  std::vector<std::uint32_t> copied{};  // pixels copied from the frame
  std::vector<std::uint32_t> solved{};  // indices into `copied`
  bool measured_noise = false;          // per frame, published with it
  double solver_noise_k = 0.0;
  std::unique_ptr<deblur::Solver> solver{};
  std::vector<std::vector<std::uint16_t>> samples{};  // per frame of the window
  std::vector<std::vector<float>> corrected{};        // the samples after the correction
  std::uint64_t frames_before = 0;                    // number of frames read before the target

  // The corrected planes are float32, as the solver's input.
  Status set_correction(const model::PixelMaps& maps) {
    ASSIGN_OR_RETURN(auto made, corrections::PixelCorrection::create(settings, format, maps));
    if (!made.changes_samples()) return {};
    correction = std::move(made);
    format.type = PixelType::kFloat32;
    return {};
  }

  Status make_solver(double noise_k) {
    if (Status good = deblur::check_isa(isa); !good) return good;
    const WithIsa same(isa);
    deblur::Settings with_noise = settings;
    with_noise.noise_k = noise_k;
    ASSIGN_OR_RETURN(solver, deblur::Solver::create(with_noise, format, PixelType::kUint16, row_delay_s));
    solver_noise_k = noise_k;
    return {};
  }

  // A frame's noise, as its writer measured it.
  void follow_noise(double noise_k) {
    if (noise_k == solver_noise_k) return;
    if (!solver->set_noise(noise_k)) (void)make_solver(noise_k);  // the writer's own value cannot be refused
    solver_noise_k = noise_k;
  }

  // Pushes frames in the writer's order. If the writer began a new window, earlier frames are too old to stay in this
  // one, because frame `target` had a full window.
  Outcome fill_window(std::uint64_t first, std::uint64_t last, std::uint64_t target, deblur::Window& window,
                      deblur::Window::Ready& ready) {
    std::uint64_t last_id = 0;
    for (std::uint64_t number = first; number <= last; ++number) {
      bolo_shm_slot head{};
      const std::size_t place = number - first;
      if (!reader.read_samples(number, copied, head, samples[place].data())) return Outcome::kOverwritten;
      const FrameMeta meta = meta_of(head);
      const bool begins = number == first || meta.frame_id <= last_id;
      const void* plane = correction ? corrected_plane(place, begins ? 0 : meta.frame_id - last_id)
                                     : static_cast<const void*>(samples[place].data());
      last_id = meta.frame_id;
      window.push({meta, plane, static_cast<std::uint32_t>(place)}, false);
      while (window.next(ready)) {
        if (ready.frame.token == target - first && ready.full) return Outcome::kSolved;
      }
    }
    return Outcome::kWarmUp;
  }

  const void* corrected_plane(std::size_t place, std::uint64_t periods) {
    std::vector<float>& plane = corrected[place];
    plane.assign(samples[place].begin(), samples[place].end());
    correction->begin(periods);
    correction->apply(plane.data(), {0, plane.size()});
    correction->finish(plane.data());
    return plane.data();
  }
};

Result<PointReader> PointReader::over(ShmReader reader, std::vector<std::uint32_t> pixels,
                                      const model::PixelMaps& maps) {
  const std::string where = "shared memory '" + reader.name() + "'";
  const bolo_shm_header header = reader.header();
  const std::optional<bolo_shm_settings> shared = reader.settings();
  if (!shared) return bad_input(where + ": its writer does not tell the solver's settings; restart a newer one");
  if ((shared->flags & BOLO_SETTINGS_UNDONE) != 0) {
    return bad_input(where + ": its profile changes frames around the solver; read the deblurred planes instead");
  }
  if ((shared->flags & BOLO_SETTINGS_MAPS) != 0 && maps.empty()) {
    return bad_input(where + ": its pixels have parameters of their own; give the writer's maps");
  }
  ASSIGN_OR_RETURN(const deblur::Settings settings, at(where, settings_of(header, *shared)));
  auto impl = std::unique_ptr<Impl>(new Impl{.reader = std::move(reader),
                                             .settings = settings,
                                             .format = format_of(header),
                                             .row_delay_s = maps.row_delay_s,
                                             .isa = shared->isa});
  const std::size_t all = impl->format.geometry.pixels();
  if (std::any_of(pixels.begin(), pixels.end(), [all](std::uint32_t pixel) { return pixel >= all; })) {
    return bad_input(where + ": a point is not inside the frame of " + std::to_string(header.width) + "x" +
                     std::to_string(header.height));
  }
  if (pixels.empty()) return bad_input(where + ": no points to solve");
  const bool models =
      settings.auto_lambda || settings.method == deblur::Method::kMmae || settings.method == deblur::Method::kMotion;
  impl->measured_noise = models && settings.noise_k == 0.0;
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
  if (const Status good = impl->set_correction(maps); !good) return at(where, good.error());
  const auto window = static_cast<std::uint64_t>(settings.window);
  impl->frames_before = window - 1;
  if (!maps.tau_s.empty()) {
    impl->frames_before =
        std::max<std::uint64_t>(window - 1, std::min<std::uint64_t>(2 * window, header.slot_count / 2));
  }
  const std::size_t frames = impl->frames_before + 1 + static_cast<std::size_t>(settings.lookahead);
  impl->samples.assign(frames, std::vector<std::uint16_t>(impl->copied.size()));
  if (impl->correction) impl->corrected.resize(frames);
  if (const Status good = impl->make_solver(settings.noise_k); !good) return at(where, good.error());
  return PointReader(std::move(impl));
}

PointReader::Outcome PointReader::solve(std::uint64_t number, std::span<std::uint16_t> out) {
  Impl& self = *impl_;
  const std::uint64_t last = number + static_cast<std::uint64_t>(self.settings.lookahead);
  if (last >= published()) return Outcome::kNotYet;
  bolo_shm_slot head{};
  std::uint16_t none{};
  if (!self.reader.read_samples(number, {}, head, &none)) return Outcome::kOverwritten;
  if ((head.flags & BOLO_FLAG_WARM_UP) != 0) return Outcome::kWarmUp;
  deblur::Window window(self.settings);
  deblur::Window::Ready ready;
  const std::uint64_t first = number > self.frames_before ? number - self.frames_before : 0;
  if (const Outcome filled = self.fill_window(first, last, number, window, ready); filled != Outcome::kSolved) {
    return filled;
  }
  if (self.measured_noise) self.follow_noise(head.noise_k);
  self.solver->prepare(ready.view);
  self.solver->solve_points(ready.view, self.solved, out.data());
  return Outcome::kSolved;
}

double PointReader::period_s() const noexcept { return impl_->settings.period_s; }
std::uint64_t PointReader::published() const noexcept { return impl_->reader.published(); }
PointReader::PointReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PointReader::PointReader(PointReader&&) noexcept = default;
PointReader& PointReader::operator=(PointReader&&) noexcept = default;
PointReader::~PointReader() = default;

}  // namespace bolo::shm
