// bolo calibrate: a camera's time constant from pulses; its noise, offsets and dead pixels from still fields.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "src/capture/pixel_maps_io.hpp"
#include "src/core/text.hpp"
#include "src/diagnose/calibrate.hpp"
#include "src/diagnose/report.hpp"
#include "src/report/plot.hpp"
#include "tools/bolo/pulse_plots.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using Given = cxxopts::ParseResult;
using diagnose::Calibration;
using diagnose::DeadPixel;

cxxopts::Options calibrate_options() {
  cxxopts::Options options(
      "bolo calibrate",
      "Measure a camera and write its profile: the pixels' time constant from rectangular pulses; noise, offsets and\n"
      "dead pixels from still fields.\n\n"
      "Pulses: a chopper in front of a black body, or a board in front of a monitor. Switching times, temperatures\n"
      "and the pixels that see them need not be known; some levels should last ten time constants, and differ by\n"
      "10 K or more. Still fields: closed shutter or a flat black body. All captures from one camera in one mode.\n"
      "Example: bolo calibrate chopper.h5 shutter.h5 -o camera.toml --plot fit.svg");
  add_option<std::string>(options, "o,output", "Profile to write", nullptr, "PROFILE.toml");
  add_option<std::string>(options, "profile", "Profile to start from (default: a655sc)", nullptr, "P.toml");
  add_option<std::string>(options, "maps",
                          "File for per-pixel maps, if there are any (default: PROFILE-maps.h5 beside the profile)",
                          nullptr, "FILE.h5");
  add_option<bool>(options, "json", "Print the result as JSON");
  add_option<std::vector<std::string>>(options, "capture", "");
  add_plot_option(options, "Draw one pixel, measured and simulated");
  options.parse_positional({"capture"});
  options.positional_help("PULSES.h5 [STILL.h5...]");
  return options;
}

nlohmann::ordered_json rounded(const std::vector<double>& values) {
  auto list = nlohmann::ordered_json::array();
  for (const double v : values) {
    if (std::isfinite(v)) {
      list.push_back(std::round(v * 1e7) / 1e7);
    } else {
      list.push_back(nullptr);
    }
  }
  return list;
}

nlohmann::ordered_json range(const diagnose::Estimate& e) { return {e.low, e.high}; }

std::size_t count(const std::vector<DeadPixel>& pixels, DeadPixel kind) {
  return static_cast<std::size_t>(std::ranges::count(pixels, kind));
}

nlohmann::ordered_json to_json(const Calibration& r, const Given& given) {
  const diagnose::PulseFit& fit = r.fit;
  const auto dead = [&](DeadPixel kind) { return count(r.dead, kind); };
  nlohmann::ordered_json j{{"tau_s", fit.tau_s.value},
                           {"tau_ci95", range(fit.tau_s)},
                           {"noise_k", r.noise_k},
                           {"rmse_k", fit.rmse_k},
                           {"edges", fit.switches_s.size()},
                           {"gap", r.gap},
                           {"pixels", fit.pixels},
                           {"intervals", fit.intervals},
                           {"switches_s", rounded(fit.switches_s)},
                           {"levels_k", rounded(fit.levels_k)},
                           {"sweep_s", fit.sweep_x_s.value},
                           {"sweep_ci95", range(fit.sweep_x_s)},
                           {"row_sweep_s", fit.sweep_y_s.value},
                           {"row_sweep_ci95", range(fit.sweep_y_s)},
                           {"tau_spread", fit.tau_spread},
                           {"dead_pixels", r.dead_pixels},
                           {"dead",
                            {{"silent", dead(DeadPixel::kSilent)},
                             {"frozen", dead(DeadPixel::kFrozen)},
                             {"noisy", dead(DeadPixel::kNoisy)}}}};
  if (r.still) {
    j["pixel_noise_k"] = r.still->pixel_noise_k;
    j["offset_rms_k"] = r.still->offset_rms_k;
  }
  j["profile"] = given["output"].as<std::string>();
  j["maps"] =
      r.profile.maps.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(r.profile.maps.string());
  j["warnings"] = r.warnings;
  return j;
}

void print_calibration(const Calibration& r, const Given& given) {
  using diagnose::quantity;
  const diagnose::PulseFit& fit = r.fit;
  std::printf("tau          %.4f ms   95 %%: %.4f to %.4f\n", 1e3 * fit.tau_s.value, 1e3 * fit.tau_s.low,
              1e3 * fit.tau_s.high);
  std::printf("pulses       %zu switches, %zu intervals fitted, seen by %zu pixels\n", fit.switches_s.size(),
              fit.intervals, fit.pixels);
  const char* const unit = r.unit == Unit::kKelvin ? "K" : "counts";
  std::printf("residual     %.4f %s, noise %.4f %s: gap %.3f noise floors (1: nothing left)\n", fit.rmse_k, unit,
              r.noise_k, unit, r.gap);
  std::printf("sweep        %.3f ms over the columns, %.3f ms over the rows: of the blade, or of the read-out\n",
              1e3 * fit.sweep_x_s.value, 1e3 * fit.sweep_y_s.value);
  if (fit.spread_significant) {
    std::printf("tau spread   %.2f %% rms over the pixels; their map is written\n", 100.0 * fit.tau_spread);
  } else {
    std::printf("tau spread   none beyond noise\n");
  }
  if (r.still) {
    std::printf("still field  noise %.4f %s (%.4f a pixel's own), fixed pattern %.4f %s rms\n", r.still->noise_k, unit,
                r.still->pixel_noise_k, r.still->offset_rms_k, unit);
  }
  std::printf("dead pixels  %zu\n", r.dead_pixels);
  for (const std::string& warning : r.warnings) std::printf("warning      %s\n", printable(warning).c_str());
  std::printf("profile      %s", printable(given["output"].as<std::string>()).c_str());
  if (!r.profile.maps.empty()) std::printf(", maps in %s", printable(r.profile.maps.string()).c_str());
  std::printf("\n");
}

// Rounds the profile's numbers to their significant digits; returns how each is known.
model::Origins round_measured(Calibration& r) {
  const diagnose::Estimate& tau_s = r.fit.tau_s;
  const double half = 0.5 * (tau_s.high - tau_s.low);
  const int digits = half > 0.0 ? std::clamp(1 - static_cast<int>(std::floor(std::log10(half))), 4, 9) : 9;
  r.profile.tau_s = std::stod(fmt::format("{:.{}f}", tau_s.value, digits));
  model::Origins origins{
      {"tau_s", fmt::format("measured, 95 % interval {:.{}f} to {:.{}f}", tau_s.low, digits, tau_s.high, digits)}};
  if (r.profile.noise_k != r.noise_k) return origins;  // captures without kelvin
  r.profile.noise_k = std::stod(fmt::format("{:.4g}", r.noise_k));
  origins.emplace("noise_k", "measured");
  return origins;
}

Status run_calibrate(const Given& given) {
  if (given.count("output") == 0) return bad_input("no profile to write; give -o PROFILE.toml");
  const auto captures = files_of(given, "capture");
  if (captures.empty()) return bad_input("which captures? give one with pulses, then still ones");
  const auto plot = plot_file_of(given);
  if (!plot) return tl::unexpected(plot.error());
  const OutputFile profile{given["output"].as<std::string>(), replace_of(given)};
  std::filesystem::path maps = capture::maps_beside(profile.path);
  if (given.count("maps") != 0) maps = given["maps"].as<std::string>();
  std::vector<std::filesystem::path> inputs = captures;
  model::CameraProfile known;
  if (given.count("profile") != 0) {
    ASSIGN_OR_RETURN(known, model::read_profile(given["profile"].as<std::string>()));
    inputs.insert(inputs.end(), {given["profile"].as<std::string>(), known.maps});
  }
  RETURN_IF_ERROR(check_outputs({profile.path, maps, plot->path}, inputs, profile.replace));
  auto result = [&] {
    Progress progress("calibrate", 100);
    return diagnose::calibrate(captures, known, [&progress](const std::string&, double done) {
      progress.update(static_cast<std::uint64_t>(100.0 * done));
      return !interrupted().load(std::memory_order_relaxed);
    });
  }();
  if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted; nothing was written");
  if (!result) return tl::unexpected(result.error());
  const model::Origins origins = round_measured(*result);
  RETURN_IF_ERROR(capture::write_profile_files(profile, maps, result->profile, result->maps, origins));
  if (!plot->empty()) {
    plot::Sheet sheet{.title = "Calibration of a camera"};
    for (const plot::Plot& part : pulse_plots(result->fit, result->noise_k)) sheet.rows.push_back({part});
    if (Status drawn = save(sheet, *plot); !drawn) return drawn;
  }
  if (given.count("json") != 0) {
    std::cout << json_text(to_json(*result, given)) << '\n';
  } else {
    print_calibration(*result, given);
  }
  return {};
}

}  // namespace

int calibrate_main(int argc, char** argv) {
  return run_verb("calibrate", calibrate_options(), argc, argv, run_calibrate);
}

}  // namespace bolo::tools
