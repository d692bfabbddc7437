// `bolo-lab eval detect`: the benefit of deblurring to object detectors.
#include <algorithm>
#include <cstdio>
#include <system_error>

#include "tools/cli/cli.hpp"
#include "tools/lab/detect/table.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::detect {
namespace {

constexpr const char* kSummary =
    R"(What deblurring is worth to object detectors: average precision (AP, as COCO's: IoU 0.5 to 0.95) of each
detector on sharp, blurred and deblurred frames, as in the paper.

Stills are looked at by a camera (microbolometer with tau 11 ms, 200 frames/s, 10 mK steps; black to white is 25 K) that
moves along real hand-held trajectories. All columns show the same instant. Where people labelled a still (NAME.txt
beside it, YOLO's form), their boxes, moved with the picture, are the truth; elsewhere each detector's own boxes on the
sharp frame are, so that "sharp" is 100 there by itself: two tables, never mixed. Intervals are the middle 95 % of a
bootstrap over the stills. Networks run by OpenCV; descriptions of detectors are TOML files (config/detectors).

--json prints one object:
  settings   {picture, repeats, noise_k, resamples, seed}
  columns    [{name, words}]
  motions    [{name, speed_px_s: {p10, p50, p90}}] at the judged instants
  rows       [{truth: labels | own_boxes, detector (null: mean over the detectors), motion, looks, stills, objects,
             columns: {NAME: {ap, ap_ci95, delta_ap, delta_ap_ci95, recovered, recovered_ci95}}}]
AP in percent; delta_ap against "blurred"; recovered: the share of what blurring costs. What cannot be said is null.)";

using Paths = std::vector<std::filesystem::path>;

Result<Paths> files_in(const std::filesystem::path& folder, const std::vector<std::string>& extensions) {
  std::error_code error;
  Paths files;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (std::ranges::find(extensions, entry.path().extension().string()) != extensions.end()) {
      files.push_back(entry.path());
    }
  }
  std::ranges::sort(files);
  if (error)
    return bad_input(folder.string() + ": cannot be opened: " + error.message() + "; name another with --data");
  if (files.empty()) return bad_input(folder.string() + ": has no file *" + extensions.front() + "; put some there");
  return files;
}

// Files named by an option, or else those in a folder of --data.
Result<Paths> listed(const cxxopts::ParseResult& given, const std::string& option, const char* folder,
                     const std::vector<std::string>& extensions) {
  if (given.count(option) != 0) {
    const auto names = given[option].as<std::vector<std::string>>();
    return Paths(names.begin(), names.end());
  }
  if (given.count("data") == 0) {
    return bad_input("give --data FOLDER with " + std::string(folder) + "/*" + extensions.front() + ", or --" + option);
  }
  return files_in(std::filesystem::path(given["data"].as<std::string>()) / folder, extensions);
}

Result<std::vector<DetectorDescription>> detectors_of(const cxxopts::ParseResult& given) {
  std::filesystem::path networks;
  if (given.count("data") != 0) networks = std::filesystem::path(given["data"].as<std::string>()) / "detectors";
  Paths files;
  for (const std::filesystem::path name : given["detectors"].as<std::vector<std::string>>()) {
    std::error_code ignored;
    if (!std::filesystem::is_directory(name, ignored)) {
      files.push_back(name);
      continue;
    }
    ASSIGN_OR_RETURN(const auto inside, files_in(name, {".toml"}));
    files.insert(files.end(), inside.begin(), inside.end());
  }
  std::vector<DetectorDescription> detectors;
  for (const std::filesystem::path& file : files) {
    ASSIGN_OR_RETURN(const auto description, read_description(file));
    if (std::ranges::find(detectors, description.name, &DetectorDescription::name) != detectors.end()) {
      return bad_input(file.string() + ": another detector is called '" + description.name + "' too; rename one");
    }
    ASSIGN_OR_RETURN(auto placed, with_files_in(description, networks.empty() ? file.parent_path() : networks));
    detectors.push_back(std::move(placed));
  }
  return detectors;
}

Result<Options> options_of(const cxxopts::ParseResult& given) {
  Options options;
  ASSIGN_OR_RETURN(options.scenes, listed(given, "scenes", "street", {".png", ".jpg", ".jpeg"}));
  ASSIGN_OR_RETURN(options.trajectories, listed(given, "trajectories", "trajectories", {".csv"}));
  ASSIGN_OR_RETURN(options.detectors, detectors_of(given));
  ASSIGN_OR_RETURN(options.picture, size_of(given["size"].as<std::string>(), "size", {64, 64}, {2048, 2048}));
  ASSIGN_OR_RETURN(options.repeats, number_of<int>(given, "repeats", 1, 100));
  ASSIGN_OR_RETURN(options.noise_k, number_of<double>(given, "noise", 0.0, 100.0));
  ASSIGN_OR_RETURN(options.resamples, number_of<int>(given, "resamples", 10, 100000));
  ASSIGN_OR_RETURN(options.threads, number_of<int>(given, "threads", 1, 64));
  options.seed = given["seed"].as<std::uint64_t>();
  return options;
}

Status evaluate(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const Options options, options_of(given));
  ASSIGN_OR_RETURN(const auto found, run(options));
  print_report(table_of(found, options), given.count("json") != 0);
  return {};
}

}  // namespace

}  // namespace bolo::tools::detect

int bolo::tools::eval_detect_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval detect", detect::kSummary);
  using Texts = std::vector<std::string>;
  const char* group = "What is looked at";
  add_option<std::string>(cli, "data",
                          "Folder with street/*.png (or .jpg), trajectories/*.csv (t_s,x_px,y_px) and the networks' "
                          "files in detectors",
                          nullptr, "FOLDER", group);
  add_option<Texts>(cli, "scenes", "These stills instead of FOLDER/street", nullptr, "IMAGE,..", group);
  add_option<Texts>(cli, "trajectories", "These motions instead of FOLDER/trajectories", nullptr, "FILE.csv,..", group);
  add_option<int>(cli, "repeats", "Looks at each still in each motion", "2", "", group);
  add_option<std::string>(
      cli, "size",
      "Pixels of the camera; 640x480 is the A655sc's whole sensor, which it cannot send 200 times a "
      "second",
      "640x480", "WxH", group);
  add_option<double>(cli, "noise", "K rms", "0.03", "", group);
  add_option<std::uint64_t>(cli, "seed", "Of looks, noise and bootstrap", "1", "", group);
  group = "Who looks";
  add_option<Texts>(cli, "detectors", "Descriptions, or folders of them", "config/detectors", "FILE.toml,..", group);
  group = "How it is judged";
  add_option<int>(cli, "resamples", "Of the bootstrap", "1000", "", group);
  add_option<int>(cli, "threads", "The result does not depend on them", "2", "", group);
  add_option<bool>(cli, "json", "Print one JSON object");
  return run_verb("detect", std::move(cli), argc, argv, detect::evaluate);
}
