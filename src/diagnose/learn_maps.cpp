// Maps of the full frame. The diagnosis' grid omits most pixels, so the captures are read again, some rows at a time.

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

constexpr int kPixelsAtOnce = 8192;
constexpr int kTauRounds = 2;

enum Basis : std::size_t { kOffset, kGain, kTau, kDrift };  // in the order of kMapKinds
using Wanted = OfMaps<bool>;

// Estimates for every pixel of the frame, row-major: offset in K, gain as a factor of T - the gains' reference, log of
// relative tau, share of the drift; and the noise variance of each kind, summed over the pixels.
struct Found {
  OfMaps<VectorXd> value;
  OfMaps<double> noise2{};
  Mask dead;
  explicit Found(Mask bad) : dead(std::move(bad)) {
    for (VectorXd& map : value) map.setZero(std::ssize(dead));
  }
};

// Restricts a session to the rows [first, end) with all columns; the values have yet to be read.
void take_band(Session& band, int first, int end) {
  band.grid.rows.resize(static_cast<std::size_t>(end - first));
  band.grid.columns.resize(static_cast<std::size_t>(band.width));
  std::iota(band.grid.rows.begin(), band.grid.rows.end(), first);
  std::iota(band.grid.columns.begin(), band.grid.columns.end(), 0);
  band.good.assign(static_cast<std::size_t>(band.grid.pixels()), 1);
  for (Recording& r : band.recordings) r.values.resize(r.frames(), band.grid.pixels());
}

std::size_t first_pixel(const Session& band) {
  return static_cast<std::size_t>(band.grid.rows.front()) * static_cast<std::size_t>(band.width);
}

Result<std::vector<FrameReader>> open_all(const Session& session) {
  std::vector<FrameReader> readers;
  for (const Recording& recording : session.recordings) {
    ASSIGN_OR_RETURN(auto reader, open_again(recording, session.known));
    readers.push_back(std::move(reader));
  }
  return readers;
}

Status read_band(FrameReader& reader, const Session& band, Series& values) {
  for (Index k = 0; k < values.rows(); ++k) {
    const std::span<float> row(values.row(k).data(), static_cast<std::size_t>(values.cols()));
    RETURN_IF_ERROR(reader.read(static_cast<std::size_t>(k), first_pixel(band), row));
  }
  return {};
}

// The first frame of a recording after a jump of its offsets.
Index changed_at(const LearnTask& task, std::size_t recording) {
  Index first = task.session.recordings[recording].frames();
  for (const Jump& jump : task.jumps) {
    if (jump.recording == recording) first = std::min(first, static_cast<Index>(jump.frame));
  }
  return first;
}

std::vector<PixelSums> sums_of(const LearnTask& task, const Session& band, std::size_t i, const State& state,
                               const Wanted& wanted) {
  const std::vector<int> pixels = band.grid.all();
  std::vector<PixelSums> sums(pixels.size());
  const Recording& r = band.recordings[i];
  const Series predicted = predict(band, i, state, pixels);
  const OfMaps<Series> bases = bases_of(band, i, state, wanted, pixels);
  const Index end = changed_at(task, i);
  const auto limit = static_cast<float>(state.camera.clip_k - 1.0);
  for (Index k = 0; k < end; ++k) {
    if (!r.is_used(k)) continue;
    for (Index p = 0; p < r.values.cols(); ++p) {
      if (r.values(k, p) >= limit || predicted(k, p) >= limit) continue;
      sums[static_cast<std::size_t>(p)].add(bases, k, p, r.values(k, p) - predicted(k, p));
    }
  }
  return sums;
}

void add_solution(const PixelSums& total, const Wanted& wanted, std::size_t pixel, Found& found) {
  const Eigen::Matrix4d spread = total.spread(wanted);
  const Eigen::Vector4d change = spread * total.right;
  const double left = std::max(0.0, total.squares - change.dot(total.right)) / std::max(1.0, total.count - 4.0);
  for (std::size_t b = 0; b < wanted.size(); ++b) {
    if (!wanted[b]) continue;
    found.value[b][static_cast<Index>(pixel)] += change[static_cast<Index>(b)];
    found.noise2[b] += left * spread(static_cast<Index>(b), static_cast<Index>(b));
  }
}

// Applies the maps of the first round to the camera: all but tau are linear and thus final.
void apply(Found& found, const Wanted& wanted, Index begin, Index pixels, CameraModel& camera) {
  for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
    auto values = found.value[b].segment(begin, pixels);
    if (b == kTau) values = values.cast<float>().cwiseMax(-0.3F).cwiseMin(0.3F).cast<double>();
    map_of(camera, kMapKinds[b]) = values.cast<float>();
  }
  if (!wanted[kDrift]) camera.drift_share.resize(0);
  found.noise2 = {};
}

void solve_band(const LearnTask& task, const Session& band, const Wanted& wanted, int threads, Found& found) {
  const std::size_t begin = first_pixel(band);
  const auto pixels = static_cast<std::size_t>(band.grid.pixels());
  State state = *task.state;  // the maps of the grid are estimated anew
  for (const MapKind kind : kMapKinds) map_of(state.camera, kind).resize(0);
  for (int round = 0; round < (wanted[kTau] ? kTauRounds : 1); ++round) {
    if (round > 0) apply(found, wanted, static_cast<Index>(begin), static_cast<Index>(pixels), state.camera);
    const std::vector<PixelSums> total =
        sum_pixels(band, pixels, threads, [&](std::size_t i) { return sums_of(task, band, i, state, wanted); });
    for (std::size_t p = 0; p < pixels; ++p) {
      if (found.dead[begin + p] == 0) add_solution(total[p], wanted, begin + p, found);
    }
  }
}

// The camera's gain excess and offset at a pixel.
struct Added {
  double gain = 0.0;
  double offset = 0.0;
};

// From a moving scene in which patterns were found. A pattern includes the effect of the gains at the scene's level.
Added told_at(const LearnTask& task, std::size_t pixel) {
  const bool gains = task.found("fpn_gain") != nullptr;
  if (task.field.offset.size() == 0 || !(gains || task.found("fpn_offset") != nullptr)) return {};
  const auto p = static_cast<Index>(pixel);
  const double gain = gains ? task.field.gain[p] : 0.0F;
  return {gain, task.field.offset[p] - gain * task.field.level[p]};
}

// From the fitted maps and shapes.
Added added_at(const LearnTask& task, const Found& found, std::size_t pixel) {
  const Session& session = task.session;
  const CameraModel& c = task.state->camera;
  const Recording& last = session.recordings.back();
  const PixelPlace at = place_of(pixel, session.width);
  const Place place = place_in(session, at.y, at.x);
  const auto value = [&](Basis map) { return found.value[map][static_cast<Index>(pixel)]; };
  const double own = value(kGain);
  const double corner = corner_gain_at(session, c, at.y, at.x);
  Added added{own + corner,
              value(kOffset) - own * c.gain_reference_k - corner * c.corner_reference_k + heating_at(c, place.row)};
  for (const CameraModel::Term& term : c.terms) added.offset += term.value * term.unit(place, kReference);
  // A package's drift is permanent: its value at the end of the session is used.
  if (task.found("drift") != nullptr && !c.drift.empty() && !c.drift_level.empty()) {
    const std::size_t index = session.recordings.size() - 1;
    const double drifted = c.drift_level[index] + drift_at(c, last, index, last.t.back());
    added.offset += (1.0 + value(kDrift)) * drifted;
  }
  return added;
}

void fill(const LearnTask& task, const Found& found, bool tau, model::PixelMaps& maps) {
  const std::size_t pixels = maps.geometry.pixels();
  if (std::ranges::count(found.dead, 1) > 0) maps.dead = found.dead;
  std::vector<float> gain(pixels);
  std::vector<float> offset(pixels);
  bool any_gain = false;
  bool any_offset = false;
  for (std::size_t p = 0; p < pixels; ++p) {
    const Added added = task.state == nullptr ? told_at(task, p) : added_at(task, found, p);
    any_gain = any_gain || added.gain != 0.0;
    any_offset = any_offset || added.gain != 0.0 || added.offset != 0.0;
    gain[p] = static_cast<float>(1.0 / (1.0 + std::clamp(added.gain, -0.5, 0.5)));
    offset[p] = gain[p] * static_cast<float>(-added.offset);
  }
  if (any_gain) maps.gain = std::move(gain);
  if (any_offset) maps.offset = std::move(offset);
  for (std::size_t p = 0; tau && p < pixels; ++p) {
    maps.tau_s.push_back(
        static_cast<float>(task.state->camera.response.tau_s * std::exp(found.value[kTau][static_cast<Index>(p)])));
  }
}

}  // namespace

Result<model::PixelMaps> learn_maps(const LearnTask& task, int threads) {
  const Session& session = task.session;
  model::PixelMaps maps;
  maps.geometry = {session.width, session.height};
  ASSIGN_OR_RETURN(auto readers, open_all(session));
  const Wanted wanted{task.found("fpn_offset") != nullptr, task.found("fpn_gain") != nullptr,
                      task.found("tau_spread") != nullptr,
                      task.found("drift") != nullptr && task.state != nullptr && !task.state->camera.drift.empty() &&
                          !task.state->camera.drift_level.empty()};
  Found found((task.found("dead_pixels") != nullptr ? task.bad : BadPixels{}).dead(session));
  const int rows_at_once = std::max(1, kPixelsAtOnce / session.width);
  OfMaps<double> noise2{};
  Session band = session;
  const bool any = task.state != nullptr && std::ranges::count(wanted, true) != 0;
  for (int row = 0; any && row < session.height; row += rows_at_once) {
    take_band(band, row, std::min(session.height, row + rows_at_once));
    for (std::size_t i = 0; i < readers.size(); ++i) {
      RETURN_IF_ERROR(read_band(readers[i], band, band.recordings[i].values));
    }
    found.noise2 = {};
    solve_band(task, band, wanted, threads, found);
    for (std::size_t b = 0; b < wanted.size(); ++b) noise2[b] += found.noise2[b];
  }
  const auto alive = places_where<int>(found.dead.size(), [&](std::size_t p) { return found.dead[p] == 0; });
  for (std::size_t b = 0; b < wanted.size() && !alive.empty(); ++b) {
    if (wanted[b])
      centre_and_shrink(found.value[b], alive, noise2[b] / static_cast<double>(alive.size()), kMapKinds[b]);
  }
  fill(task, found, wanted[kTau], maps);
  return maps;
}

}  // namespace bolo::diagnose
