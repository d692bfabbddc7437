// The report as sentences and readable numbers.
#include "src/diagnose/effect.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

using plot::format;

// Unit in which a value is readable.
struct ShownUnit {
  double factor = 1.0;
  const char* text = "";
};

ShownUnit unit_of(std::string_view key, double value, Wording wording) {
  constexpr std::array<std::string_view, 7> kShares{"velocity_error", "velocity_unevenness", "rms",     "share",
                                                    "fraction",       "corner_loss",         "coupling"};
  const double size = std::abs(value);
  if (key.ends_with("_s")) {
    if (size > 0.0 && size < 1e-3) return {1e6, wording.utf8 ? " \u00b5s" : " us"};
    return size < 1.0 ? ShownUnit{1e3, " ms"} : ShownUnit{1.0, " s"};
  }
  if (key.ends_with("_k") && !wording.kelvin) return {1.0, " counts"};
  if (key.ends_with("_k")) return size < 0.5 ? ShownUnit{1e3, " mK"} : ShownUnit{1.0, " K"};
  if (key.ends_with("_hz")) return {1.0, " Hz"};
  if (key.ends_with("_px")) return {1.0, " px"};
  if (key == "skew") return {1e6, " ppm"};
  return std::ranges::count(kShares, key) != 0 ? ShownUnit{100.0, " %"} : ShownUnit{};
}

// Three significant digits, without an exponent for usual values.
std::string digits(double value) {
  if (!std::isfinite(value)) return "?";
  const double size = std::abs(value);
  if (size >= 1e6 || (size > 0.0 && size < 1e-4)) return format("%.2e", value);
  return size >= 99.95 ? format("%.0f", value) : format("%.3g", value);
}

// Decimals that show three digits of the value, or the first digit of its uncertainty if that is finer.
int decimals_for(double value, double half) {
  const auto place = [](double size) { return -static_cast<int>(std::floor(std::log10(size))); };
  int decimals = 0;
  if (std::isfinite(value) && value != 0.0) decimals = place(std::abs(value)) + 2;
  if (std::isfinite(half) && half > 0.0) decimals = std::max(decimals, place(half));
  return std::clamp(decimals, 0, 6);
}

std::string fixed(double value, int decimals) { return std::isfinite(value) ? format("%.*f", decimals, value) : "?"; }

// Text of a placeholder; nothing when the parameter is missing.
std::optional<std::string> place(const FoundEffect& effect, const std::string& inner, Wording wording) {
  const std::string key = inner.substr(0, inner.find_first_of("~?%"));
  const auto found = effect.parameters.find(key);
  if (found == effect.parameters.end() || !std::isfinite(found->second.value)) return std::nullopt;
  const double value = found->second.value;
  const std::string rest = inner.substr(key.size());
  if (rest == "~") return digits(100.0 * std::abs(value - 1.0)) + " %";
  if (rest == "%") return digits(100.0 * value) + " %";
  if (rest.starts_with('?')) {
    const std::size_t bar = rest.find('|');
    const double neutral = key == "scale" ? 1.0 : 0.0;
    return value >= neutral ? rest.substr(1, bar - 1) : rest.substr(bar + 1);
  }
  const bool is_signless = key == "skew";
  return quantity(key, is_signless ? std::abs(value) : value, wording);
}

// Replaces each part between these brackets by inner(part).
template <typename Inner>
std::optional<std::string> replaced(std::string_view words, char open, char close, const Inner& inner) {
  std::string out;
  while (true) {
    const std::size_t from = words.find(open);
    out += words.substr(0, from);
    if (from == std::string_view::npos) return out;
    const std::size_t to = words.find(close, from);
    const std::optional<std::string> text = inner(std::string(words.substr(from + 1, to - from - 1)));
    if (!text) return std::nullopt;
    out += *text;
    words.remove_prefix(to + 1);
  }
}

std::string percent(double fraction) {
  const double value = 100.0 * fraction;
  return format(value > 99.5 && value < 99.95 ? "%.1f %%" : "%.0f %%", value);
}

std::string joined(const std::vector<std::string>& parts) {
  std::string text;
  for (const std::string& part : parts) text += (text.empty() ? "" : ", ") + part;
  return text;
}

std::string lower_first(std::string text) {
  if (text.size() > 1 && text[0] >= 'A' && text[0] <= 'Z' && (text[1] < 'A' || text[1] > 'Z')) {
    text[0] = static_cast<char>(text[0] - 'A' + 'a');
  }
  return text;
}

// Clause on the reduction of the gap by the effects.
std::string closing(const Report& report) {
  const std::string these = report.effects.size() == 1 ? "this" : "these";
  if (std::ranges::all_of(report.effects, &FoundEffect::of_noise) || !(report.gap.before > 1.0)) {
    return "adding " + these + " brings the noise's statistics from " + gap_text(report.noise_gap, " to ") +
           " of what was expected";
  }
  return "adding " + these + " closes " + percent(report.closed_fraction) + " of the gap";
}

std::string left_over(const Report& report) {
  std::string text = "Something is left that no effect in the catalogue explains";
  if (!report.unexplained.where.empty()) text += ": " + lower_first(report.unexplained.where);
  return text;
}

std::string found(const Report& report, bool utf8) {
  std::string text = effect_sentence(report.effects.front(), {utf8, report.kelvin}) + "; ";
  for (std::size_t i = 1; i < report.effects.size(); ++i) {
    text += i == 1 ? "with it come " : i + 1 == report.effects.size() ? " and " : ", ";
    text += lower_first(effect_title(report.effects[i].name));
  }
  return text + (report.effects.size() == 1 ? "" : "; ") + closing(report);
}

std::string sentence_end(std::string text) {
  if (!text.empty() && text.back() != '.') text += '.';
  return text;
}

void add_line(std::string& out, const std::string& name, const std::string& text) {
  out += "  " + name + std::string(name.size() < 12 ? 12 - name.size() : 1, ' ') + text + '\n';
}

std::string parameters_text(const FoundEffect& effect, Wording wording) {
  return joined(mapped(effect.parameters,
                       [&](const auto& one) { return one.first + ' ' + quantity(one.first, one.second, wording); }));
}

std::string amount(double value, const std::string& unit) { return quantity("size_k", value, {.kelvin = unit == "K"}); }

template <typename T>
std::span<const T> first_of(const std::vector<T>& all, std::size_t most) {
  return std::span(all).first(std::min(most, all.size()));
}

std::string jumps_text(const Observation& one) {
  constexpr std::size_t kMost = 12;
  return std::to_string(one.jumps.size()) + (one.jumps.size() == 1 ? " jump" : " jumps") + " of the whole picture: " +
         joined(mapped(first_of(one.jumps, kMost),
                       [&](const Observation::Jump& jump) {
                         return amount(jump.size, one.unit) + " at frame " + std::to_string(jump.frame);
                       })) +
         (one.jumps.size() > kMost ? ", ..." : "");
}

std::string pattern_text(const Observation& one) {
  std::vector<std::string> parts;
  if (one.column_pattern > 0.0) parts.push_back("columns by " + amount(one.column_pattern, one.unit));
  if (one.row_pattern > 0.0) parts.push_back("rows by " + amount(one.row_pattern, one.unit));
  return parts.empty() ? "" : "a fixed pattern (or lines of the scene): " + joined(parts) + " rms";
}

std::string frames_text(const std::vector<std::size_t>& frames, const char* what) {
  constexpr std::size_t kMost = 8;
  return format("%zu frames %s: ", frames.size(), what) +
         joined(mapped(first_of(frames, kMost), [](std::size_t k) { return std::to_string(k); })) +
         (frames.size() > kMost ? ", ..." : "");
}

std::string interval_text(const char* name, const Estimate& e, double factor, const char* unit) {
  return format("%s %.2f %s (%.2f to %.2f)", name, e.value * factor, unit, e.low * factor, e.high * factor);
}

std::string motion_text(const FromMotion& motion) {
  std::vector<std::string> parts{format("the scene moves by %.0f px/s, at most %.0f (%zu frames)", motion.usual_px_s,
                                        motion.fastest_px_s, motion.frames)};
  if (motion.tau_s)
    parts.push_back(interval_text("the pixel's equation: time constant", motion.tau_s->value, 1e3, "ms"));
  if (motion.row_delay_s) {
    parts.push_back(interval_text("shear against acceleration: delay of a row", motion.row_delay_s->value, 1e6, "us"));
  }
  if (!motion.tau_s)
    parts.emplace_back("too little is seen, or moves too little or too evenly, to tell the time constant");
  return joined(parts);
}

void add_places(const std::vector<PixelPlace>& pixels, const char* what, std::vector<std::string>& out) {
  constexpr std::size_t kMost = 8;
  if (pixels.empty()) return;
  std::string text = std::to_string(pixels.size()) + ' ' + what + ':';
  for (const auto& [x, y] : first_of(pixels, kMost)) text += format(" (%d, %d)", x, y);
  out.push_back(text + (pixels.size() > kMost ? " ..." : ""));
}

}  // namespace

std::vector<std::string> describe(const PixelDefects& defects) {
  std::vector<std::string> all;
  add_places(defects.stuck, "stuck", all);
  add_places(defects.noisy, "noisy", all);
  return all;
}

std::vector<std::string> describe(const Observation& one) {
  std::vector<std::string> all;
  if (!one.jumps.empty()) all.push_back(jumps_text(one));
  for (const auto& [first, last] : one.freezes) {
    all.push_back(format("frozen from frame %zu to %zu of %zu", first, last, one.frames));
  }
  if (!one.repeated.empty()) all.push_back(frames_text(one.repeated, "repeated"));
  if (!one.lost_before.empty()) all.push_back(frames_text(one.lost_before, "after a loss"));
  if (std::isfinite(one.noise)) {
    all.push_back("noise of a pixel " + amount(one.noise, one.unit) + ", of whole frames " +
                  amount(one.flicker, one.unit) + " (motion adds to both)");
  }
  if (std::string pattern = pattern_text(one); !pattern.empty()) all.push_back(std::move(pattern));
  if (one.motion) all.push_back(motion_text(*one.motion));
  add_places(one.outliers, "pixels stand out of all their neighbours", all);
  return all;
}

std::string quantity(const std::string& key, double value, Wording wording) {
  const ShownUnit unit = unit_of(key, value, wording);
  return digits(value * unit.factor) + unit.text;
}

std::string quantity(const std::string& key, const Estimate& estimate, Wording wording) {
  const ShownUnit unit = unit_of(key, estimate.value, wording);
  const double value = estimate.value * unit.factor;
  const double half = 0.5 * unit.factor * (estimate.high - estimate.low);
  const int decimals = decimals_for(value, half);
  return fixed(value, decimals) + unit.text + " (" + fixed(estimate.low * unit.factor, decimals) + " to " +
         fixed(estimate.high * unit.factor, decimals) + ")";
}

std::string effect_title(const std::string& name) {
  const Effect* const effect = find_effect(name);
  std::string title = effect != nullptr && !effect->words.title.empty() ? effect->words.title : name;
  std::ranges::replace(title, '_', ' ');
  return title;
}

std::string effect_sentence(const FoundEffect& effect, Wording wording) {
  const Effect* const known = find_effect(effect.name);
  if (known == nullptr || known->words.plain.empty()) return effect_title(effect.name) + " is at work";
  const auto number = [&](const std::string& key) { return place(effect, key, wording); };
  return *replaced(known->words.plain, '[', ']', [&](const std::string& part) {
    const std::size_t bar = std::min(part.find('|', part.rfind('}')), part.size());
    return replaced(part.substr(0, bar), '{', '}', number).value_or(part.substr(std::min(bar + 1, part.size())));
  });
}

std::string gap_text(double gap) { return fixed(gap, gap < 1.995 ? 2 : gap < 99.5 ? 1 : 0); }

std::string gap_text(const Gaps& gap, const char* between) {
  return gap_text(gap.before) + between + gap_text(gap.after);
}

std::string headline(const Report& report, bool utf8) {
  if (report.verdict == "not_testable") {
    return "The simulator was not tested: nothing in these captures is known well enough to be predicted. Needed: " +
           sentence_end(report.needs);
  }
  if (report.verdict == "bench_description") {
    return "The bench is not as its file says, so that nothing is said of the camera: " + sentence_end(report.needs);
  }
  if (report.verdict == "no_gap") {
    return "The simulator cannot be told from the camera in these captures: nothing needs to be added.";
  }
  if (report.effects.empty()) return sentence_end(left_over(report));
  if (report.verdict == "unknown_effect") {
    return sentence_end(left_over(report)) + " Beside it: " + lower_first(found(report, utf8)) + ".";
  }
  std::string text = found(report, utf8) + ".";
  if (report.verdict == "partly_explained") text += ' ' + sentence_end(left_over(report));
  return text;
}

std::string report_summary(const Report& report) {
  const Wording wording{.kelvin = report.kelvin};
  std::string out = headline(report) + '\n';
  add_line(out, "verdict", report.verdict);
  if (report.tested()) {
    add_line(out, "gap", gap_text(report.gap) + " noise floors (1.00: none)");
  }
  if (std::isfinite(report.noise_gap.before)) {
    add_line(out, "noise",
             gap_text(report.noise_gap) + " of its own statistics, floor " +
                 quantity("floor_k", report.noise_floor_k, wording));
  }
  for (const FoundEffect& effect : report.effects) {
    std::string text = effect.name + " (" + effect.stage + ", " + percent(effect.confidence) + " sure)";
    if (std::isfinite(effect.gap.before)) {
      text += ": gap " + gap_text(effect.gap);
      text += effect.of_noise ? " of noise" : "";
    }
    add_line(out, "effect", text);
    if (!effect.parameters.empty()) add_line(out, "", parameters_text(effect, wording));
  }
  for (const Observation& one : report.observations) {
    for (const std::string& sentence : describe(one)) add_line(out, "seen", one.file + ": " + sentence);
  }
  for (const std::string& places : describe(report.defects)) add_line(out, "pixels", places);
  for (const auto& [file, errors] : report.stimulus) {
    const auto parts =
        mapped(errors, [&](const auto& one) { return one.first + ' ' + quantity(one.first, one.second, wording); });
    add_line(out, "stimulus", file + ": " + joined(parts));
  }
  if (!report.unexplained.where.empty()) add_line(out, "unexplained", report.unexplained.where);
  for (const NotIdentifiable& one : report.not_identifiable) {
    add_line(out, "cannot tell", one.effect + (one.needs.empty() ? "" : ": needs " + one.needs));
  }
  for (const std::string& warning : report.warnings) add_line(out, "warning", warning);
  return out;
}

}  // namespace bolo::diagnose
