// The report as files. report.json: the table in ARCHITECTURE.md, key for key.
#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "src/diagnose/report_output.hpp"

namespace bolo::diagnose {
namespace {

using nlohmann::ordered_json;

// JSON has no NaN and no infinity: what could not be measured is null.
ordered_json number(double value) { return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr); }

ordered_json span(const std::pair<double, double>& ends) {
  return ordered_json::array({number(ends.first), number(ends.second)});
}

ordered_json numbers(const std::map<std::string, double>& values) {
  ordered_json out = ordered_json::object();
  for (const auto& [key, value] : values) out[key] = number(value);
  return out;
}

ordered_json parameters_of(const FoundEffect& effect) {
  ordered_json out = ordered_json::object();
  for (const auto& [key, estimate] : effect.parameters) {
    out[key] = {{"value", number(estimate.value)}, {"ci95", span({estimate.low, estimate.high})}};
  }
  return out;
}

ordered_json effects_of(const Report& report) {
  ordered_json out = ordered_json::array();
  for (const FoundEffect& effect : report.effects) {
    ordered_json alternatives = ordered_json::array();
    for (const Alternative& other : effect.alternatives) {
      alternatives.push_back({{"name", other.name}, {"gap_after", number(other.gap_after)}});
    }
    out.push_back({{"name", effect.name},
                   {"confidence", number(effect.confidence)},
                   {"gap_before", number(effect.gap_before)},
                   {"gap_after", number(effect.gap_after)},
                   {"of_noise", effect.of_noise},
                   {"parameters", parameters_of(effect)},
                   {"stage", effect.stage},
                   {"alternatives", std::move(alternatives)}});
  }
  return out;
}

ordered_json location_of(const Location& where) {
  ordered_json times = ordered_json::array();
  for (const auto& interval : where.time_s) times.push_back(span(interval));
  return {{"stage", where.stage},
          {"captures", numbers(where.captures)},
          {"rows", {where.row_first, where.row_last}},
          {"columns", {where.column_first, where.column_last}},
          {"pixel_fraction", number(where.pixel_fraction)},
          {"time_s", std::move(times)},
          {"band_hz", span(where.band_hz)},
          {"temperature_k", span(where.temperature_k)}};
}

ordered_json stimulus_of(const Report& report) {
  ordered_json out = ordered_json::object();
  for (const auto& [file, errors] : report.stimulus) out[file] = numbers(errors);
  return out;
}

ordered_json noise_of(const Report& report) {
  ordered_json statistics = ordered_json::array();
  for (const NoiseStatistic& one : report.noise) {
    statistics.push_back({{"name", one.name},
                          {"unit", one.unit},
                          {"measured", number(one.measured)},
                          {"nominal", number(one.nominal)},
                          {"explained", number(one.explained)}});
  }
  return {{"floor_k", number(report.noise_floor_k)}, {"statistics", std::move(statistics)}};
}

ordered_json captures_of(const Report& report) {
  ordered_json out = ordered_json::object();
  for (const CapturePlots& one : report.captures) {
    out[one.file] = {{"kind", one.kind}, {"gap_before", number(one.gap_before)}, {"gap_after", number(one.gap_after)}};
  }
  return out;
}

// Places [x, y]: not more than tell where to look, beside their number.
ordered_json pixels_of(const std::vector<PixelPlace>& pixels) {
  constexpr std::size_t kMostPlaces = 256;
  ordered_json places = ordered_json::array();
  for (std::size_t i = 0; i < std::min(kMostPlaces, pixels.size()); ++i) {
    places.push_back(ordered_json::array({pixels[i].x, pixels[i].y}));
  }
  return {{"count", pixels.size()}, {"places", std::move(places)}};
}

ordered_json observations_of(const Report& report) {
  ordered_json out = ordered_json::object();
  for (const Observation& one : report.observations) {
    ordered_json jumps = ordered_json::array();
    for (const Observation::Jump& jump : one.jumps) {
      jumps.push_back({{"frame", jump.frame}, {"size", number(jump.size)}});
    }
    ordered_json freezes = ordered_json::array();
    for (const auto& [first, last] : one.freezes) freezes.push_back(ordered_json::array({first, last}));
    out[one.file] = {{"unit", one.unit},
                     {"frames", one.frames},
                     {"jumps", std::move(jumps)},
                     {"freezes", std::move(freezes)},
                     {"repeated_frames", one.repeated_frames},
                     {"noise", number(one.noise)},
                     {"flicker", number(one.flicker)},
                     {"column_pattern", number(one.column_pattern)},
                     {"row_pattern", number(one.row_pattern)},
                     {"outliers", pixels_of(one.outliers)}};
  }
  return out;
}

}  // namespace

std::string report_json(const Report& report) {
  ordered_json names = ordered_json::array();
  ordered_json needs = ordered_json::object();
  for (const NotIdentifiable& one : report.not_identifiable) {
    names.push_back(one.effect);
    needs[one.effect] = one.needs;
  }
  const ordered_json out{
      {"bolo_report", 1},
      {"inputs", report.inputs},
      {"gap",
       {{"before", number(report.gap_before)},
        {"after", number(report.gap_after)},
        {"closed_fraction", number(report.closed_fraction)}}},
      {"noise_gap_before", number(report.noise_gap_before)},
      {"noise_gap_after", number(report.noise_gap_after)},
      {"verdict", report.verdict},
      {"needs", report.needs},
      {"effects", effects_of(report)},
      {"location", location_of(report.location)},
      {"stimulus", stimulus_of(report)},
      {"unexplained",
       {{"p_value", number(report.unexplained.p_value)},
        {"stage", report.unexplained.stage},
        {"where", report.unexplained.where}}},
      {"not_identifiable", std::move(names)},
      {"not_identifiable_needs", std::move(needs)},
      {"withheld", report.withheld},
      {"warnings", report.warnings},
      {"captures", captures_of(report)},
      {"noise", noise_of(report)},
      {"pixels", {{"stuck", pixels_of(report.defects.stuck)}, {"noisy", pixels_of(report.defects.noisy)}}},
      {"observations", observations_of(report)},
      {"frames", report.frames},
      {"seconds", number(report.seconds)}};
  // File names need not be UTF-8.
  return out.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

std::vector<std::filesystem::path> report_files(const std::filesystem::path& folder) {
  return {folder / "report.json", folder / "report.html"};
}

Status write_report(const Report& report, const std::filesystem::path& folder, Replace replace) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return bad_input(folder.string() + ": cannot be made a folder: " + error.message() + "; choose another");
  }
  const auto files = report_files(folder);
  const Status json = write_file({files[0], replace}, report_json(report) + '\n');
  return json ? write_file({files[1], replace}, report_html(report)) : json;
}

}  // namespace bolo::diagnose
