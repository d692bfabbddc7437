// The diagnosis as stages, each a function of those before: Session -> Events -> Noise -> Fit -> Remainders -> Report;
// and their parts.
#pragma once

#include "src/diagnose/fit.hpp"

namespace bolo::diagnose {

// --- Events

struct Freeze {  // frames [first, last] repeat the one before
  std::size_t recording = 0;
  std::size_t first = 0;
  std::size_t last = 0;
};
// True if a freeze ends just before this frame.
bool thaws(const std::vector<Freeze>& freezes, std::size_t recording, std::size_t frame);

// A step of the offset at one frame: global, or of each pixel.
struct Jump {
  std::size_t recording = 0;
  std::size_t frame = 0;  // the first one after it
  double global_k = 0.0;
  double pixel_k = 0.0;  // rms over the pixels about the global step; 0: uniform
  bool after_freeze = false;
};

struct BadPixels {
  std::vector<int> stuck;  // of the frame, row-major
  std::vector<int> noisy;
  std::vector<int> jumping;                 // of the grid: between two levels
  double step_k = 0.0;                      // of the jumping ones, median
  Mask dead(const Session& session) const;  // the stuck, the noisy and the known ones
};

inline constexpr std::size_t kFreezeFrames = 12;  // shorter runs are repeated frames

// Runs of `wanted` among the flags: the first, and one past the last. Thread: any.
std::vector<std::pair<std::size_t, std::size_t>> runs_of(const std::vector<char>& flags, char wanted);
// Values (of the frame, row-major) of the up to eight pixels around one. Thread: any.
std::vector<double> values_around(const FrameStatistics& statistics, const std::vector<float>& values, PixelPlace at);

// The long runs of identical frames; frames of short ones are counted in `repeated_frames`. Marks all but the first of
// each run as not used.
std::vector<Freeze> find_freezes(Session& session, std::vector<std::size_t>& repeated_frames);

// Stuck and noisy pixels of the whole frame; then, after removal of jumps, those that jump between two levels by more
// than rounding to `step_k` causes. Marked in session.good. `of`: kind of the judged recordings.
BadPixels find_dead_pixels(Session& session);
void find_jumping_pixels(Session& session, BadPixels& bad, double step_k = 0.0, Kind of = Kind::kUniform);
// Pixels of the frame with far more random scatter than most. Thread: any.
std::vector<int> noisy_pixels(const FrameStatistics& statistics);
// Marks the grid's stuck and noisy pixels in session.good. Thread: one at a time.
void leave_out_dead(Session& session, const BadPixels& bad);

// The most significant step in a series of residuals (frames x pixels of the grid, K), or of a uniform recording's
// values. `levels`: each stimulus level's contribution to the frames (frames x levels), since fitted levels absorb a
// part of every jump; empty: one constant level. `shown`: the predicted mean of each frame: where it leaps itself, a
// small difference is no jump; empty: constant.
std::optional<Jump> find_jump(const Session& session, std::size_t recording, const Series& residual,
                              const std::vector<Freeze>& freezes, const MatrixXd& levels = {},
                              const VectorXd& shown = {});

// Removes a jump from the recording's values; each pixel's step is estimated from `residual` (all pixels of the grid).
void remove_jump(Session& session, Jump& jump, const Series& residual, const MatrixXd& levels = {});

// The common step of all values of the recordings.
double find_step(const Session& session);

// Level at which a recording's values are clipped; infinity: none.
double find_ceiling(const Recording& recording, double level_step);

// Observations on a recording without a model of the scene: jumps, freezes, flicker, noise, patterns and outlier
// pixels. Thread: any.
Observation observe(const Recording& recording);
// Frames at which nearly all pixels changed in one direction, by far more than usual. `noise`: standard deviation of
// one value. Thread: any.
std::vector<Observation::Jump> jumps_among(const FrameStatistics& statistics, double noise);

// --- Noise

// An estimate and its significance against 0, in standard errors.
struct Measured {
  double value = 0.0;
  double error = 0.0;
  double z = 0.0;
  Estimate estimate() const { return interval(value, error); }
};

// Components of the temporal noise (NVESD's 3-D noise): independent in pixel and frame (tvh), a whole frame (t), a row
// (tv) and a column (th) in each frame.
struct NoiseStatistics {
  std::size_t frames = 0;  // of still recordings; 0: unknown
  double total_k = 0.0;    // rms of a value about its pixel's mean: the noise floor
  double sigma_tvh = 0.0;
  Measured flicker;  // sigma_t
  Measured rows;     // sigma_tv
  Measured columns;  // sigma_th
  // Whittle's likelihood of the pixels' spectra.
  double white_k = 0.0;  // of the white part, before the frame filter
  Measured corner_hz;    // 1/f noise equals the white noise there
  Measured alpha;        // of the frame filter; value 1: none
  FrameFilter filter = FrameFilter::kNone;
  double spectrum_misfit = 0.0;  // largest |z| of a band of the spectrum against the fit
  // Tails.
  Measured excess_kurtosis;                                  // median over the pixels
  double degrees = std::numeric_limits<double>::infinity();  // of Student's t
  double degrees_error = 0.0;
  // Signs of effects outside the catalogue.
  double neighbour_row_z = 0.0;     // correlation with the pixel to the left
  double neighbour_column_z = 0.0;  // with the pixel above
  double line_hz = 0.0;
  double line_p = 1.0;  // of the strongest line in the frames' means or in the difference of their halves
  // Slow change of the offset, a cubic in each recording.
  double drift_p = 1.0;
  double drift_k = 0.0;
};

// Of all uniform recordings (if none, of still ones without a stimulus), after removal of jumps and marking of bad
// pixels. `ceiling`: recordings with values there are excluded.
NoiseStatistics measure_noise(const Session& session, double ceiling);

// True if the camera is still: neighbours share little of their changes, and a quarter of the pixels vary no more
// than noise.
bool is_still(const Session& session, const Recording& recording);

// A bin of a spectrum.
struct Bin {
  double frequency = 0.0;  // Hz
  double power = 0.0;      // mean over pixels
  double weight = 0.0;     // half the degrees of freedom
};

// Fits the spectrum (in order of frequency) by Whittle's likelihood and writes white noise, corner, filter and misfit.
// `rounding`: variance that the steps between stored values add, behind the frame filter.
void judge_spectrum(const std::vector<Bin>& spectrum, double rate_hz, double rounding, NoiseStatistics& noise);

// Fits degrees of freedom and scale by likelihood to values without their means; n.sigma_tvh is known.
void fit_student(const std::vector<double>& x, NoiseStatistics& n);

// Power in each bin from 0 to half the sampling rate through Hann's window; white noise has its variance in every bin.
std::vector<double> periodogram(const ArrayXd& x);

// --- Timing

// Initial phases and delays of the recordings for a fit: moving bars frame by frame, still bars, choppers. Returns each
// recording's correlation with its stimulus, 1 without a pattern.
std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels);

// Contradictions between the files' bench description and the pictures, with a better description: signs, factors, hot
// and cold exchanged. One line each; empty: it fits, or no other fits better. `state`: as registered.
std::vector<std::string> doubt_description(const Session& session, const State& state, std::span<const int> pixels);

// The local speed of moving bars from their shifts: straight lines over some 20 frames.
void smooth_speeds(const Session& session, State& state);

struct Transport {
  int lost = 0;           // frames, in all recordings
  int inserted = 0;       // extra frames, not counting identical ones
  double jitter_s = 0.0;  // rms, corrected for the measurement's scatter
  double jitter_error_s = 0.0;
  double measured_s = 0.0;  // scatter of the measurement
};

// Finds steps of whole frame periods and the jitter of the rest. Writes each frame's lateness (steps only) to
// state.stimuli[].late_s; choppers are registered again.
Transport judge_transport(const Session& session, State& state, double floor_k, std::span<const int> pixels);

// The jitter of frames by the shifts of moving bars in `state`. Model errors scatter shifts, so this is repeated once
// the effects are known.
void judge_jitter(const Session& session, const State& state, double floor_k, std::span<const int> pixels,
                  Transport& transport);
bool is_jittered(const Transport& transport);

// The state without transport effects: smooth shifts, no late frames.
State without_transport(const Session& session, const State& state);

// --- Stages

// A significant remainder that no effect explains: found by a test of the residual, or due to a withheld effect.
struct Remainder {
  std::string stage;
  std::string where;  // one sentence
  double z = 0.0;     // in standard errors
  // Of a misfit of unspecific cause: its kind of capture, and true if it is confined to the target's edges.
  std::optional<Kind> misfit{};
  bool at_edges = false;
};

// Significance limit in standard errors: from effect-free sessions.
inline constexpr double kRemainderLimit = 5.5;
// The same of 1/f noise, which has few bins.
inline constexpr double kClearCorner = 5.0;

// An effect found by its own statistics, and its remainder if it is withheld: standard errors and sentence.
struct Finding {
  FoundEffect effect;
  double z = 0.0;
  std::string where;
};

// A stage's part of the report.
struct Findings {
  std::vector<Finding> effects;
  std::vector<Remainder> remainders;
  std::vector<std::string> warnings;
  // Adds an effect of the catalogue; the default confidence is that of `z`. Returns it, to be completed.
  FoundEffect& add(const std::string& name, double z, const std::string& where, Estimates parameters,
                   std::optional<double> confidence = std::nullopt);
};

// An effect of the catalogue, as found. Thread: any.
FoundEffect named(const std::string& name, double confidence, Estimates parameters = {});
bool allowed(const Options& options, const std::string& name);

// Events of whole frames and pixels.
struct Events {
  Session session;  // without its jumps; repeated frames and bad pixels are marked
  Session raw;      // as read
  std::vector<Freeze> freezes;
  std::vector<std::size_t> repeated;  // repeated frames of each recording
  std::vector<Jump> jumps;            // removed
  BadPixels bad;
  double step_k = 0.0;  // between values
  bool coarse = false;  // that step is coarser than the profile's
  double ceiling_k = std::numeric_limits<double>::infinity();
  std::vector<std::string> warnings;
};
Events find_events(Session session, const Options& options);

// The noise's own statistics and the effects they identify.
struct Noise {
  NoiseStatistics statistics;
  double nominal_k = 0.0;  // of one value, rms, by the profile; measured if not radiometric
  double floor_k = 0.03;
  Findings findings;
};
Noise judge_noise(const Events& events, const Options& options);

// The mean: stimulus, transport, effects of the catalogue.
struct Fit {
  Session session;  // as that of the events, less jumps found by prediction only
  Session raw;
  std::vector<Jump> jumps;
  std::vector<std::string> wrong_description;  // of the bench: then there is no fit
  bool done = false;                           // false: no data to fit, and the rest is empty
  State nominal;                               // with the errors of the stimuli but no effects of the camera
  State state;
  FitResult base;  // the stimuli alone
  Selection selection;
  Score before;  // of `nominal`
  Findings findings;
};
Result<Fit> fit_means(const Events& events, const Noise& noise, const Options& options, const Progress& progress);

// Omnibus tests of the residual, which locate remainders but name no effect.
std::vector<Remainder> test_remainder(const Events& events, const Noise& noise, const Fit& fit, int threads);

// The stage that misfits indicate by their captures and by those that fit.
std::string stage_of_misfits(std::span<const Remainder> remainders);

// The report.
struct Field;  // field.hpp
Report make_report(const Events& events, const Noise& noise, const Fit& fit, const Field& field,
                   const std::vector<Remainder>& left, const Options& options);
// Fills report.captures, report.maps and the rest of report.location.
void fill_plots(const Fit& fit, double floor_k, Report& report);

// A frame of a tracked recording, and how far other frames miss it; K or counts.
struct SceneFrame {
  Geometry geometry;
  ArrayXf came{};
  ArrayXf corrected{};  // without the pixels' offsets
  ArrayXf missed{};
  ArrayXf left{};  // of it, when corrected
};
// Before and after beside each other: the frame, its most even part, where a pattern shows best, and the residual.
plot::Rows scene_plots(const SceneFrame& frame);

// One pixel in time, s and K; the plots show the largest deviation from the nominal simulator.
struct Course {
  std::vector<double> t_s;
  std::vector<double> measured;
  std::vector<double> nominal;
  std::vector<double> predicted;
};
std::vector<plot::Plot> course_plots(const Course& course, double floor_k);

// Offsets and gains of all pixels as a moving scene tells them, row-major, K or counts; empty: not told.
struct FieldMaps {
  ArrayXf offset{};
  ArrayXf gain{};   // share; 0: unknown
  ArrayXf level{};  // of the scene at each pixel, at which its gain adds nothing to its offset
};

// Findings on the camera, from which maps and profile are learned.
struct LearnTask {
  const Session& session;
  const State* state = nullptr;  // as fitted; null: no fit
  const std::vector<Jump>& jumps;
  const BadPixels& bad;
  FrameFilter filter = FrameFilter::kNone;
  const FieldMaps& field;  // used without a fit
  const std::vector<FoundEffect>& effects;
  const model::CameraProfile& profile;

  const FoundEffect* found(std::string_view name) const;
};

// Learned::maps. Offset, gain and time constant of each pixel by regression on all frames that have a model, with the
// fitted stimuli; smooth effects (vignetting, heating) from their fitted shapes; dead pixels as found. Without a fit,
// offset and gain are those of a moving scene. The session's captures are read again. Thread: setup.
Result<model::PixelMaps> learn_maps(const LearnTask& task, int threads);

}  // namespace bolo::diagnose
