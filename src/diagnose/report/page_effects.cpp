// Effects, stimulus, noise, limits.
#include <algorithm>
#include <cmath>

#include "src/diagnose/report/page_parts.hpp"
#include "src/diagnose/report_output.hpp"
#include "src/report/scale.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

using plot::escaped;
using plot::figure_html;
using plot::format;
using plot::number_text;
using plot::unbroken;

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

// Kelvin statistics stand on one logarithmic axis, all below this at its left end.
constexpr double kLeastK = 1e-4;

double largest(const NoiseStatistic& one) {
  return std::max({std::abs(one.measured), std::abs(one.nominal), std::abs(one.explained)});
}

plot::Scale kelvin_axis(double top_k) {
  return {{.logarithmic = true, .low = kLeastK, .high = std::max(10.0 * kLeastK, 1.3 * top_k)}, {}, true};
}

// Of kelvin one axis for all; of anything else one that has zero on it and room on both sides.
plot::Scale noise_axis(const NoiseStatistic& one, double top_k) {
  if (one.unit == "K") return kelvin_axis(top_k);
  const double reach = std::max(0.1, 1.15 * largest(one));
  const bool both = std::min({one.measured, one.nominal, one.explained}) < 0.0;
  return {{.low = both ? -reach : 0.0, .high = reach}, {}, true};
}

std::string noise_number(const NoiseStatistic& one, double value) {
  return one.unit == "K" ? quantity("noise_k", value) : number_text(value) + (one.unit.empty() ? "" : ' ' + one.unit);
}

std::string dumbbell_row(const NoiseStatistic& one, double top_k) {
  const plot::Scale axis = noise_axis(one, top_k);
  const auto place = [&](double value) {
    const double share = axis.place(value);
    return std::isfinite(share) ? 100.0 * std::clamp(share, 0.0, 1.0) : 0.0;
  };
  const auto [low, high] = std::minmax({place(one.measured), place(one.nominal), place(one.explained)});
  std::string track;
  for (const plot::Tick& tick : axis.ticks(4)) track += format("<i style=\"left:%.2f%%\"></i>", place(tick.at));
  track += format("<b class=span style=\"left:%.2f%%;width:%.2f%%\"></b>", low, high - low);
  track += format(
      "<u class=nominal style=\"left:%.2f%%\"></u><u class=measured style=\"left:%.2f%%\"></u>"
      "<u class=explained style=\"left:%.2f%%\"></u>",
      place(one.nominal), place(one.measured), place(one.explained));
  std::string name = one.name;
  std::ranges::replace(name, '_', ' ');
  return "<div class=row><div class=name>" + escaped(name) + "</div><div class=track title=\"nominal " +
         noise_number(one, one.nominal) + ", measured " + noise_number(one, one.measured) + ", explained " +
         noise_number(one, one.explained) + "\">" + track + "</div><div class=value>" +
         noise_number(one, one.measured) + "</div></div>";
}

// The numbers below the rows of an axis.
std::string scale_row(const plot::Scale& axis, bool kelvin) {
  std::string out = "<div class=row><div class=\"name blank\"></div><div class=scale>";
  for (const plot::Tick& tick : axis.ticks(4)) {
    out += format("<span style=\"left:%.2f%%\">%s%s%s</span>", 100.0 * axis.place(tick.at),
                  kelvin && tick.at <= 1.001 * kLeastK ? "\u2264 " : "",
                  number_text(kelvin ? 1e3 * tick.at : tick.at).c_str(), kelvin ? " mK" : "");
  }
  return out + "</div><div class=\"value blank\"></div></div>";
}

std::string list_of(const std::vector<std::string>& items) {
  std::string out = "<ul>";
  for (const std::string& item : items) out += "<li>" + item + "</li>";
  return out + "</ul>";
}

}  // namespace

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

std::string noise_part(const Report& report) {
  if (report.noise.empty()) return {};
  double top_k = 0.0;
  for (const NoiseStatistic& one : report.noise) top_k = one.unit == "K" ? std::max(top_k, largest(one)) : top_k;
  std::string out =
      "<h2>The noise</h2><p class=soft>Three-dimensional noise on closed shutter and flats: sigma with an index t is "
      "new in each frame, v "
      "differs from row to row, h from column to column. Where the filled dot stands beside the ring, the camera's "
      "noise "
      "is not the nominal one; where the diamond covers the dot, the diagnosed effects account for it.</p>"
      "<div class=legend style=\"margin-bottom:6px\"><span>\u25cb nominal</span><span>\u25cf "
      "measured</span><span>\u25c6 with the "
      "effects</span></div>";
  std::string others;
  for (const NoiseStatistic& one : report.noise) {
    const bool kelvin = one.unit == "K";
    (kelvin ? out : others) += dumbbell_row(one, top_k);
    if (!kelvin) others += scale_row(noise_axis(one, top_k), false);
  }
  if (top_k > 0.0) out += scale_row(kelvin_axis(top_k), true);
  if (others.empty()) return out;
  return out + "<h3 style=\"margin-top:16px\">Without a unit</h3>" + others;
}

std::string maps_part(const Report& report) {
  std::string figures;
  for (const Map& map : report.maps) {
    std::string title = map.title;
    if (!title.empty() && title[0] >= 'a' && title[0] <= 'z') title[0] = static_cast<char>(title[0] - 'a' + 'A');
    plot::Plot figure = map_plot(map);
    figure.title = title;
    figure.caption = "Blank where there is no value.";
    figures += figure_html(figure);
  }
  if (figures.empty()) return {};
  return "<h2>What was diagnosed of single pixels</h2><div class=\"plots\">" + figures + "</div>";
}

std::string observed_part(const Report& report) {
  std::string out;
  for (const Observation& one : report.observations) {
    std::vector<std::string> items;
    for (const std::string& sentence : describe(one)) items.push_back(escaped(sentence));
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
  std::vector<std::string> items;
  for (const std::string& warning : report.warnings) items.push_back(escaped(warning));
  if (!items.empty()) out += "<h2>Warnings</h2>" + list_of(items);
  items.clear();
  for (const std::string& input : report.inputs) items.push_back("<code>" + escaped(input) + "</code>");
  if (!items.empty()) out += "<h2>Captures</h2>" + list_of(items);
  return out;
}

}  // namespace bolo::diagnose
