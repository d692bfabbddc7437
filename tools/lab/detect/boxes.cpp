#include "tools/lab/detect/boxes.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>

#include "src/core/parse_text.hpp"

namespace bolo::tools::detect {
namespace {

struct Line {
  int number = 0;
  Box share;
};

// Exactly five numbers: a whole one, then a box that lies within the picture, or nearly so.
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

Result<std::vector<JudgedClass>> classes_of(const std::string& text) {
  std::vector<JudgedClass> classes;
  for (const std::string& part : split_names(text)) {
    JudgedClass one;
    const char* const end = part.data() + part.size();
    const auto [colon, error] = std::from_chars(part.data(), end, one.number);
    if (error == std::errc() && colon != end && *colon == ':') one.name = trimmed({colon + 1, end});
    if (one.name.empty() || one.number < 0) {
      return bad_input("classes '" + text + "': expected NUMBER:NAME with commas between, as in 1:person,3:car");
    }
    const auto same = [&](const JudgedClass& other) { return other.name == one.name || other.number == one.number; };
    if (std::ranges::any_of(classes, same)) {
      return bad_input(
          std::string("classes '").append(text).append("': '").append(part).append("' repeats a number or a name"));
    }
    classes.push_back(std::move(one));
  }
  if (classes.empty()) return bad_input("classes: none given; as in 1:person,3:car");
  return classes;
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

}  // namespace bolo::tools::detect
