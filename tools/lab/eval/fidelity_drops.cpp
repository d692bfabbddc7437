#include "tools/lab/eval/fidelity_drops.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "src/deblur/window.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kDefaultLambda = deblur::Settings{}.lambda;

double mean_squared_error(const Plane& a, const Plane& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = static_cast<double>(a[i]) - static_cast<double>(b[i]);
    sum += d * d;
  }
  return sum / static_cast<double>(a.size());
}

// Solves a stream as the pipeline does. `numbers` are the frames that arrive; with `closed_up` their counters and times
// hide what was lost. Mean squared error of each frame, K^2; NaN where there is no full window.
Result<std::vector<double>> stream_errors(const Sequence& s, const deblur::Settings& settings,
                                          const std::vector<std::size_t>& numbers, bool closed_up) {
  const auto solver = make_solver(s, settings);
  if (!solver) return tl::unexpected(solver.error());
  const CleanSequence& clean = *s.clean;
  deblur::Window window(settings);
  deblur::Window::Ready ready;
  Plane whole(clean.geometry.pixels());
  std::vector<double> errors(s.frames.size(), kNone);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::size_t place = closed_up ? i : numbers[i];
    deblur::WindowFrame frame;
    frame.meta.frame_id = place;
    frame.meta.camera_ns = std::llround(static_cast<double>(place) * kPeriodS * 1e9);
    frame.plane = s.frames[numbers[i]].data();
    frame.token = static_cast<std::uint32_t>(numbers[i]);
    window.push(frame, false);
    while (window.next(ready)) {
      if (!ready.full) continue;
      (*solver)->prepare(ready.view);
      (*solver)->solve(ready.view, clean.judged, whole.data());
      errors[ready.frame.token] =
          mean_squared_error(cut(whole, clean.geometry, clean.judged), clean.truth[ready.frame.token]);
    }
  }
  return errors;
}

// Root of the mean over frames.
struct Sums {
  std::array<double, 3> sum{};
  int frames = 0;

  void add(const std::array<double, 3>& errors) {
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += errors[i];
    ++frames;
  }
  DropErrors errors() const {
    const auto rms = [this](std::size_t i) { return frames > 0 ? std::sqrt(sum[i] / frames) : kNone; };
    return {rms(0), rms(1), rms(2), frames};
  }
};

bool near_loss(const std::vector<bool>& lost, std::size_t k) {
  const std::size_t from = k > kNearLoss ? k - kNearLoss : 0;
  for (std::size_t i = from; i <= std::min(k + kNearLoss, lost.size() - 1); ++i) {
    if (lost[i]) return true;
  }
  return false;
}

Status fill(const Sequence& s, const deblur::Settings& settings, const std::vector<bool>& lost, DropRow& row) {
  std::vector<std::size_t> all(s.frames.size());
  std::iota(all.begin(), all.end(), 0U);
  std::vector<std::size_t> arrived;
  std::ranges::copy_if(all, std::back_inserter(arrived), [&](std::size_t k) { return !lost[k]; });
  const std::array streams{stream_errors(s, settings, all, false), stream_errors(s, settings, arrived, false),
                           stream_errors(s, settings, arrived, true)};
  for (const auto& stream : streams) {
    if (!stream) return tl::unexpected(stream.error());
  }
  Sums every;
  Sums near;
  for (std::size_t k = kLeadIn; k < all.size(); ++k) {
    const std::array errors{(*streams[0])[k], (*streams[1])[k], (*streams[2])[k]};
    if (std::ranges::any_of(errors, [](double e) { return std::isnan(e); })) continue;
    every.add(errors);
    if (near_loss(lost, k)) near.add(errors);
  }
  row.all = every.errors();
  row.near = near.errors();
  row.frames_lost = static_cast<int>(std::ranges::count(lost, true));
  return {};
}

}  // namespace

std::vector<bool> losses(std::size_t frames, double share, std::uint64_t seed) {
  constexpr std::size_t kTail = 2;
  std::vector<bool> lost(frames, false);
  if (frames <= kLeadIn + kTail) return lost;
  const std::size_t places = frames - kLeadIn - kTail;
  const auto wanted =
      std::max<std::size_t>(1, static_cast<std::size_t>(std::llround(share * static_cast<double>(places))));
  // The generator's own numbers, not a distribution: these are the same with every standard library.
  std::mt19937_64 random(seed);
  for (std::size_t count = 0; count < wanted;) {
    const std::size_t place = kLeadIn + static_cast<std::size_t>(random() % places);
    count += lost[place] ? 0U : 1U;
    lost[place] = true;
  }
  return lost;
}

Result<std::vector<DropRow>> drop_rows(const Sequence& s, int lookahead, double share, std::uint64_t seed) {
  const std::vector<bool> lost = losses(s.frames.size(), share, seed);
  using deblur::Method;
  const std::vector<std::pair<std::string, Result<deblur::Settings>>> methods{
      {"admm", settings_of(Method::kAdmm, lookahead, kDefaultLambda)},
      {"inverse", settings_of(Method::kInverse, lookahead)},
      {"auto", live_settings(ColumnKind::kAuto, s, lookahead)},
      {"mmae", live_settings(ColumnKind::kMmae, s, lookahead)}};
  std::vector<DropRow> rows;
  for (const auto& [name, settings] : methods) {
    DropRow row{s.clean->task.scene, s.clean->task.motion, s.noise_k, lookahead, name, "", 0, {}, {}};
    if (!settings) {
      row.skipped = settings.error().message;
    } else if (const Status filled = fill(s, *settings, lost, row); !filled) {
      row.skipped = filled.error().message;
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace bolo::tools::fidelity
