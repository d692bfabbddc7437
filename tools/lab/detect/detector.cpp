#include "tools/lab/detect/detector.hpp"

#include <algorithm>
#include <array>
#include <system_error>

#include "src/core/statistics.hpp"
#include "src/model/strict_toml.hpp"
#include "tools/lab/common.hpp"

namespace bolo::tools::detect {
namespace {

// A tensor as rows: its last dimension is the row's length; leading dimensions of 1 are ignored.
struct Rows {
  std::size_t rows = 0;
  std::size_t length = 0;
  const float* first = nullptr;

  std::span<const float> row(std::size_t i) const { return {first + i * length, length}; }
};

Rows rows_of(const Tensor& tensor) {
  if (tensor.shape.empty() || tensor.shape.back() < 1) return {};
  const auto length = static_cast<std::size_t>(tensor.shape.back());
  return {tensor.values.size() / length, length, tensor.values.data()};
}

void add_classes(std::span<const float> scores, const Box& box, double least_score, std::vector<Detection>& out) {
  for (std::size_t c = 0; c < scores.size(); ++c) {
    const auto score = static_cast<double>(scores[c]);
    if (score >= least_score) out.push_back({static_cast<int>(c), score, box});
  }
}

// Mean of the softmax over the bins 0, 1, ...
double expected_bin(std::span<const float> logits) {
  const float top = *std::ranges::max_element(logits);
  double sum = 0.0;
  double weighted = 0.0;
  for (std::size_t i = 0; i < logits.size(); ++i) {
    const double weight = std::exp(static_cast<double>(logits[i] - top));
    sum += weight;
    weighted += weight * static_cast<double>(i);
  }
  return weighted / sum;
}

// Scores and distances for one stride.
struct GflPair {
  Rows scores;
  Rows distances;
};

Result<GflPair> pair_of(std::span<const Tensor> outputs, std::size_t places, int stride, int bins) {
  const std::size_t length = 4 * static_cast<std::size_t>(bins);
  std::vector<Rows> fitting;
  for (const Tensor& tensor : outputs) {
    if (const Rows rows = rows_of(tensor); rows.rows == places) fitting.push_back(rows);
  }
  if (fitting.size() == 2) {
    if (fitting[1].length != length) std::swap(fitting[0], fitting[1]);
    if (fitting[1].length == length) return GflPair{fitting[0], fitting[1]};
  }
  const auto given = joined(mapped(outputs, [](const Tensor& tensor) { return shape_text(tensor.shape); }));
  return bad_input("for stride " + std::to_string(stride) + " expected outputs 1x" + std::to_string(places) +
                   "xCLASSES and 1x" + std::to_string(places) + "x" + std::to_string(4 * bins) +
                   ", the network gives " + given + "; put output.kind, strides and bins right");
}

void add_places(const GflPair& pair, int cells_across, int stride, int bins, double least_score,
                std::vector<Detection>& out) {
  const auto length = static_cast<std::size_t>(bins);
  for (std::size_t i = 0; i < pair.scores.rows; ++i) {
    const std::span<const float> scores = pair.scores.row(i);
    if (static_cast<double>(*std::ranges::max_element(scores)) < least_score) continue;
    const std::size_t column = i % static_cast<std::size_t>(cells_across);
    const std::size_t row = i / static_cast<std::size_t>(cells_across);
    const double x = (static_cast<double>(column) + 0.5) * stride;
    const double y = (static_cast<double>(row) + 0.5) * stride;
    std::array<double, 4> to{};  // left, top, right, bottom
    for (std::size_t side = 0; side < to.size(); ++side) {
      to[side] = stride * expected_bin(pair.distances.row(i).subspan(side * length, length));
    }
    add_classes(scores, {x - to[0], y - to[1], to[0] + to[2], to[1] + to[3]}, least_score, out);
  }
}

// Interpolation along one side of the input: the two nearest pixels and the second one's weight.
struct Between {
  std::size_t first = 0;
  std::size_t second = 0;
  float weight = 0.0F;
};

std::vector<Between> places_along(int input, int picture) {
  const double scale = static_cast<double>(input) / picture;
  std::vector<Between> places;
  for (int i = 0; i < input; ++i) {
    const double centred = std::clamp((i + 0.5) / scale - 0.5, 0.0, picture - 1.0);
    const auto first = static_cast<std::size_t>(centred);
    places.push_back({first, std::min(first + 1, static_cast<std::size_t>(picture) - 1),
                      static_cast<float>(centred - static_cast<double>(first))});
  }
  return places;
}

Levels resized(const Levels& levels, Geometry picture, Geometry input) {
  const std::vector<Between> columns = places_along(input.width, picture.width);
  Levels out;
  out.reserve(input.pixels());
  const auto width = static_cast<std::size_t>(picture.width);
  for (const Between& row : places_along(input.height, picture.height)) {
    const float* const upper = levels.data() + row.first * width;
    const float* const lower = levels.data() + row.second * width;
    for (const Between& column : columns) {
      const float above = std::lerp(upper[column.first], upper[column.second], column.weight);
      const float below = std::lerp(lower[column.first], lower[column.second], column.weight);
      out.push_back(std::lerp(above, below, row.weight));
    }
  }
  return out;
}

// The input {1, 3, height, width} of a description: the picture is stretched to fill it, bilinear between pixel centres
// (like OpenCV's INTER_LINEAR).
Tensor input_of(const Levels& levels, Geometry picture, const DetectorDescription& d) {
  const Levels grey = resized(levels, picture, d.input);
  Tensor input{{1, 3, d.input.height, d.input.width}, {}};
  input.values.reserve(3 * grey.size());
  std::array<const Channel*, 3> channels{&d.red, &d.green, &d.blue};
  if (d.order == ChannelOrder::kBgr) std::ranges::reverse(channels);
  for (const Channel* channel : channels) {
    for (const float level : grey) {
      input.values.push_back(static_cast<float>((static_cast<double>(level) - channel->mean) * channel->scale));
    }
  }
  return input;
}

// --- Descriptions.

constexpr std::array<std::pair<std::string_view, NetworkFormat>, 2> kFormats{
    {{"darknet", NetworkFormat::kDarknet}, {"onnx", NetworkFormat::kOnnx}}};
constexpr std::array<std::pair<std::string_view, OutputKind>, 2> kOutputs{
    {{"yolo", OutputKind::kYolo}, {"nanodet_gfl", OutputKind::kNanodetGfl}}};
constexpr std::array<std::pair<std::string_view, ChannelOrder>, 2> kOrders{
    {{"rgb", ChannelOrder::kRgb}, {"bgr", ChannelOrder::kBgr}}};

constexpr model::Range kShare{0.0, 1.0, ""};

void channel_keys(model::KeyTable& keys, const std::string& colour, Channel& channel) {
  keys.number("mean_" + colour, channel.mean, {0.0, 255.0, "grey levels"}, "Taken off each value of the channel");
  keys.number("scale_" + colour, channel.scale, {1e-6, 100.0, ""}, "What is left is multiplied by this");
}

// As text: KeyTable::file would resolve paths beside the description, but the networks may be elsewhere.
struct FileNames {
  std::string graph;
  std::string weights;
};

model::KeyTable keys_of(DetectorDescription& d, FileNames& files) {
  model::KeyTable keys;
  keys.text("name", d.name, "What tables call the detector");
  keys.section("network", "Its files, in the folder of networks that the evaluation is given");
  keys.choice<NetworkFormat>("format", d.files.format, kFormats, "Who wrote them");
  keys.text("graph", files.graph, "The .cfg of Darknet, or the .onnx");
  keys.text("weights", files.weights, "The .weights of Darknet");
  keys.section("input", "How a picture becomes the network's input, (level - mean) * scale of levels 0 to 255");
  keys.integer("width", d.input.width, {32, 4096, "pixels"},
               "As the network was made for; a multiple of its largest stride");
  keys.integer("height", d.input.height, {32, 4096, "pixels"}, "The same");
  keys.choice<ChannelOrder>("order", d.order, kOrders, "Which channel comes first");
  channel_keys(keys, "red", d.red);
  channel_keys(keys, "green", d.green);
  channel_keys(keys, "blue", d.blue);
  keys.section("output", "How boxes are read from what the network gives");
  keys.choice<OutputKind>("kind", d.output, kOutputs, "Darknet's [yolo] layers, or NanoDet's scores and distributions");
  keys.integers("strides", d.strides, {1, 512, "pixels"}, "Of nanodet_gfl: from one place of an output to the next");
  keys.integer("bins", d.bins, {2, 64, ""}, "Of nanodet_gfl: values of a distance's distribution");
  keys.section("classes", "What the numbers of the classes mean, from 0; names as --classes has them");
  keys.text("names", d.class_names, "With commas between");
  keys.text("file", d.class_file, "Or a file with one name a line, in the folder of networks");
  keys.section("detections", "");
  keys.number("least_score", d.least_score, kShare, "Detections below are dropped");
  keys.number(
      "truth_score", d.truth_score, kShare,
      "Where no person labelled a frame, the detector's boxes on the sharp frame from this score on are the truth");
  keys.number("nms_iou", d.nms_iou, kShare, "Of two boxes of a class that overlap more, only the better stays");
  return keys;
}

Status check(const model::KeyTable& keys, const DetectorDescription& d) {
  const auto wrong = [&keys](const char* key, const std::string& what) { return bad_input(keys.where(key) + what); };
  const bool darknet = d.files.format == NetworkFormat::kDarknet;
  if (d.name.empty()) return wrong("name", "name is missing: say what tables call the detector");
  if (d.files.graph.empty()) return wrong("network.graph", "network.graph is missing: name the network's file");
  if (darknet && d.files.weights.empty()) {
    return wrong("network.weights", "network.weights is missing: name the .weights of Darknet");
  }
  if (!darknet && !d.files.weights.empty()) {
    return wrong("network.weights", "network.weights belongs to format \"darknet\"; leave it out");
  }
  if (d.class_names.empty() == d.class_file.empty()) {
    return wrong("classes.names", "give either classes.names or classes.file");
  }
  if (d.truth_score < d.least_score) {
    return wrong("detections.truth_score", "detections.truth_score is below least_score; raise it");
  }
  if (d.output == OutputKind::kNanodetGfl && d.strides.empty()) {
    return wrong("output.strides", "output.strides is empty; nanodet_gfl needs one for each output");
  }
  return {};
}

Status place(std::filesystem::path& file, const std::filesystem::path& folder) {
  file = folder / file;  // keeps an absolute path
  std::error_code ignored;
  if (std::filesystem::is_regular_file(file, ignored)) return {};
  return bad_input(file.string() + ": not there; name the folder of the networks' files");
}

}  // namespace

std::string shape_text(const std::vector<int>& shape) {
  const auto text = joined(mapped(shape, [](int extent) { return std::to_string(extent); }), "x");
  return text.empty() ? "nothing" : text;
}

Result<std::vector<Detection>> decode_yolo(std::span<const Tensor> outputs, Geometry input, double least_score) {
  constexpr std::size_t kBeforeClasses = 5;
  std::vector<Detection> found;
  for (const Tensor& tensor : outputs) {
    const Rows rows = rows_of(tensor);
    if (rows.length <= kBeforeClasses) {
      return bad_input("expected rows of cx, cy, w, h, objectness and class scores, the network gives " +
                       shape_text(tensor.shape) + "; put output.kind right");
    }
    for (std::size_t i = 0; i < rows.rows; ++i) {
      const std::span<const float> row = rows.row(i);
      const double width = static_cast<double>(row[2]) * input.width;
      const double height = static_cast<double>(row[3]) * input.height;
      const Box box{static_cast<double>(row[0]) * input.width - width / 2.0,
                    static_cast<double>(row[1]) * input.height - height / 2.0, width, height};
      add_classes(row.subspan(kBeforeClasses), box, least_score, found);
    }
  }
  return found;
}

Result<std::vector<Detection>> decode_nanodet(std::span<const Tensor> outputs, Geometry input, const GflLayout& layout,
                                              double least_score) {
  std::vector<Detection> found;
  for (const int stride : layout.strides) {
    const int across = (input.width + stride - 1) / stride;
    const int down = (input.height + stride - 1) / stride;
    ASSIGN_OR_RETURN(const auto pair, pair_of(outputs, Geometry{across, down}.pixels(), stride, layout.bins));
    add_places(pair, across, stride, layout.bins, least_score, found);
  }
  return found;
}

std::vector<Detection> suppressed(std::vector<Detection> detections, double nms_iou) {
  std::ranges::stable_sort(detections, std::ranges::greater{}, &Detection::score);
  std::vector<Detection> kept;
  for (const Detection& one : detections) {
    const auto covers = [&](const Detection& better) {
      return better.label == one.label && iou(better.box, one.box) > nms_iou;
    };
    if (std::ranges::none_of(kept, covers)) kept.push_back(one);
  }
  return kept;
}

Levels levels_of(std::span<const float> kelvin, double cold_k, double hot_k) {
  Levels levels(kelvin.size());
  const double scale = 255.0 / (hot_k - cold_k);
  std::ranges::transform(kelvin, levels.begin(), [&](float k) {
    return static_cast<float>(std::clamp(std::round((static_cast<double>(k) - cold_k) * scale), 0.0, 255.0));
  });
  return levels;
}

Result<Detector> Detector::open(const DetectorDescription& description, const std::vector<JudgedClass>& classes) {
  std::vector<std::string> names = split_names(description.class_names);
  if (names.empty()) {
    ASSIGN_OR_RETURN(names, read_names(description.class_file));
  }
  ASSIGN_OR_RETURN(auto network, open_network(description.files));
  Detector detector(description, std::move(network), names, classes);
  if (std::ranges::all_of(detector.labels_, [](int label) { return label < 0; })) {
    return bad_input(description.name + ": knows none of the judged classes; name them as the detector does");
  }
  return detector;
}

Detector::Detector(DetectorDescription description, Network network, const std::vector<std::string>& names,
                   const std::vector<JudgedClass>& classes)
    : description_(std::move(description)), network_(std::move(network)) {
  for (const std::string& name : names) {
    const auto judged = std::ranges::find(classes, name, &JudgedClass::name);
    labels_.push_back(judged == classes.end() ? -1 : static_cast<int>(judged - classes.begin()));
  }
}

bool Detector::knows(int label) const { return std::ranges::find(labels_, label) != labels_.end(); }

Result<std::vector<Detection>> Detector::decoded(std::span<const Tensor> outputs) const {
  const DetectorDescription& d = description_;
  if (d.output == OutputKind::kYolo) return decode_yolo(outputs, d.input, d.least_score);
  return decode_nanodet(outputs, d.input, {d.strides, d.bins}, d.least_score);
}

Result<std::vector<Detection>> Detector::detect(const Levels& levels, Geometry picture) {
  ASSIGN_OR_RETURN(const auto outputs, network_(input_of(levels, picture, description_)));
  ASSIGN_OR_RETURN(auto found, at(description_.files.graph.string(), decoded(outputs)));
  const double across = static_cast<double>(description_.input.width) / picture.width;
  const double down = static_cast<double>(description_.input.height) / picture.height;
  std::vector<Detection> judged;
  for (Detection& one : found) {
    const auto number = static_cast<std::size_t>(one.label);
    one.label = number < labels_.size() ? labels_[number] : -1;
    one.box = {one.box.x / across, one.box.y / down, one.box.width / across, one.box.height / down};
    one.box = clipped(one.box, picture.width, picture.height);
    if (one.label >= 0 && area(one.box) > 0.0) judged.push_back(one);
  }
  return suppressed(std::move(judged), description_.nms_iou);
}

Result<DetectorDescription> read_description(const std::filesystem::path& file) {
  DetectorDescription d;
  FileNames files;
  model::KeyTable keys = keys_of(d, files);
  RETURN_IF_ERROR(keys.read(file));
  d.files.graph = files.graph;
  d.files.weights = files.weights;
  d.files.least_score = d.least_score;
  RETURN_IF_ERROR(check(keys, d));
  return d;
}

Result<DetectorDescription> with_files_in(DetectorDescription d, const std::filesystem::path& folder) {
  RETURN_IF_ERROR(place(d.files.graph, folder));
  std::filesystem::path names = d.class_file;
  for (std::filesystem::path* file : {&d.files.weights, &names}) {
    if (!file->empty()) RETURN_IF_ERROR(place(*file, folder));
  }
  d.class_file = names.string();
  return d;
}

}  // namespace bolo::tools::detect
