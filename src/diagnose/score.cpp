#include "score.hpp"

#include <cmath>
#include <optional>

namespace bolo::diagnose {
namespace {

// Of one recording, or of all.
double root_mean(const Score& score, std::optional<std::size_t> wanted) {
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t g = 0; g < score.sum.size(); ++g) {
    if (wanted && score.recording[g] != *wanted) continue;
    sum += score.sum[g];
    count += score.count[g];
  }
  return count > 0.0 ? std::sqrt(sum / count) : 1.0;
}

}  // namespace

bool held_out(const Session& session, std::size_t frame, int pixel) {
  const auto width = static_cast<int>(session.grid.columns.size());
  const int block = pixel / width / 4 + pixel % width / 4;
  return ((static_cast<int>(frame) / kCellFrames + block) & 1) != 0;
}

double Score::gap() const { return root_mean(*this, std::nullopt); }

double Score::gap_of(std::size_t wanted) const { return root_mean(*this, wanted); }

Gain gain_of(std::span<const double> parts) {
  Gain gain;
  double squares = 0.0;
  for (const double part : parts) {
    gain.total += part;
    squares += part * part;
  }
  gain.z = squares > 0.0 ? gain.total / std::sqrt(squares) : 0.0;
  return gain;
}

Gain gain_between(const Score& before, const Score& after) {
  std::vector<double> parts(before.sum.size());
  for (std::size_t g = 0; g < parts.size(); ++g) parts[g] = (before.sum[g] - after.sum[g]) / 2.0;
  return gain_of(parts);
}

}  // namespace bolo::diagnose
