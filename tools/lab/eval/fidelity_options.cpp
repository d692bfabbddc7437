#include "tools/lab/eval/fidelity_options.hpp"

#include <algorithm>
#include <charconv>
#include <sstream>

#include "src/sim/path.hpp"
#include "src/sim/scene.hpp"
#include "tools/cli/plot_option.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr const char* kSummary =
    R"(Which estimator is good where: RMSE, PSNR, SSIM, edge width and the error at edges of every column in every cell.

A cell is a scene, a motion, a noise and a look-ahead. All columns see the same simulated frames (microbolometer with
tau 11 ms, 200 frames/s, 10 mK steps) and are judged on the same targets against the instantaneous temperature at the
frame's time. Spatial baselines are told the motion; strengths named "picked" are picked with the truth. The temporal
filter is a least-squares fit on another street in the same motion and noise.

--json prints one object:
  settings   crop, frames, stride, seed, tau_s, frame_period_s, window, quantisation_k, range_k (of PSNR and SSIM)
  columns    [{name, words}]
  cells      [{scene, motion, speed_px_s (null on a trajectory), trajectory (null on a pan), noise_k, lookahead,
             truth_edge_width_px, columns: {NAME: {rmse_k, psnr_db, ssim, edge_width_px, edge_rmse_k, setting}
             or {skipped: why}}, qp_grid: [{lambda, rmse_k}]}]
  drops      with --drop: [{scene, motion, noise_k, lookahead, method, frames_lost, all, near}], or skipped: why;
             all and near (at most 2 frames from a loss) are {frames, whole_rmse_k (without losses),
             gap_aware_rmse_k, gap_blind_rmse_k}
  latency    with --plot: [{scene, motion, noise_k, blurred_rmse_k, lookaheads, NAME: [rmse_k]}]
  verdicts   [{name, words, cells, holds, mean_ratio, worst_ratio, misses: [{cell, against, ratio}]}]; holds is null
             where no cell could be judged
A measure that cannot be taken (no clear edge) is null.)";

template <typename T>
Status within(const std::vector<T>& values, const char* option, T low, T high) {
  if (values.empty()) return bad_input(std::string("--") + option + ": expected at least one value");
  for (const T value : values) {
    if (value >= low && value <= high) continue;
    std::ostringstream message;
    message << "--" << option << ' ' << value << ": expected " << low << " to " << high;
    return bad_input(message.str());
  }
  auto sorted = values;
  std::ranges::sort(sorted);
  if (std::ranges::adjacent_find(sorted) != sorted.end()) {
    return bad_input(std::string("--") + option + ": a value is given twice");
  }
  return {};
}

Result<Geometry> crop_of(const std::string& text) {
  Geometry crop;
  const char* const end = text.data() + text.size();
  const auto width = std::from_chars(text.data(), end, crop.width);
  const bool has_x = width.ec == std::errc() && width.ptr != end && *width.ptr == 'x';
  const auto height = has_x ? std::from_chars(width.ptr + 1, end, crop.height) : width;
  const bool good = has_x && height.ec == std::errc() && height.ptr == end;
  if (good && crop.width >= 32 && crop.width <= 4096 && crop.height >= 16 && crop.height <= 4096) return crop;
  return bad_input("--crop " + text + ": expected WIDTHxHEIGHT, 32x16 to 4096x4096 pixels");
}

Result<std::vector<std::string>> scenes_of(const cxxopts::ParseResult& given) {
  auto scenes = given["scene"].as<std::vector<std::string>>();
  for (const std::string& scene : scenes) {
    if (scene == "street") continue;
    if (const auto image = sim::read_image(scene, {}); !image) return tl::unexpected(image.error());
  }
  return scenes;
}

Result<std::vector<Motion>> motions_of(const cxxopts::ParseResult& given) {
  const auto speeds = given["speeds"].as<std::vector<double>>();
  if (const Status good = within(speeds, "speeds", -5000.0, 5000.0); !good) return tl::unexpected(good.error());
  std::vector<Motion> motions;
  motions.reserve(speeds.size());
  for (const double speed : speeds) motions.push_back({speed, {}});
  if (given.count("trajectory") == 0) return motions;
  for (const std::string& file : given["trajectory"].as<std::vector<std::string>>()) {
    if (const auto points = sim::read_trajectory(file); !points) return tl::unexpected(points.error());
    motions.push_back({0.0, file});
  }
  return motions;
}

}  // namespace

cxxopts::Options declare() {
  cxxopts::Options cli("bolo-lab eval fidelity", kSummary);
  const auto texts = [](const char* value) { return cxxopts::value<std::vector<std::string>>()->default_value(value); };
  const auto numbers = [](const char* value) { return cxxopts::value<std::vector<double>>()->default_value(value); };
  cli.add_options("What is compared")(
      "scene", "street, or pictures: PNG, JPEG (black to white is 25 K), HDF5 with image_k", texts("street"),
      "street|IMAGE,..")("speeds", "Pans along +x, pixels/s", numbers("100,300,600"))(
      "trajectory", "Hand-held motions beside the pans, from the middle of each file: CSV of t_s,x_px,y_px",
      cxxopts::value<std::vector<std::string>>(), "FILE.csv,..")("noises", "K rms", numbers("0.03,0.1,0.5"))(
      "lookaheads", "Frames", cxxopts::value<std::vector<int>>()->default_value("0,1,2"))(
      "frames", "Targets judged in a cell", cxxopts::value<int>()->default_value("24"))(
      "crop", "Pixels judged", cxxopts::value<std::string>()->default_value("320x64"), "WxH")(
      "drop", "Also lose this share of the frames, at random", cxxopts::value<double>(), "SHARE")(
      "seed", "Of the street, the noise and the losses", cxxopts::value<std::uint64_t>()->default_value("1"))(
      "threads", "The result does not depend on them", cxxopts::value<int>()->default_value("2"));
  cli.add_options("Output")("json", "Print one JSON object");
  add_plot_option(cli, "Draw the table");
  return cli;
}

Result<Options> options_of(const cxxopts::ParseResult& given) {
  Options options;
  auto scenes = scenes_of(given);
  if (!scenes) return tl::unexpected(scenes.error());
  auto motions = motions_of(given);
  if (!motions) return tl::unexpected(motions.error());
  const auto crop = crop_of(given["crop"].as<std::string>());
  if (!crop) return tl::unexpected(crop.error());
  options.scenes = std::move(*scenes);
  options.motions = std::move(*motions);
  options.crop = *crop;
  options.noises_k = given["noises"].as<std::vector<double>>();
  options.lookaheads = given["lookaheads"].as<std::vector<int>>();
  options.frames = given["frames"].as<int>();
  options.seed = given["seed"].as<std::uint64_t>();
  options.threads = given["threads"].as<int>();
  options.json = given.count("json") != 0;
  const bool drops = given.count("drop") != 0;
  if (drops) options.drop = given["drop"].as<double>();
  auto plot = plot_file_of(given);
  if (!plot) return tl::unexpected(plot.error());
  options.plot = std::move(*plot);
  for (const Status& good :
       {within(options.noises_k, "noises", 0.0, 100.0), within(options.lookaheads, "lookaheads", 0, kWindow - 2),
        within<int>({options.frames}, "frames", 1, 1000), within<int>({options.threads}, "threads", 1, 64),
        drops ? within<double>({options.drop}, "drop", 0.0001, 0.5) : Status{}}) {
    if (!good) return tl::unexpected(good.error());
  }
  return options;
}

}  // namespace bolo::tools::fidelity
