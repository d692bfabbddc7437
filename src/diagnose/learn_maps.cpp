// Maps of the full frame. The diagnosis itself looks at a grid; a pattern of single pixels cannot be read off that, so
// the captures are read again, some rows at a time.
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include <Eigen/Dense>

#include "src/capture/capture.hpp"
#include "src/diagnose/learn.hpp"
#include "src/diagnose/pixel_maps.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;

constexpr int kPixelsAtOnce = 8192;
constexpr int kTauRounds = 2;

enum Basis : std::size_t { kOffset, kGain, kTau, kDrift };  // in the order of kMapKinds
using Wanted = OfMaps<bool>;

// What was found of every pixel, row-major over the frame: K, share of T - kGainReference, log of tau's share, share
// of the drift; and the variance that noise gives each, summed over the pixels.
struct Found {
  OfMaps<std::vector<double>> value;
  OfMaps<double> noise2{};
  std::vector<std::uint8_t> dead;
  explicit Found(std::size_t pixels) : dead(pixels, 0) {
    for (auto& map : value) map.assign(pixels, 0.0);
  }
};

// Makes a session one of the rows [first, end), with all columns; its values are to be read.
void take_band(Session& band, int first, int end) {
  band.grid = {{}, {}};
  for (int row = first; row < end; ++row) band.grid.rows.push_back(row);
  for (int column = 0; column < band.width; ++column) band.grid.columns.push_back(column);
  band.good.assign(static_cast<std::size_t>(band.grid.pixels()), 1);
  for (Recording& r : band.recordings) r.values.resize(r.frames(), band.grid.pixels());
}

using Readers = std::vector<capture::CaptureReader>;

// One reader for each recording; recordings are in the order of the files, some of which were left out.
Result<Readers> open_all(const Session& session, const std::vector<std::filesystem::path>& files) {
  Readers readers;
  std::size_t next = 0;
  for (const std::filesystem::path& file : files) {
    if (next == session.recordings.size()) break;
    const Recording& wanted = session.recordings[next];
    if (file.filename() != wanted.name) continue;
    auto reader = capture::CaptureReader::open(file);
    if (!reader) continue;
    if (reader->info().frames != wanted.t.size()) continue;
    readers.push_back(std::move(*reader));
    ++next;
  }
  if (next != session.recordings.size()) return failed("the captures changed while they were diagnosed; start again");
  return readers;
}

Status read_band(const capture::CaptureReader& reader, const Session& band, Series& values) {
  const StreamFormat& format = reader.info().format;
  std::vector<std::byte> plane(plane_bytes(format.geometry, format.type));
  const auto* counts = reinterpret_cast<const std::uint16_t*>(plane.data());
  const auto* kelvin = reinterpret_cast<const float*>(plane.data());
  const auto first = static_cast<std::size_t>(band.grid.rows.front()) * static_cast<std::size_t>(band.width);
  for (Index k = 0; k < values.rows(); ++k) {
    if (Status status = reader.read_frame(static_cast<std::size_t>(k), plane.data()); !status) return status;
    for (Index p = 0; p < values.cols(); ++p) {
      const std::size_t i = first + static_cast<std::size_t>(p);
      const double raw =
          format.type == PixelType::kUint16 ? static_cast<double>(counts[i]) : static_cast<double>(kelvin[i]);
      values(k, p) = static_cast<float>(format.scale.to_physical(raw));
    }
  }
  return {};
}

// The first frame of a recording whose offsets are no longer those of its beginning.
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
    if (r.used[static_cast<std::size_t>(k)] == 0) continue;
    for (Index p = 0; p < r.values.cols(); ++p) {
      if (r.values(k, p) >= limit || predicted(k, p) >= limit) continue;
      sums[static_cast<std::size_t>(p)].add(bases, k, p, static_cast<double>(r.values(k, p) - predicted(k, p)));
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
    found.value[b][pixel] += change[static_cast<Index>(b)];
    found.noise2[b] += left * spread(static_cast<Index>(b), static_cast<Index>(b));
  }
}

// The fitted camera without the maps of the grid, which are estimated anew.
State without_maps(State state) {
  state.camera.offset.resize(0);
  state.camera.gain.resize(0);
  state.camera.tau.resize(0);
  state.camera.drift_share.resize(0);
  return state;
}

void solve_band(const LearnTask& task, const Session& band, const Wanted& wanted, int threads, Found& found) {
  const std::size_t begin = static_cast<std::size_t>(band.grid.rows.front()) * static_cast<std::size_t>(band.width);
  const auto pixels = static_cast<std::size_t>(band.grid.pixels());
  State state = without_maps(*task.state);
  for (int round = 0; round < (wanted[kTau] ? kTauRounds : 1); ++round) {
    if (round > 0) {  // the rest is linear and known: only what tau has left
      state.camera.offset = Eigen::VectorXf::Zero(band.grid.pixels());
      state.camera.gain = state.camera.tau = state.camera.drift_share = state.camera.offset;
      for (std::size_t p = 0; p < pixels; ++p) {
        const auto at = static_cast<Index>(p);
        state.camera.offset[at] = static_cast<float>(found.value[kOffset][begin + p]);
        state.camera.gain[at] = static_cast<float>(found.value[kGain][begin + p]);
        state.camera.tau[at] = std::clamp(static_cast<float>(found.value[kTau][begin + p]), -0.3F, 0.3F);
        state.camera.drift_share[at] = static_cast<float>(found.value[kDrift][begin + p]);
        found.value[kTau][begin + p] = static_cast<double>(state.camera.tau[at]);
      }
      if (!wanted[kDrift]) state.camera.drift_share.resize(0);
      found.noise2 = {};
    }
    std::vector<std::vector<PixelSums>> sums(band.recordings.size());
    for_each_index(sums.size(), threads, [&](std::size_t i) {
      if (has_model(band.recordings[i])) sums[i] = sums_of(task, band, i, state, wanted);
    });
    for (std::size_t p = 0; p < pixels; ++p) {
      PixelSums total;
      for (const auto& of : sums) {
        if (!of.empty()) total.add(of[p]);
      }
      if (found.dead[begin + p] == 0) add_solution(total, wanted, begin + p, found);
    }
  }
}

// As on the grid: zero mean, which belongs to the levels or to the camera's one value, and as much of the scatter as
// is not noise.
void centre_and_shrink(std::vector<double>& map, const std::vector<std::uint8_t>& dead, double noise2,
                       bool keep_small) {
  double mean = 0.0;
  double square = 0.0;
  double count = 0.0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (dead[p] != 0) continue;
    mean += map[p];
    square += map[p] * map[p];
    count += 1.0;
  }
  if (count < 1.0) return;
  mean /= count;
  square /= count;
  noise2 /= count;
  if (keep_small && mean * mean < 0.15 * square) mean = 0.0;
  const double variance = std::max(0.0, square - mean * mean);
  const double keep = variance > 0.0 ? std::clamp(1.0 - noise2 / variance, 0.0, 1.0) : 0.0;
  for (std::size_t p = 0; p < map.size(); ++p) map[p] = dead[p] != 0 ? 0.0 : keep * (map[p] - mean);
}

// What the camera adds at each pixel: gain's excess and offset, from the maps and from the shapes that were fitted.
struct Added {
  double gain = 0.0;
  double offset = 0.0;
};
Added added_at(const LearnTask& task, const Found& found, std::size_t pixel) {
  const Session& session = task.session;
  const CameraModel& c = task.state->camera;
  const auto width = static_cast<std::size_t>(session.width);
  const std::size_t row = pixel / width;
  const auto x = static_cast<double>(pixel % width);
  const auto y = static_cast<double>(row);
  const double half_width = (session.width - 1) / 2.0;
  const double half_height = (session.height - 1) / 2.0;
  const double corner = std::max(1.0, half_width * half_width + half_height * half_height);
  const double radius2 = ((x - half_width) * (x - half_width) + (y - half_height) * (y - half_height)) / corner;
  const Recording& last = session.recordings.back();
  const Place place{y / std::max(1.0, session.height - 1.0), x / std::max(1.0, session.width - 1.0),
                    last.start_s + last.t.back()};
  Added added{found.value[kGain][pixel] + c.corner_gain * radius2,
              found.value[kOffset][pixel] + c.corner_offset * radius2 +
                  c.heating_k * (1.0 - std::exp(-c.heating_rate * place.row))};
  for (const CameraModel::Term& term : c.terms) added.offset += term.value * term.unit(place, kGainReference);
  // A package that has drifted stays so: what it had come to at the end of the session.
  if (task.found("drift") != nullptr && !c.drift.empty() && !c.drift_level.empty()) {
    const std::size_t index = session.recordings.size() - 1;
    const double drifted = c.drift_level[index] + drift_at(c, last, index, last.t.back());
    added.offset += (1.0 + found.value[kDrift][pixel]) * drifted;
  }
  return added;
}

void fill(const LearnTask& task, const Found& found, bool tau, model::PixelMaps& maps) {
  const std::size_t pixels = maps.geometry.pixels();
  if (std::ranges::count(found.dead, 1) > 0) maps.dead = found.dead;
  if (task.state == nullptr) return;
  std::vector<float> gain(pixels);
  std::vector<float> offset(pixels);
  bool any_gain = false;
  bool any_offset = false;
  for (std::size_t p = 0; p < pixels; ++p) {
    const Added added = added_at(task, found, p);
    any_gain = any_gain || added.gain != 0.0;
    any_offset = any_offset || added.gain != 0.0 || added.offset != 0.0;
    gain[p] = static_cast<float>(1.0 / (1.0 + std::clamp(added.gain, -0.5, 0.5)));
    offset[p] = gain[p] * static_cast<float>(kGainReference * added.gain - added.offset);
  }
  if (any_gain) maps.gain = std::move(gain);
  if (any_offset) maps.offset = std::move(offset);
  if (!tau) return;
  maps.tau_s.resize(pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    maps.tau_s[p] = static_cast<float>(task.state->camera.response.tau_s * std::exp(found.value[kTau][p]));
  }
}

}  // namespace

Result<model::PixelMaps> learn_maps(const LearnTask& task, const std::vector<std::filesystem::path>& files,
                                    int threads) {
  const Session& session = task.session;
  model::PixelMaps maps;
  maps.geometry = {session.width, session.height};
  maps.row_delay_s = task.profile.row_delay_s;
  if (const FoundEffect* rows = task.found("row_delay")) maps.row_delay_s = rows->parameters.at("row_delay_s").value;
  auto readers = open_all(session, files);
  if (!readers) return tl::unexpected(readers.error());
  const Wanted wanted{task.found("fpn_offset") != nullptr, task.found("fpn_gain") != nullptr,
                      task.found("tau_spread") != nullptr,
                      task.found("drift") != nullptr && task.state != nullptr && !task.state->camera.drift.empty() &&
                          !task.state->camera.drift_level.empty()};
  Found found(maps.geometry.pixels());
  if (task.found("dead_pixels") != nullptr) {
    for (const std::vector<int>* list : {&task.bad.stuck, &task.bad.noisy}) {
      for (const int pixel : *list) found.dead[static_cast<std::size_t>(pixel)] = 1;
    }
  }
  const int rows_at_once = std::max(1, kPixelsAtOnce / session.width);
  OfMaps<double> noise2{};
  Session band = session;
  const bool any = task.state != nullptr && std::ranges::count(wanted, true) != 0;
  for (int row = 0; any && row < session.height; row += rows_at_once) {
    take_band(band, row, std::min(session.height, row + rows_at_once));
    for (std::size_t i = 0; i < readers->size(); ++i) {
      if (Status status = read_band((*readers)[i], band, band.recordings[i].values); !status)
        return tl::unexpected(status.error());
    }
    found.noise2 = {};
    solve_band(task, band, wanted, threads, found);
    for (std::size_t b = 0; b < wanted.size(); ++b) noise2[b] += found.noise2[b];
  }
  for (std::size_t b = 0; b < wanted.size(); ++b) {
    if (wanted[b]) centre_and_shrink(found.value[b], found.dead, noise2[b], b != kOffset);
  }
  fill(task, found, wanted[kTau], maps);
  return maps;
}

}  // namespace bolo::diagnose
