#include "tools/lab/detect/boxes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>

#include "src/core/splitmix.hpp"
#include "src/core/statistics.hpp"
#include "src/core/text.hpp"

namespace bolo::tools::detect {
namespace {

struct Line {
  int number = 0;
  Box share;
};

// Exactly five numbers: an integer, then a box that lies within the picture, or nearly so.
std::optional<Line> parse_line(const std::string& text) {
  std::istringstream in(text);
  Line line;
  double cx = 0.0;
  double cy = 0.0;
  std::string rest;
  if (!(in >> line.number >> cx >> cy >> line.share.width >> line.share.height) || (in >> rest)) return std::nullopt;
  constexpr double kRounding = 0.01;
  for (const double value : {cx, cy, line.share.width, line.share.height}) {
    if (!std::isfinite(value) || value < 0.0 || value > 1.0 + kRounding) return std::nullopt;
  }
  if (line.number < 0 || line.share.width <= 0.0 || line.share.height <= 0.0) return std::nullopt;
  line.share.x = cx - line.share.width / 2.0;
  line.share.y = cy - line.share.height / 2.0;
  return line;
}

Box in_pixels(const Box& share, Geometry picture) {
  return {share.x * picture.width, share.y * picture.height, share.width * picture.width,
          share.height * picture.height};
}

// Truth of one class in matching order: objects first, then ignored boxes, each in the given order.
struct Offered {
  Box box;
  bool ignored = false;
  bool crowd = false;
};

std::vector<Offered> offered_of(const ImageBoxes& image, int label) {
  std::vector<Offered> offered;
  for (const Truth& truth : image.truth) {
    if (truth.label != label) continue;
    offered.push_back({truth.box, truth.kind != TruthKind::kObject, truth.kind == TruthKind::kCrowd});
  }
  std::stable_partition(offered.begin(), offered.end(), [](const Offered& o) { return !o.ignored; });
  return offered;
}

std::vector<Detection> best_detections(const ImageBoxes& image, int label) {
  constexpr std::size_t kMost = 100;
  std::vector<Detection> found;
  std::ranges::copy_if(image.detections, std::back_inserter(found),
                       [label](const Detection& d) { return d.label == label; });
  std::ranges::stable_sort(found, std::ranges::greater{}, &Detection::score);
  if (found.size() > kMost) found.resize(kMost);
  return found;
}

constexpr std::array kIous{0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95};
constexpr int kRecallPoints = 101;  // from 0 to 1
constexpr std::size_t kNothing = std::numeric_limits<std::size_t>::max();

// The free truth that a detection matches; a crowd is always free.
std::size_t taken_by(const Detection& detection, const std::vector<Offered>& offered, const std::vector<bool>& taken,
                     double least_iou) {
  double best = std::min(least_iou, 1.0 - 1e-10);
  std::size_t choice = kNothing;
  for (std::size_t i = 0; i < offered.size(); ++i) {
    const Offered& one = offered[i];
    if (taken[i] && !one.crowd) continue;
    if (choice != kNothing && !offered[choice].ignored && one.ignored) break;  // any object beats all ignored boxes
    const double overlap = one.crowd ? share_within(detection.box, one.box) : iou(detection.box, one.box);
    if (overlap < best) continue;
    best = overlap;
    choice = i;
  }
  return choice;
}

double mean_of(const std::vector<double>& values) {
  return values.empty() ? kNoScore : sum_of(values) / static_cast<double>(values.size());
}

// Precision over recall, in rising order of recall, to be sampled at even recalls.
struct Curve {
  std::vector<double> recall;
  std::vector<double> precision;

  double mean() {
    for (std::size_t i = precision.size(); i-- > 1;) precision[i - 1] = std::max(precision[i - 1], precision[i]);
    double sum = 0.0;
    auto at = recall.begin();
    const double step = 1.0 / (kRecallPoints - 1);
    for (int i = 0; i < kRecallPoints; ++i) {
      const double wanted = i + 1 < kRecallPoints ? i * step : 1.0;  // bit-identical to numpy.linspace
      at = std::lower_bound(at, recall.end(), wanted);
      if (at == recall.end()) break;
      sum += precision[static_cast<std::size_t>(at - recall.begin())];
    }
    return sum / kRecallPoints;
  }
};

double quantile(const std::vector<double>& sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(sorted[below], sorted[above], place - static_cast<double>(below));
}

}  // namespace

double area(const Box& box) { return box.width * box.height; }

double intersection(const Box& a, const Box& b) {
  const double width = std::min(a.x + a.width, b.x + b.width) - std::max(a.x, b.x);
  const double height = std::min(a.y + a.height, b.y + b.height) - std::max(a.y, b.y);
  return width > 0.0 && height > 0.0 ? width * height : 0.0;
}

double iou(const Box& a, const Box& b) {
  const double common = intersection(a, b);
  return common > 0.0 ? common / (area(a) + area(b) - common) : 0.0;
}

double share_within(const Box& box, const Box& other) {
  const double common = intersection(box, other);
  return common > 0.0 ? common / area(box) : 0.0;
}

Box clipped(const Box& box, double width, double height) {
  const double left = std::clamp(box.x, 0.0, width);
  const double top = std::clamp(box.y, 0.0, height);
  const double right = std::clamp(box.x + box.width, left, width);
  const double bottom = std::clamp(box.y + box.height, top, height);
  return {left, top, right - left, bottom - top};
}

Box moved(const Box& box, double dx, double dy) { return {box.x + dx, box.y + dy, box.width, box.height}; }

std::vector<std::string> split_names(const std::string& text) {
  std::vector<std::string> names;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, ',');) {
    if (const std::string_view name = trimmed(part); !name.empty()) names.emplace_back(name);
  }
  return names;
}

Result<std::vector<Truth>> read_labels(const std::filesystem::path& file, Geometry picture,
                                       const std::vector<JudgedClass>& classes) {
  std::ifstream in(file);
  if (!in) return bad_input(file.string() + ": cannot be opened; give a readable label file");
  std::vector<Truth> truth;
  std::string text;
  for (int number = 1; std::getline(in, text); ++number) {
    if (trimmed(text).empty()) continue;
    const auto line = parse_line(text);
    if (!line) {
      return bad_input(file.string() + ":" + std::to_string(number) +
                       ": expected 'class cx cy w h', a number and four shares of the picture from 0 to 1");
    }
    const auto judged = std::ranges::find(classes, line->number, &JudgedClass::number);
    if (judged == classes.end()) continue;
    truth.push_back({static_cast<int>(judged - classes.begin()), in_pixels(line->share, picture)});
  }
  return truth;
}

Result<std::vector<std::string>> read_names(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) return bad_input(file.string() + ": cannot be opened; give a file with one class name a line");
  std::vector<std::string> names;
  for (std::string line; std::getline(in, line);) names.emplace_back(trimmed(line));
  while (!names.empty() && names.back().empty()) names.pop_back();
  if (names.empty()) return bad_input(file.string() + ": has no class names; give one a line");
  return names;
}

std::vector<Truth> truth_in_view(const std::vector<Truth>& labels, int classes, Geometry still, Geometry view,
                                 sim::Position at) {
  std::vector<Truth> seen;
  for (Truth truth : labels) {
    const Box whole = moved(truth.box, -at.x_px, -at.y_px);
    truth.box = clipped(whole, view.width, view.height);
    if (area(truth.box) <= 0.0) continue;
    if (truth.kind == TruthKind::kObject && area(truth.box) < kLeastVisible * area(whole)) {
      truth.kind = TruthKind::kIgnored;
    }
    seen.push_back(truth);
  }
  // The still's place in the view, and the four bands around it.
  const Box inside = clipped({-at.x_px, -at.y_px, static_cast<double>(still.width), static_cast<double>(still.height)},
                             view.width, view.height);
  const double width = view.width;
  const double height = view.height;
  const double right = inside.x + inside.width;
  const double bottom = inside.y + inside.height;
  const std::array<Box, 4> bands{Box{0.0, 0.0, inside.x, height}, Box{right, 0.0, width - right, height},
                                 Box{0.0, 0.0, width, inside.y}, Box{0.0, bottom, width, height - bottom}};
  for (const Box& band : bands) {
    if (area(band) <= 0.0) continue;
    for (int label = 0; label < classes; ++label) seen.push_back({label, band, TruthKind::kCrowd});
  }
  return seen;
}

Evaluator::Evaluator(std::span<const ImageBoxes> images, int labels) : classes_(static_cast<std::size_t>(labels)) {
  for (int label = 0; label < labels; ++label) {
    for (std::size_t i = 0; i < images.size(); ++i) match(images[i], i, label);
    std::ranges::stable_sort(classes_[static_cast<std::size_t>(label)].ranking, std::ranges::greater{}, &Ranked::score);
  }
}

void Evaluator::match(const ImageBoxes& image, std::size_t index, int label) {
  const std::vector<Offered> offered = offered_of(image, label);
  const std::vector<Detection> found = best_detections(image, label);
  std::vector<Ranked> ranked;
  ranked.reserve(found.size());
  for (const Detection& detection : found) ranked.push_back({detection.score, index, 0, 0});
  for (std::size_t t = 0; t < kIous.size(); ++t) {
    const std::uint32_t bit = 1U << t;
    std::vector<bool> taken(offered.size(), false);
    for (std::size_t d = 0; d < found.size(); ++d) {
      const std::size_t choice = taken_by(found[d], offered, taken, kIous[t]);
      if (choice == kNothing) continue;
      taken[choice] = true;
      ranked[d].right |= bit;
      if (offered[choice].ignored) ranked[d].ignored |= bit;
    }
  }
  Class& one = classes_[static_cast<std::size_t>(label)];
  one.ranking.insert(one.ranking.end(), ranked.begin(), ranked.end());
  one.objects_a_image.push_back(
      static_cast<int>(std::ranges::count_if(offered, [](const Offered& o) { return !o.ignored; })));
}

ApScore Evaluator::score_of(const Class& one, std::span<const int> weights) const {
  const auto weight = [&](std::size_t image) { return weights.empty() ? 1.0 : static_cast<double>(weights[image]); };
  ApScore score;
  for (std::size_t i = 0; i < one.objects_a_image.size(); ++i) score.objects += weight(i) * one.objects_a_image[i];
  if (score.objects <= 0.0) return score;
  std::vector<double> aps;
  for (std::size_t t = 0; t < kIous.size(); ++t) {
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
    aps.push_back(curve.mean());
  }
  score.ap = mean_of(aps);
  return score;
}

ApScore Evaluator::score(std::span<const int> weights) const {
  ApScore total;
  std::vector<double> aps;
  for (const Class& one : classes_) {
    const ApScore score = score_of(one, weights);
    total.objects += score.objects;
    if (score.objects > 0.0) aps.push_back(score.ap);
  }
  total.ap = mean_of(aps);
  return total;
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
