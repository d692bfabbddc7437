#include <array>
#include <system_error>

#include "src/model/strict_toml.hpp"
#include "tools/lab/detect/detector.hpp"

namespace bolo::tools::detect {
namespace {

constexpr std::array<std::pair<std::string_view, NetworkFormat>, 2> kFormats{
    {{"darknet", NetworkFormat::kDarknet}, {"onnx", NetworkFormat::kOnnx}}};
constexpr std::array<std::pair<std::string_view, OutputKind>, 2> kOutputs{
    {{"yolo", OutputKind::kYolo}, {"nanodet_gfl", OutputKind::kNanodetGfl}}};
constexpr std::array<std::pair<std::string_view, Resize>, 2> kResizes{
    {{"stretch", Resize::kStretch}, {"letterbox", Resize::kLetterbox}}};
constexpr std::array<std::pair<std::string_view, ChannelOrder>, 2> kOrders{
    {{"rgb", ChannelOrder::kRgb}, {"bgr", ChannelOrder::kBgr}}};

constexpr model::Range kShare{0.0, 1.0, ""};

void channel_keys(model::KeyTable& keys, const std::string& colour, Channel& channel) {
  keys.number("mean_" + colour, channel.mean, {0.0, 255.0, "grey levels"}, "Taken off each value of the channel");
  keys.number("scale_" + colour, channel.scale, {1e-6, 100.0, ""}, "What is left is multiplied by this");
}

// As texts: KeyTable::file would look for them beside the description, where the networks need not be.
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
  keys.choice<Resize>("resize", d.resize, kResizes, "A picture of another shape is stretched, or keeps its shape");
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
  file = folder / file;  // an absolute one stays
  std::error_code ignored;
  if (std::filesystem::is_regular_file(file, ignored)) return {};
  return bad_input(file.string() + ": not there; name the folder of the networks' files");
}

}  // namespace

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
