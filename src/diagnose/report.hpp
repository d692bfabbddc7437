// Results of a diagnosis of the gap between simulator and camera. docs/formats.md has the table of report.json.
//
// A gap is the root mean square of the residual on held-out cells, in units of the noise floor; at 1.0 prediction and
// camera cannot be told apart.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/model/camera_profile.hpp"
#include "src/report/plot.hpp"

namespace bolo::diagnose {

struct Estimate {
  double value = 0.0;
  double low = 0.0;  // 95 % confidence interval
  double high = 0.0;

  double error() const { return (high - low) / (2.0 * 1.96); }  // standard error
};

// Estimate with the interval value +- 1.96 standard errors.
inline Estimate interval(double value, double error) { return {value, value - 1.96 * error, value + 1.96 * error}; }

// Gaps without and with one effect, or all of them.
struct Gaps {
  double before = 1.0;
  double after = 1.0;
};

struct Alternative {
  std::string name;
  double gap_after = 0.0;  // if this effect had been chosen instead
};

struct FoundEffect {
  std::string name;   // name in the catalogue
  std::string stage;  // optics, radiometry, pixel, package, readout, firmware, transport, noise
  double confidence = 0.0;
  Gaps gap{0.0, 0.0};     // when it was added, in order of selection; the report lists the largest first
  bool of_noise = false;  // its gaps are those of the noise statistics
  std::map<std::string, Estimate> parameters;
  std::vector<Alternative> alternatives;
};

struct Location {
  std::string stage;
  std::map<std::string, double> captures;  // gap before, by file name
  int row_first = 0;
  int row_last = 0;
  int column_first = 0;
  int column_last = 0;
  double pixel_fraction = 0.0;  // share of pixels with a gap
  std::vector<std::pair<double, double>> time_s;
  std::pair<double, double> band_hz{0.0, 0.0};
  std::pair<double, double> temperature_k{0.0, 0.0};
};

struct Unexplained {
  double p_value = 1.0;  // of all omnibus tests together, corrected for their number
  std::string stage;     // empty when nothing is unexplained
  std::string where;     // one sentence
};

struct NotIdentifiable {
  std::string effect;
  std::string needs;  // the capture required to identify it
};

// One noise statistic, as in NVESD's 3-D noise (sigma_tvh and so on).
struct NoiseStatistic {
  std::string name;
  double measured = 0.0;   // K
  double nominal = 0.0;    // of the nominal simulator
  double explained = 0.0;  // with the diagnosed effects
};

struct PixelPlace {
  int x = 0;
  int y = 0;
  bool operator==(const PixelPlace&) const = default;
};

// Defective pixels of the whole frame.
struct PixelDefects {
  std::vector<PixelPlace> stuck;  // hardly change in any capture
  std::vector<PixelPlace> noisy;  // show nothing but noise
};

// Camera parameters from the motion of an unknown scene (field_parts.hpp).
struct FromMotion {
  std::size_t frames = 0;   // with known motion
  double usual_px_s = 0.0;  // median speed of the picture's centre
  double fastest_px_s = 0.0;
  // Gaps with the profile's value and with this one, in noise floors.
  struct Figure {
    Estimate value;
    Gaps gap;
  };
  std::optional<Figure> tau_s;        // nothing: too little or too even motion
  std::optional<Figure> row_delay_s;  // per sensor row
};

// Observations of pixels and whole frames in a capture without a model: without a stimulus, or in counts. Frames count
// from 0; sizes are in `unit`.
struct Observation {
  struct Jump {
    std::size_t frame = 0;  // the first frame after the jump
    double size = 0.0;
  };
  std::string file;
  std::string unit;  // K, count
  std::size_t frames = 0;
  std::vector<Jump> jumps;                                   // of all pixels at once
  std::vector<std::pair<std::size_t, std::size_t>> freezes;  // first and last frame that repeats the one before
  std::vector<std::size_t> repeated;                         // repeated frames outside freezes
  std::vector<std::size_t> lost_before;                      // frames preceded by a leap of the moving scene
  double noise = 0.0;                                        // of one pixel between frames, sigma
  double flicker = 0.0;                                      // of whole frames, sigma; includes motion in the scene
  double column_pattern = 0.0;  // fixed, sigma; 0: none that both halves of the frame share
  double row_pattern = 0.0;
  std::vector<PixelPlace> outliers;  // hotter or colder than all neighbours by more than these differ
  std::optional<FromMotion> motion;
};

// A predicted capture and its plots.
struct CapturePlots {
  std::string file;  // name without folders
  std::string kind;  // uniform, chopper, bar_target
  Gaps gap{0.0, 0.0};
  std::vector<plot::Plot> plots;
};

// Corrections for the pipeline that a diagnosis suggests.
struct Learned {
  // The initial profile, updated by findings that concern the whole camera. Its `maps` is unchanged.
  model::CameraProfile profile;
  // Per-pixel corrections of the full frame if Options::maps is set. The camera shows (1 + g) T - g R + o of a
  // temperature T, R being the gains' reference, so gain = 1 / (1 + g) and offset = (g R - o) / (1 + g). An empty map:
  // no such effect. row_delay_s is in the profile.
  model::PixelMaps maps;
};

struct Report {
  std::vector<std::string> inputs;
  Gaps gap;
  double closed_fraction = 0.0;  // (before - after) / (before - 1), 0 when there was no gap
  // One of: no_gap, explained, partly_explained, unknown_effect; not_testable: no capture has a model, gaps are NaN and
  // `needs` names suitable ones; bench_description: /stimulus contradicts the pictures, gaps are NaN, no effect is
  // named and `needs` has a matching description.
  std::string verdict = "no_gap";
  std::string needs;
  bool tested() const { return verdict != "not_testable" && verdict != "bench_description"; }
  std::vector<FoundEffect> effects;
  Location location;
  std::map<std::string, std::map<std::string, double>> stimulus;  // errors of the stimulus, by file name
  Unexplained unexplained;
  std::vector<NotIdentifiable> not_identifiable;
  std::vector<std::string> warnings;  // excluded captures, with reasons
  std::vector<std::string> withheld;  // effects removed from the catalogue
  bool kelvin = true;                 // false: captures in counts, as are all figures whose name ends in _k
  double noise_floor_k = 0.0;
  Gaps noise_gap;  // of the noise statistics
  std::vector<NoiseStatistic> noise;
  PixelDefects defects;
  std::vector<Observation> observations;  // of captures without a model
  std::vector<CapturePlots> captures;
  std::vector<plot::Plot> maps;  // diagnosed offsets, gains, time constants, dead pixels
  // One frame of a tracked field recording, original and corrected for the pixels' offsets; below, its residual against
  // other frames, before and after the correction. Empty: none was tracked.
  plot::Rows scene;
  Learned learned;       // for the pipeline
  double seconds = 0.0;  // duration of the diagnosis
  std::size_t frames = 0;
};

// --- The report as files, as a page and as text. Thread: any, except for write_report().

// report.json as one line of text.
std::string report_json(const Report& report);

std::string report_html(const Report& report);

// Paths of the report's files in `folder`: report.json, report.html, and scene.svg (tracked field recordings only).
std::vector<std::filesystem::path> report_files(const std::filesystem::path& folder);

// Writes report_files() and creates the folder. Thread: setup.
Status write_report(const Report& report, const std::filesystem::path& folder, Replace replace);

struct Wording {
  bool utf8 = false;   // use a micro sign
  bool kelvin = true;  // false: values of keys ending in _k are in counts
};

// A value of the parameter `key` with its unit: "27.9 us", "12 %". The unit follows from the ending of the key (_s, _k,
// _hz, _px) or, for shares and the like, from the whole key.
std::string quantity(const std::string& key, double value, Wording wording = {});

// Value and 95 % interval in the same unit: "27.9 us (26.0 to 30.1)".
std::string quantity(const std::string& key, const Estimate& estimate, Wording wording = {});

// "tau_global" -> "Time constant". Of an unknown name, underscores are replaced by blanks.
std::string effect_title(const std::string& name);

// A sentence about the effect, with its numbers: "Rows are sampled 27.9 us after one another".
std::string effect_sentence(const FoundEffect& effect, Wording wording = {});

// The verdict in one or two sentences.
std::string headline(const Report& report, bool utf8 = false);

// A gap as text: "7.9", "1.02"; and two: "7.9 -> 1.02".
std::string gap_text(double gap);
std::string gap_text(const Gaps& gap, const char* between = " -> ");

// The observations, one sentence each: jumps with their frames, freezes, noise, patterns, outliers.
std::vector<std::string> describe(const Observation& observation);

// "3 stuck: (12, 5), (100, 40), (7, 81)": the first few places; noisy ones likewise.
std::vector<std::string> describe(const PixelDefects& defects);

// A summary of a few lines for a terminal: verdict, effects, gap, stimulus, unidentifiable effects, warnings.
std::string report_summary(const Report& report);

}  // namespace bolo::diagnose
