#include "tools/lab/detect/boxes.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "src/core/splitmix.hpp"

namespace bolo::tools::detect {
namespace {

// Truth of one class in the order in which it is offered: objects first, then what is ignored, each as given.
struct Offered {
  Box box;
  bool ignored = false;
  bool crowd = false;
};

std::vector<Offered> offered_of(const ImageBoxes& image, int label, const ApSettings& settings) {
  std::vector<Offered> offered;
  for (const Truth& truth : image.truth) {
    if (truth.label != label) continue;
    const double size = area(truth.box);
    const bool fits = size >= settings.least_area_px2 && size <= settings.most_area_px2;
    offered.push_back({truth.box, truth.kind != TruthKind::kObject || !fits, truth.kind == TruthKind::kCrowd});
  }
  std::stable_partition(offered.begin(), offered.end(), [](const Offered& o) { return !o.ignored; });
  return offered;
}

std::vector<Detection> best_detections(const ImageBoxes& image, int label, std::size_t most) {
  std::vector<Detection> found;
  std::ranges::copy_if(image.detections, std::back_inserter(found),
                       [label](const Detection& d) { return d.label == label; });
  std::ranges::stable_sort(found, std::ranges::greater{}, &Detection::score);
  if (found.size() > most) found.resize(most);
  return found;
}

constexpr std::size_t kNothing = std::numeric_limits<std::size_t>::max();

// The truth that a detection takes, of those that are free; a crowd always is.
std::size_t taken_by(const Detection& detection, const std::vector<Offered>& offered, const std::vector<bool>& taken,
                     double least_iou) {
  double best = std::min(least_iou, 1.0 - 1e-10);
  std::size_t choice = kNothing;
  for (std::size_t i = 0; i < offered.size(); ++i) {
    const Offered& one = offered[i];
    if (taken[i] && !one.crowd) continue;
    if (choice != kNothing && !offered[choice].ignored && one.ignored) break;  // an object is better than any of these
    const double overlap = one.crowd ? share_within(detection.box, one.box) : iou(detection.box, one.box);
    if (overlap < best) continue;
    best = overlap;
    choice = i;
  }
  return choice;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return values.empty() ? kNoScore : sum / static_cast<double>(values.size());
}

// Precision over recall, ready to be read at even recalls: points in rising order of recall.
struct Curve {
  std::vector<double> recall;
  std::vector<double> precision;

  double mean(int recall_points) {
    for (std::size_t i = precision.size(); i-- > 1;) precision[i - 1] = std::max(precision[i - 1], precision[i]);
    double sum = 0.0;
    auto at = recall.begin();
    const double step = 1.0 / (recall_points - 1);
    for (int i = 0; i < recall_points; ++i) {
      const double wanted = i + 1 < recall_points ? i * step : 1.0;  // as numpy.linspace has them, to the last bit
      at = std::lower_bound(at, recall.end(), wanted);
      if (at == recall.end()) break;
      sum += precision[static_cast<std::size_t>(at - recall.begin())];
    }
    return sum / recall_points;
  }
};

double quantile(const std::vector<double>& sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(sorted[below], sorted[above], place - static_cast<double>(below));
}

}  // namespace

Evaluator::Evaluator(std::span<const ImageBoxes> images, int labels, ApSettings settings)
    : settings_(std::move(settings)), classes_(static_cast<std::size_t>(labels)) {
  assert(settings_.ious.size() <= 32 && settings_.recall_points >= 2);
  for (int label = 0; label < labels; ++label) {
    for (std::size_t i = 0; i < images.size(); ++i) match(images[i], i, label);
    std::ranges::stable_sort(classes_[static_cast<std::size_t>(label)].ranking, std::ranges::greater{}, &Ranked::score);
  }
}

void Evaluator::match(const ImageBoxes& image, std::size_t index, int label) {
  const std::vector<Offered> offered = offered_of(image, label, settings_);
  const std::vector<Detection> found = best_detections(image, label, settings_.most_detections);
  std::vector<Ranked> ranked;
  ranked.reserve(found.size());
  for (const Detection& detection : found) ranked.push_back({detection.score, index, 0, 0});
  for (std::size_t t = 0; t < settings_.ious.size(); ++t) {
    const std::uint32_t bit = 1U << t;
    std::vector<bool> taken(offered.size(), false);
    for (std::size_t d = 0; d < found.size(); ++d) {
      const std::size_t choice = taken_by(found[d], offered, taken, settings_.ious[t]);
      const double size = area(found[d].box);
      const bool fits = size >= settings_.least_area_px2 && size <= settings_.most_area_px2;
      if (choice != kNothing) taken[choice] = true;
      if (choice == kNothing ? !fits : offered[choice].ignored) ranked[d].ignored |= bit;
      if (choice != kNothing) ranked[d].right |= bit;
    }
  }
  Class& one = classes_[static_cast<std::size_t>(label)];
  one.ranking.insert(one.ranking.end(), ranked.begin(), ranked.end());
  one.objects_a_image.push_back(
      static_cast<int>(std::ranges::count_if(offered, [](const Offered& o) { return !o.ignored; })));
}

ClassScore Evaluator::score_of(const Class& one, std::span<const int> weights) const {
  const auto weight = [&](std::size_t image) { return weights.empty() ? 1.0 : static_cast<double>(weights[image]); };
  ClassScore score;
  for (std::size_t i = 0; i < one.objects_a_image.size(); ++i) score.objects += weight(i) * one.objects_a_image[i];
  if (score.objects <= 0.0) return score;
  std::vector<double> aps;
  for (std::size_t t = 0; t < settings_.ious.size(); ++t) {
    const std::uint32_t bit = 1U << t;
    Curve curve;
    double right = 0.0;
    double wrong = 0.0;
    for (const Ranked& detection : one.ranking) {
      const double counts = weight(detection.image);
      if ((detection.ignored & bit) != 0 || counts <= 0.0) continue;
      ((detection.right & bit) != 0 ? right : wrong) += counts;
      curve.recall.push_back(right / score.objects);
      curve.precision.push_back(right / (right + wrong));
    }
    aps.push_back(curve.mean(settings_.recall_points));
    if (std::abs(settings_.ious[t] - 0.5) < 1e-9) score.ap50 = aps.back();
    if (std::abs(settings_.ious[t] - 0.75) < 1e-9) score.ap75 = aps.back();
  }
  score.ap = mean_of(aps);
  return score;
}

ApScore Evaluator::score(std::span<const int> weights) const {
  ApScore made;
  std::vector<double> ap;
  std::vector<double> ap50;
  std::vector<double> ap75;
  for (const Class& one : classes_) {
    const ClassScore& score = made.classes.emplace_back(score_of(one, weights));
    made.total.objects += score.objects;
    if (score.objects <= 0.0) continue;
    ap.push_back(score.ap);
    ap50.push_back(score.ap50);
    ap75.push_back(score.ap75);
  }
  made.total.ap = mean_of(ap);
  made.total.ap50 = mean_of(ap50);
  made.total.ap75 = mean_of(ap75);
  return made;
}

std::vector<int> drawn_scenes(std::size_t scenes, std::uint64_t seed, std::uint64_t draw) {
  std::vector<int> times(scenes, 0);
  const std::uint64_t key = splitmix::key(seed, draw);
  for (std::size_t i = 0; i < scenes; ++i) {
    const double at = splitmix::unit(splitmix::key(key, i)) * static_cast<double>(scenes);
    ++times[std::min(static_cast<std::size_t>(at), scenes - 1)];
  }
  return times;
}

Interval interval_95(std::vector<double> values) {
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (values.empty()) return {kNone, kNone};
  std::ranges::sort(values);
  constexpr double kTail = 0.025;
  return {quantile(values, kTail), quantile(values, 1.0 - kTail)};
}

}  // namespace bolo::tools::detect
