// report.html: its parts in order of importance.
#include "report_text.hpp"  // report.css: styles of this page's own parts
#include "src/core/statistics.hpp"
#include "src/diagnose/report.hpp"
#include "src/report/plot_area.hpp"
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

std::string arrow(double before, double after) { return gap_text(before) + " \u2192 " + gap_text(after); }

// The axis of gaps: from a little under the floor to a little over the largest.
plot::Scale gap_axis(const std::vector<double>& gaps) {
  double low = 0.9;
  double high = 2.2;
  for (const double gap : gaps) {
    if (!std::isfinite(gap) || gap <= 0.0) continue;
    low = std::min(low, std::max(0.05, 0.95 * gap));
    high = std::max(high, 1.1 * gap);
  }
  return {{.logarithmic = true, .low = low, .high = high}, {}, true};
}

// Percent of the way along the axis, a little beyond its ends at most.
double percent(const plot::Scale& axis, double value) {
  const double place = axis.place(value);
  return std::isnan(place) ? 0.0 : 100.0 * std::clamp(place, -0.05, 1.05);
}

// Ticks of the axis and the line at 1.0, behind a bar.
std::string rules(const plot::Scale& axis) {
  std::string out;
  for (const plot::Tick& tick : axis.ticks(6)) out += format("<i style=\"left:%.2f%%\"></i>", percent(axis, tick.at));
  return out + format("<i class=floor style=\"left:%.2f%%\"></i>", percent(axis, 1.0));
}

std::string bar_row(const plot::Scale& axis, const std::string& name, const char* look, double from, double to,
                    const std::string& value) {
  const double left = percent(axis, std::min(from, to));
  const double right = percent(axis, std::max(from, to));
  return "<div class=row><div class=name>" + name + "</div><div class=track>" + rules(axis) +
         format("<b class=\"%s\" style=\"left:%.2f%%;width:%.2f%%\"></b></div><div class=value>", look, left,
                std::max(0.0, right - left)) +
         value + "</div></div>";
}

std::string scale_row(const plot::Scale& axis) {
  std::string out = "<div class=row><div class=\"name blank\"></div><div class=scale>";
  for (const plot::Tick& tick : axis.ticks(6)) {
    out += format("<span style=\"left:%.2f%%\">%s</span>", percent(axis, tick.at), tick.text.c_str());
  }
  return out +
         "</div><div class=\"value blank\"></div></div><div class=row><div class=\"name blank\"></div>"
         "<div class=axisname>gap, noise floors</div><div class=blank></div></div>";
}

// From the floor up to a gap.
std::string gap_row(const plot::Scale& axis, const std::string& name, const char* look, double gap) {
  return bar_row(axis, name, look, 1.0, gap, gap_text(gap));
}

// Waterfall of gaps: the nominal simulator's, its reduction by each effect, and the remaining one.
std::string waterfall(const Report& report, const plot::Scale& axis, bool of_noise) {
  std::string out = of_noise ? gap_row(axis, "Nominal noise", "start", report.noise_gap_before)
                             : gap_row(axis, "Nominal simulator", "start", report.gap_before);
  for (const FoundEffect& effect : report.effects) {
    if (effect.of_noise != of_noise) continue;
    out += bar_row(axis, "with <b>" + escaped(effect_title(effect.name)) + "</b>", of_noise ? "noise" : "",
                   effect.gap_before, effect.gap_after, arrow(effect.gap_before, effect.gap_after));
  }
  const std::size_t effects = report.effects.size();
  const char* const left = effects == 0 ? "Left" : effects == 1 ? "Left with it" : "Left with all of them";
  return out + gap_row(axis, left, "left", of_noise ? report.noise_gap_after : report.gap_after);
}

std::string span_text(double low, double high, const char* unit) {
  return number_text(low) + " to " + number_text(high) + ' ' + unit;
}

std::string times_text(const Location& where) {
  std::string text;
  for (const auto& [from, to] : where.time_s) text += (text.empty() ? "" : ", ") + span_text(from, to, "s");
  return text;
}

std::string chain(const Report& report) {
  constexpr std::array<std::array<const char*, 2>, 8> kStages{{{"radiometry", "Radiometry"},
                                                               {"optics", "Optics"},
                                                               {"pixel", "Pixel"},
                                                               {"package", "Package"},
                                                               {"readout", "Read-out"},
                                                               {"noise", "Noise"},
                                                               {"firmware", "Firmware"},
                                                               {"transport", "Transport"}}};
  std::string out = "<ol class=chain aria-label=\"stages of the camera\">";
  for (const auto& [stage, title] : kStages) {
    const bool found =
        std::ranges::any_of(report.effects, [here = stage](const FoundEffect& e) { return e.stage == here; });
    const bool unknown = report.unexplained.stage == stage;
    out += format("<li class=\"%s\">%s%s</li>", unknown ? "unknown" : found ? "found" : "", title, unknown ? " ?" : "");
  }
  return out + "</ol>";
}

std::string head_part(const Report& report) {
  const std::string words = unbroken(escaped(headline(report, true)));
  const std::size_t end = words.find(". ");  // the first sentence becomes the heading
  std::string out = pill(report.verdict) + "<h1>" + words.substr(0, end == std::string::npos ? end : end + 1) + "</h1>";
  if (end != std::string::npos) out += "<p class=lead>" + words.substr(end + 2) + "</p>";
  out += format("<p class=soft>%zu captures, %zu frames, diagnosed in %s s.", report.captures.size(), report.frames,
                number_text(report.seconds).c_str());
  if (!report.withheld.empty()) {
    out += " Taken out of the catalogue:";
    for (const std::string& name : report.withheld) out += " <code>" + escaped(name) + "</code>";
    out += '.';
  }
  out += "</p><div class=facts>";
  const bool tested = report.tested();
  if (!tested && !std::isfinite(report.noise_gap_before)) return out + "</div>";
  if (tested)
    out += fact(arrow(report.gap_before, report.gap_after), "gap of the prediction, in noise floors; 1.00 is none");
  if (tested)
    out += fact(report.gap_before > 1.0 && report.verdict != "no_gap"
                    ? format("%.*f %%", report.closed_fraction > 0.995 && report.closed_fraction < 1.0 ? 1 : 0,
                             100.0 * report.closed_fraction)
                    : "\u2013",
                "of the gap closed");
  out += fact(arrow(report.noise_gap_before, report.noise_gap_after), "gap of the noise's own statistics");
  out += fact(quantity("floor_k", report.noise_floor_k, {true, report.kelvin}), "noise floor of a pixel");
  return out + "</div>";
}

std::string waterfall_part(const Report& report) {
  if (!report.tested()) return {};
  std::vector<double> gaps{report.gap_before, report.gap_after};
  const bool noise = std::ranges::any_of(report.effects, [](const FoundEffect& e) { return e.of_noise; });
  if (noise) gaps.insert(gaps.end(), {report.noise_gap_before, report.noise_gap_after});
  for (const FoundEffect& effect : report.effects) gaps.insert(gaps.end(), {effect.gap_before, effect.gap_after});
  const plot::Scale axis = gap_axis(gaps);
  std::string out = report.effects.empty() ? "<h2>The gap</h2>" : "<h2>What closes the gap</h2>";
  out +=
      "<p class=soft>Root mean square of the residual on data that was held out, in units "
      "of the noise floor, on a logarithmic scale. At the green line the prediction cannot be told from the camera. "
      "Each bar is what one more effect takes away.</p>";
  out += waterfall(report, axis, false);
  if (noise) out += "<h3 style=\"margin-top:14px\">The noise's own statistics</h3>" + waterfall(report, axis, true);
  return out + scale_row(axis);
}

std::string location_part(const Report& report) {
  if (!report.tested() || (report.effects.empty() && report.unexplained.stage.empty())) return {};
  const Location& where = report.location;
  std::string out = "<h2>Where the gap is</h2>" + chain(report) + "<div class=facts>";
  out += fact(format("%d to %d", where.row_first, where.row_last), "rows");
  out += fact(format("%d to %d", where.column_first, where.column_last), "columns");
  out += fact(format("%.3g %%", 100.0 * where.pixel_fraction), "of the pixels");
  if (where.band_hz.second > 0.0) out += fact(span_text(where.band_hz.first, where.band_hz.second, "Hz"), "band");
  if (where.temperature_k.second > 0.0) {
    out += fact(span_text(where.temperature_k.first, where.temperature_k.second, "K"), "temperatures");
  }
  out += "</div>";
  const std::string times = times_text(where);
  if (!times.empty()) out += "<p class=soft style=\"margin-top:10px\">Times in a capture: " + times + ".</p>";
  if (where.captures.empty()) return out;
  const plot::Scale axis = gap_axis(mapped(where.captures, [](const auto& one) { return one.second; }));
  out += "<h3 style=\"margin-top:18px\">Gap of each capture before anything was added</h3>";
  for (const auto& [file, gap] : where.captures) out += gap_row(axis, escaped(file), "start", gap);
  return out + scale_row(axis);
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
  std::string out = "<table><tr><th>parameter<th class=n>value<th class=n>95 % interval</tr>";
  for (const auto& [key, estimate] : effect.parameters) {
    const std::string both = quantity(key, estimate, wording);
    const std::size_t open = both.rfind(" (");
    out += "<tr><td><code>" + escaped(key) + "</code><td class=n><b>" + both.substr(0, open) + "</b><td class=n>" +
           both.substr(open + 2, both.size() - open - 3) + "</tr>";
  }
  return out + "</table>";
}

std::string alternatives_text(const FoundEffect& effect) {
  if (effect.alternatives.empty()) return {};
  std::string out =
      format("<p class=soft style=\"font-size:14px\">Instead of it, the gap after (with it: %s):</p><table>",
             gap_text(effect.gap_after).c_str());
  double largest = effect.gap_before;
  for (const Alternative& other : effect.alternatives) largest = std::max(largest, other.gap_after);
  for (const Alternative& other : effect.alternatives) {
    out += format(
        "<tr><td style=\"width:45%%\">%s<td style=\"width:40%%\"><span style=\"display:block;height:8px;margin-top:7px;"
        "border-radius:3px;background:var(--soft);opacity:.55;width:%.0f%%\"></span><td class=n>%s</tr>",
        escaped(effect_title(other.name)).c_str(), 100.0 * std::clamp(other.gap_after / largest, 0.0, 1.0),
        gap_text(other.gap_after).c_str());
  }
  return out + "</table>";
}

std::string gaps_text(const FoundEffect& effect) {
  if (!std::isfinite(effect.gap_before)) return {};
  return format(" \u00b7 gap%s %s \u2192 %s", effect.of_noise ? " of the noise" : "",
                gap_text(effect.gap_before).c_str(), gap_text(effect.gap_after).c_str());
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
  std::vector<std::string> items;
  if (!report.defects.stuck.empty()) items.push_back(describe(report.defects.stuck, "stuck"));
  if (!report.defects.noisy.empty()) items.push_back(describe(report.defects.noisy, "noisy"));
  if (!items.empty()) out += "<h3>Pixels that do not work</h3>" + list_of(items);
  if (out.empty()) return {};
  return "<h2>What frames and pixels tell by themselves</h2><p class=soft>Without a model of what the camera looked "
         "at; frames count from 0, pixels are (column, row).</p>" +
         out;
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
  std::string out =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width,initial-scale=1\"><title>Simulator and camera</title><style>";
  out += plot::page_style() + kReportStyle;
  out += "</style></head><body><main>\n";
  for (const auto part : {head_part, waterfall_part, effects_part, location_part, unexplained_part, observed_part,
                          captures_part, scene_part, noise_part, maps_part, stimulus_part, limits_part}) {
    out += part(report);
    out += '\n';
  }
  return out + "</main></body></html>\n";
}

}  // namespace bolo::diagnose
