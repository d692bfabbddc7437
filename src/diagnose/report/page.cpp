// report.html: its parts in order of importance.
#include "report_text.hpp"  // report.css: styles of this page's own parts
#include "src/core/statistics.hpp"
#include "src/diagnose/report.hpp"
#include "src/report/plot.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

using plot::escaped;
using plot::format;
using plot::number_text;
using plot::unbroken;

std::string pill(std::string verdict) {
  const bool good = verdict == "no_gap" || verdict == "explained";
  const char* const look = good ? "good" : verdict == "unknown_effect" ? "bad" : "warn";
  verdict[0] = static_cast<char>(verdict[0] - 'a' + 'A');
  std::ranges::replace(verdict, '_', ' ');
  return format("<span class=\"pill %s\">", look) + verdict + "</span>";
}

std::string fact(const std::string& value, const std::string& name) {
  return "<div class=fact><b>" + value + "</b><span>" + name + "</span></div>";
}

std::string arrow(const Gaps& gap) { return gap_text(gap, " \u2192 "); }

struct GapLine {
  std::string name;
  double from = 1.0;
  double to = 1.0;
  plot::Hue hue = plot::Hue::kBlurred;
};

// Each line goes from one gap to another, with both numbers beside its name; the first is on top.
std::string gap_figure(const std::vector<GapLine>& lines) {
  constexpr double kLineHeight = 26.0;  // px
  // The axis reaches at least this far, so that small gaps look small.
  plot::Plot plot{.y = {.name = "gap, noise floors", .logarithmic = true, .low = 0.9, .high = 2.2},
                  .levels = {{.at = 1.0, .hue = plot::Hue::kGreen}},
                  .sideways = true,
                  .height = kLineHeight * static_cast<double>(lines.size())};
  for (const auto& [name, from, to, hue] : lines) {
    const auto place = static_cast<double>(plot.x.categories.size());
    for (const double gap : {from, to}) {
      if (!std::isfinite(gap) || gap <= 0.0) continue;
      plot.y.low = std::min(plot.y.low, 0.95 * gap);
      plot.y.high = std::max(plot.y.high, 1.1 * gap);
    }
    plot.x.categories.push_back(name + "  " + (from == 1.0 ? gap_text(to) : arrow({from, to})));
    // Leaves room for the lines beside the longest name, which may be a file name.
    plot.width = std::max(plot.width, plot::text_width(plot.x.categories.back(), 12.0) + 400.0);
    plot.series.push_back({.hue = hue, .x = {place, place}, .y = {from, to}, .width = 5.0});
    plot.series.push_back({.kind = plot::Kind::kPoints, .hue = hue, .x = {place}, .y = {to}});
  }
  return plot::figure_html(plot);
}

// Lines for the nominal simulator's gap, its reduction by each effect, and the remaining one.
void add_waterfall(const Report& report, bool of_noise, std::vector<GapLine>& lines) {
  using enum plot::Hue;
  lines.push_back(
      {of_noise ? "Nominal noise" : "Nominal simulator", 1.0, of_noise ? report.noise_gap.before : report.gap.before});
  for (const FoundEffect& effect : report.effects) {
    if (effect.of_noise != of_noise) continue;
    lines.push_back(
        {"with " + effect_title(effect.name), effect.gap.before, effect.gap.after, of_noise ? kPurple : kDeblurred});
  }
  const std::size_t effects = report.effects.size();
  const char* const left = effects == 0 ? "Left" : effects == 1 ? "Left with it" : "Left with all of them";
  lines.push_back({left, 1.0, of_noise ? report.noise_gap.after : report.gap.after, kSoft});
}

std::string span_text(double low, double high, const char* unit) {
  return number_text(low) + " to " + number_text(high) + ' ' + unit;
}

std::string head_part(const Report& report) {
  const std::string words = unbroken(escaped(headline(report, true)));
  const std::size_t end = words.find(". ");  // the first sentence becomes the heading
  std::string out = pill(report.verdict) + "<h1>" + words.substr(0, end == std::string::npos ? end : end + 1) + "</h1>";
  if (end != std::string::npos) out += "<p class=lead>" + words.substr(end + 2) + "</p>";
  const std::size_t captures = report.inputs.size();  // includes captures without a model
  out += format("<p class=soft>%zu capture%s, %zu frames, diagnosed in %s s.", captures, captures == 1 ? "" : "s",
                report.frames, number_text(report.seconds).c_str());
  if (!report.withheld.empty()) {
    out += " Taken out of the catalogue:";
    for (const std::string& name : report.withheld) out += " <code>" + escaped(name) + "</code>";
    out += '.';
  }
  out += "</p><div class=facts>";
  const bool tested = report.tested();
  if (!tested && !std::isfinite(report.noise_gap.before)) return out + "</div>";
  if (tested) {
    out += fact(arrow(report.gap), "gap of the prediction, in noise floors; 1.00 is none");
    out += fact(report.gap.before > 1.0 && report.verdict != "no_gap"
                    ? format("%.*f %%", report.closed_fraction > 0.995 && report.closed_fraction < 1.0 ? 1 : 0,
                             100.0 * report.closed_fraction)
                    : "\u2013",
                "of the gap closed");
  }
  out += fact(arrow(report.noise_gap), "gap of the noise's own statistics");
  out += fact(quantity("floor_k", report.noise_floor_k, {true, report.kelvin}), "noise floor of a pixel");
  return out + "</div>";
}

std::string waterfall_part(const Report& report) {
  if (!report.tested()) return {};
  std::vector<GapLine> lines;
  add_waterfall(report, false, lines);
  if (std::ranges::any_of(report.effects, &FoundEffect::of_noise)) add_waterfall(report, true, lines);
  std::string out = report.effects.empty() ? "<h2>The gap</h2>" : "<h2>What closes the gap</h2>";
  out +=
      "<p class=soft>Root mean square of the residual on data that was held out, in units "
      "of the noise floor, on a logarithmic scale. At the green line the prediction cannot be told from the camera. "
      "Each line is what one more effect takes away; the noise's own statistics stand below.</p>";
  return out + gap_figure(lines);
}

std::string location_part(const Report& report) {
  if (!report.tested() || (report.effects.empty() && report.unexplained.stage.empty())) return {};
  const Location& where = report.location;
  std::string out = "<h2>Where the gap is</h2><div class=facts>";
  out += fact(where.stage.empty() ? "\u2013" : escaped(where.stage), "stage of the camera");
  out += fact(format("%d to %d", where.row_first, where.row_last), "rows");
  out += fact(format("%d to %d", where.column_first, where.column_last), "columns");
  out += fact(format("%.3g %%", 100.0 * where.pixel_fraction), "of the pixels");
  if (where.band_hz.second > 0.0) out += fact(span_text(where.band_hz.first, where.band_hz.second, "Hz"), "band");
  if (where.temperature_k.second > 0.0) {
    out += fact(span_text(where.temperature_k.first, where.temperature_k.second, "K"), "temperatures");
  }
  for (const auto& [from, to] : where.time_s) out += fact(span_text(from, to, "s"), "times in a capture");
  out += "</div>";
  if (where.captures.empty()) return out;
  std::vector<GapLine> lines;
  for (const auto& [file, gap] : where.captures) lines.push_back({file, 1.0, gap});
  return out + "<h3 style=\"margin-top:18px\">Gap of each capture before anything was added</h3>" + gap_figure(lines);
}

std::string unexplained_part(const Report& report) {
  const Unexplained& left = report.unexplained;
  if (!report.tested() && left.stage.empty()) return {};
  const bool significant =
      !report.tested() || report.verdict == "unknown_effect" || report.verdict == "partly_explained";
  if (!significant) {
    return format(
        "<h2>What is left</h2><p>Nothing that the tests can see: all of them together have a p-value of "
        "%.2g.</p>",
        left.p_value);
  }
  std::string out =
      "<h2>What is left</h2><div class=card><span class=\"pill bad\">Unexplained</span><p style=\"margin-top:8px\">";
  out +=
      left.where.empty() ? "The residual is larger than chance, without a place that stands out" : escaped(left.where);
  out += left.where.ends_with('.') ? "" : ".";
  out += format("</p><p class=soft>p-value of all tests together: %.2g", left.p_value);
  if (!left.stage.empty()) out += "; it looks like the camera's stage <b>" + escaped(left.stage) + "</b>";
  return out + ".</p></div>";
}

std::string parameters_table(const FoundEffect& effect, Wording wording) {
  if (effect.parameters.empty()) return {};
  std::string out = "<table><tr><th>parameter<th class=n>value (95 % interval)</tr>";
  for (const auto& [key, estimate] : effect.parameters) {
    out += "<tr><td><code>" + escaped(key) + "</code><td class=n>" + quantity(key, estimate, wording) + "</tr>";
  }
  return out + "</table>";
}

std::string alternatives_text(const FoundEffect& effect) {
  if (effect.alternatives.empty()) return {};
  std::string out =
      format("<p class=soft style=\"font-size:14px\">Instead of it, the gap after (with it: %s):</p><table>",
             gap_text(effect.gap.after).c_str());
  for (const Alternative& other : effect.alternatives) {
    out += "<tr><td>" + escaped(effect_title(other.name)) + "<td class=n>" + gap_text(other.gap_after) + "</tr>";
  }
  return out + "</table>";
}

std::string gaps_text(const FoundEffect& effect) {
  if (!std::isfinite(effect.gap.before)) return {};
  return " \u00b7 gap" + std::string(effect.of_noise ? " of the noise " : " ") + arrow(effect.gap);
}

std::string effect_card(const FoundEffect& effect, Wording wording) {
  return "<section class=card><h3>" + escaped(effect_title(effect.name)) + " <code>" + escaped(effect.name) +
         "</code></h3><p style=\"margin:4px 0 8px\">" + unbroken(escaped(effect_sentence(effect, wording))) + ".</p>" +
         format(
             "<p class=soft style=\"font-size:14px\">Stage <b>%s</b> \u00b7 <b>%.3g %%</b> sure that it is this "
             "one%s</p>",
             escaped(effect.stage).c_str(), 100.0 * effect.confidence, gaps_text(effect).c_str()) +
         parameters_table(effect, wording) + alternatives_text(effect) + "</section>";
}

std::string list_of(const std::vector<std::string>& items) {
  std::string out = "<ul>";
  for (const std::string& item : items) out += "<li>" + item + "</li>";
  return out + "</ul>";
}

std::string effects_part(const Report& report) {
  if (report.effects.empty()) return {};
  std::string out = "<h2>The effects</h2><div class=cards>";
  for (const FoundEffect& effect : report.effects) out += effect_card(effect, {true, report.kelvin});
  return out + "</div>";
}

std::string stimulus_part(const Report& report) {
  if (report.stimulus.empty()) return {};
  std::string out =
      "<h2>Errors of the bench, not of the camera</h2><p class=soft>Fitted before anything else and taken out of the "
      "gap.</p><div class=scroll><table><tr><th>capture<th>parameter<th class=n>value</tr>";
  for (const auto& [file, errors] : report.stimulus) {
    std::string name = escaped(file);
    for (const auto& [key, value] : errors) {
      out += "<tr><td>" + name + "<td><code>" + escaped(key) + "</code><td class=n>" +
             quantity(key, value, {true, report.kelvin}) + "</tr>";
      name.clear();
    }
  }
  return out + "</table></div>";
}

std::string observed_part(const Report& report) {
  std::string out;
  for (const Observation& one : report.observations) {
    const std::vector<std::string> items = mapped(describe(one), escaped);
    if (!items.empty()) out += "<h3>" + escaped(one.file) + "</h3>" + list_of(items);
  }
  const std::vector<std::string> defects = describe(report.defects);
  if (!defects.empty()) out += "<h3>Pixels that do not work</h3>" + list_of(defects);
  if (out.empty()) return {};
  return "<h2>What frames and pixels tell by themselves</h2><p class=soft>Without a model of what the camera looked "
         "at; frames count from 0, pixels are (column, row).</p>" +
         out;
}

constexpr double kWorthOpening = 1.1;  // captures with a larger gap are shown unfolded

std::string figures(const std::vector<plot::Plot>& plots) {
  std::string out;
  for (const plot::Plot& one : plots) out += figure_html(one);
  return out;
}

std::string capture_part(const CapturePlots& one) {
  const bool open = std::max(one.gap.before, one.gap.after) > kWorthOpening;
  std::string kind = one.kind;
  std::ranges::replace(kind, '_', ' ');
  const std::string plots = figures(one.plots);
  return format("<details%s><summary>%s<span>%s, gap %s</span></summary>", open ? " open" : "",
                escaped(one.file).c_str(), kind.c_str(), arrow(one.gap).c_str()) +
         (plots.empty() ? "<p class=soft>Nothing was drawn of it.</p>" : "<div class=\"pair\">" + plots + "</div>") +
         "</details>";
}

std::string captures_part(const Report& report) {
  if (report.captures.empty()) return {};
  std::string out =
      "<h2>Capture by capture</h2><p class=soft>Those with a gap are open. Orange is the nominal simulator, blue is "
      "with "
      "the effects added.</p>";
  for (const CapturePlots& one : report.captures) out += capture_part(one);
  return out;
}

std::string noise_part(const Report& report) {
  if (report.noise.empty()) return {};
  constexpr double kLeast = 1e-4;  // K: smaller values are drawn at the end of the axis
  const double factor = report.kelvin ? 1e3 : 1.0;
  plot::Plot plot{.x = {},
                  .y = {.unit = report.kelvin ? "mK" : "counts", .logarithmic = true, .low = factor * kLeast},
                  .series = {{.label = "nominal", .hue = plot::Hue::kBlurred},
                             {.label = "measured", .hue = plot::Hue::kTruth},
                             {.label = "with the effects", .hue = plot::Hue::kDeblurred}},
                  .sideways = true,
                  .height = 26.0 * static_cast<double>(report.noise.size())};
  for (const NoiseStatistic& one : report.noise) {
    const auto place = static_cast<double>(plot.x.categories.size());
    std::string name = one.name;
    std::ranges::replace(name, '_', ' ');
    const auto amount = [&](double value) { return quantity("noise_k", value, {true, report.kelvin}); };
    plot.x.categories.push_back(name + "  " + amount(one.measured) + " (nominal " + amount(one.nominal) + ")");
    std::size_t at = 0;
    for (const double value : {one.nominal, one.measured, one.explained}) {
      plot::Series& series = plot.series[at++];
      series.kind = plot::Kind::kPoints;
      series.x.push_back(place);
      series.y.push_back(factor * std::max(kLeast, value));
    }
  }
  return "<h2>The noise</h2><p class=soft>Three-dimensional noise on closed shutter and flats: sigma with an index t "
         "is new in each frame, v differs from row to row, h from column to column. Where the measured dot stands "
         "beside the nominal one, the camera's noise is not the nominal one; where it lies below the third, the "
         "diagnosed effects account for it.</p>" +
         figure_html(plot);
}

std::string scene_part(const Report& report) {
  if (report.scene.empty()) return {};
  std::string out;
  for (const std::vector<plot::Plot>& row : report.scene) out += figures(row);
  return "<h2>A frame, before and after</h2><div class=\"pair\">" + out + "</div>";
}

std::string maps_part(const Report& report) {
  if (report.maps.empty()) return {};
  return "<h2>What was diagnosed of single pixels</h2><div class=\"plots\">" + figures(report.maps) + "</div>";
}

std::string limits_part(const Report& report) {
  std::string out;
  if (!report.not_identifiable.empty()) {
    out +=
        "<h2>What these captures cannot tell</h2><div class=scroll><table><tr><th>effect<th>a capture that would "
        "tell</tr>";
    for (const NotIdentifiable& one : report.not_identifiable) {
      out += "<tr><td>" + escaped(effect_title(one.effect)) + " <code>" + escaped(one.effect) + "</code><td>" +
             escaped(one.needs) + "</tr>";
    }
    out += "</table></div>";
  }
  if (!report.warnings.empty()) out += "<h2>Warnings</h2>" + list_of(mapped(report.warnings, escaped));
  const auto code = [](const std::string& input) { return "<code>" + escaped(input) + "</code>"; };
  if (!report.inputs.empty()) out += "<h2>Captures</h2>" + list_of(mapped(report.inputs, code));
  return out;
}

}  // namespace

std::string report_html(const Report& report) {
  std::string body;
  for (const auto part : {head_part, waterfall_part, effects_part, location_part, unexplained_part, observed_part,
                          captures_part, scene_part, noise_part, maps_part, stimulus_part, limits_part}) {
    body += part(report) + '\n';
  }
  return plot::page_html("Simulator and camera", body, kReportStyle);
}

}  // namespace bolo::diagnose
