// The report as files. report.json: the table in docs/formats.md, key for key; unmeasured values (NaN) are null.
#include <algorithm>

#include <nlohmann/json.hpp>

#include "src/core/statistics.hpp"
#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

using nlohmann::ordered_json;

// The library finds these by the types' namespace.
static void to_json(ordered_json& out, const Estimate& estimate) {
  out = {{"value", estimate.value}, {"ci95", {estimate.low, estimate.high}}};
}

static void to_json(ordered_json& out, const Alternative& other) {
  out = {{"name", other.name}, {"gap_after", other.gap_after}};
}

static void to_json(ordered_json& out, const FoundEffect& effect) {
  out = {{"name", effect.name},           {"confidence", effect.confidence},    {"gap_before", effect.gap.before},
         {"gap_after", effect.gap.after}, {"of_noise", effect.of_noise},        {"parameters", effect.parameters},
         {"stage", effect.stage},         {"alternatives", effect.alternatives}};
}

static void to_json(ordered_json& out, const Location& where) {
  out = {{"stage", where.stage},
         {"captures", where.captures},
         {"rows", {where.row_first, where.row_last}},
         {"columns", {where.column_first, where.column_last}},
         {"pixel_fraction", where.pixel_fraction},
         {"time_s", where.time_s},
         {"band_hz", where.band_hz},
         {"temperature_k", where.temperature_k}};
}

static void to_json(ordered_json& out, const NoiseStatistic& one) {
  out = {{"name", one.name},
         {"unit", "K"},
         {"measured", one.measured},
         {"nominal", one.nominal},
         {"explained", one.explained}};
}

static void to_json(ordered_json& out, const Observation::Jump& jump) {
  out = {{"frame", jump.frame}, {"size", jump.size}};
}

// Number of pixels, and the places [x, y] of the first ones.
static ordered_json pixels_of(const std::vector<PixelPlace>& pixels) {
  constexpr std::size_t kMostPlaces = 256;
  ordered_json places = ordered_json::array();
  for (std::size_t i = 0; i < std::min(kMostPlaces, pixels.size()); ++i) {
    places.push_back(ordered_json::array({pixels[i].x, pixels[i].y}));
  }
  return {{"count", pixels.size()}, {"places", std::move(places)}};
}

static void to_json(ordered_json& out, const FromMotion& motion) {
  out = {{"frames", motion.frames}, {"usual_px_s", motion.usual_px_s}, {"fastest_px_s", motion.fastest_px_s}};
  if (motion.tau_s) out["tau_s"] = motion.tau_s->value;
  if (motion.row_delay_s) out["row_delay_s"] = motion.row_delay_s->value;
}

static void to_json(ordered_json& out, const Observation& one) {
  out = {{"unit", one.unit},
         {"frames", one.frames},
         {"jumps", one.jumps},
         {"freezes", one.freezes},
         {"repeated_frames", one.repeated.size()},
         {"repeated_at", one.repeated},
         {"lost_before", one.lost_before},
         {"noise", one.noise},
         {"flicker", one.flicker},
         {"column_pattern", one.column_pattern},
         {"row_pattern", one.row_pattern},
         {"outliers", pixels_of(one.outliers)}};
  if (one.motion) out["motion"] = *one.motion;
}

std::string report_json(const Report& report) {
  ordered_json needs = ordered_json::object();
  for (const NotIdentifiable& one : report.not_identifiable) needs[one.effect] = one.needs;
  ordered_json captures = ordered_json::object();
  for (const CapturePlots& one : report.captures) {
    captures[one.file] = {{"kind", one.kind}, {"gap_before", one.gap.before}, {"gap_after", one.gap.after}};
  }
  ordered_json observations = ordered_json::object();
  for (const Observation& one : report.observations) observations[one.file] = one;
  const ordered_json out{
      {"bolo_report", 1},
      {"inputs", report.inputs},
      {"gap",
       {{"before", report.gap.before}, {"after", report.gap.after}, {"closed_fraction", report.closed_fraction}}},
      {"noise_gap_before", report.noise_gap.before},
      {"noise_gap_after", report.noise_gap.after},
      {"verdict", report.verdict},
      {"needs", report.needs},
      {"effects", report.effects},
      {"location", report.location},
      {"stimulus", report.stimulus},
      {"unexplained",
       {{"p_value", report.unexplained.p_value},
        {"stage", report.unexplained.stage},
        {"where", report.unexplained.where}}},
      {"not_identifiable", mapped(report.not_identifiable, &NotIdentifiable::effect)},
      {"not_identifiable_needs", std::move(needs)},
      {"withheld", report.withheld},
      {"warnings", report.warnings},
      {"captures", std::move(captures)},
      {"noise", {{"floor_k", report.noise_floor_k}, {"statistics", report.noise}}},
      {"pixels", {{"stuck", pixels_of(report.defects.stuck)}, {"noisy", pixels_of(report.defects.noisy)}}},
      {"observations", std::move(observations)},
      {"frames", report.frames},
      {"seconds", report.seconds}};
  // File names are not necessarily UTF-8.
  return out.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

std::vector<std::filesystem::path> report_files(const std::filesystem::path& folder) {
  return {folder / "report.json", folder / "report.html", folder / "scene.svg"};
}

Status write_report(const Report& report, const std::filesystem::path& folder, Replace replace) {
  RETURN_IF_ERROR(make_folder(folder));
  const auto files = report_files(folder);
  Status written = write_file({files[0], replace}, report_json(report) + '\n');
  if (written) written = write_file({files[1], replace}, report_html(report));
  return written && !report.scene.empty() ? write_file({files[2], replace}, plot::to_svg(report.scene)) : written;
}

}  // namespace bolo::diagnose
