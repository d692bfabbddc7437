// Stages of the diagnosis, each a function of earlier ones: Session -> Events -> Noise -> Fit -> Remainders -> Report.
#pragma once

#include "src/diagnose/fit.hpp"

namespace bolo::diagnose {

// --- Events

struct Freeze {  // frames [first, last] are identical to the one before
  std::size_t recording = 0;
  std::size_t first = 0;
  std::size_t last = 0;
};
// True if a freeze ends just before this frame.
bool thaws(const std::vector<Freeze>& freezes, std::size_t recording, std::size_t frame);

// A step of the offset at one frame: global, or of each pixel.
struct Jump {
  std::size_t recording = 0;
  std::size_t frame = 0;  // the first frame after the jump
  double global_k = 0.0;
  double pixel_k = 0.0;  // rms over the pixels, relative to the global step; 0: uniform
  bool after_freeze = false;
};

struct BadPixels {
  std::vector<int> stuck;  // in the frame, row-major
  std::vector<int> noisy;
  std::vector<int> jumping;                 // in the grid: hop between two levels
  double step_k = 0.0;                      // median step of the jumping ones
  Mask dead(const Session& session) const;  // stuck, noisy and known dead ones
};

inline constexpr std::size_t kFreezeFrames = 12;  // shorter runs are repeats

// Runs of flags equal to `wanted`: first index, and one past the last. Thread: any.
std::vector<std::pair<std::size_t, std::size_t>> runs_of(const std::vector<char>& flags, char wanted);
// Values (row-major, of the frame) of the up to eight neighbours of a pixel. Thread: any.
std::vector<double> values_around(const FrameStatistics& statistics, const std::vector<float>& values, PixelPlace at);

// Finds long runs of identical frames; `repeated_frames` counts frames of short ones. Only a run's first stays used.
std::vector<Freeze> find_freezes(Session& session, std::vector<std::size_t>& repeated_frames);

// Stuck and noisy pixels of the whole frame; after jumps are removed, those that hop between two levels by more than
// rounding to `step_k` causes. Marks them in session.good. `of`: kind of recordings to judge.
BadPixels find_dead_pixels(Session& session);
void find_jumping_pixels(Session& session, BadPixels& bad, double step_k = 0.0, Kind of = Kind::kUniform);
// Pixels of the frame with far more random scatter than most. Thread: any.
std::vector<int> noisy_pixels(const FrameStatistics& statistics);
// Marks the grid's stuck and noisy pixels in session.good. Thread: one at a time.
void leave_out_dead(Session& session, const BadPixels& bad);

// The most significant step in a series of residuals (frames x pixels of the grid, K) or in the values of a uniform
// recording. `levels`: contribution of each stimulus level to the frames (frames x levels), since fitted levels absorb
// a part of every jump; empty: one constant level. `shown`: predicted mean of each frame; where that changes abruptly,
// a small difference is no jump; empty: constant.
std::optional<Jump> find_jump(const Session& session, std::size_t recording, const Series& residual,
                              const std::vector<Freeze>& freezes, const MatrixXd& levels = {},
                              const VectorXd& shown = {});

// Removes a jump from its recording's values; each pixel's step is estimated from `residual` (all pixels of the grid).
void remove_jump(Session& session, Jump& jump, const Series& residual, const MatrixXd& levels = {});

// Spacing of the values in all recordings.
double find_step(const Session& session);

// Lowest level at which a recording's values are clipped; infinity: none.
double find_ceiling(const Session& session, double level_step);

// Observes jumps, freezes, flicker, noise, patterns and outlier pixels without a model of the scene. Thread: any.
Observation observe(const Recording& recording);
// Frames in which nearly all pixels jump the same way, far more than usual. `noise`: sigma of one value. Thread: any.
std::vector<Observation::Jump> jumps_among(const FrameStatistics& statistics, double noise);

// --- Noise

// An estimate and its significance against 0, in standard errors.
struct Measured {
  double value = 0.0;
  double error = 0.0;
  double z = 0.0;
  Estimate estimate() const { return interval(value, error); }
};

// Components of temporal noise (NVESD's 3-D noise): independent between pixels and frames (tvh), common to a frame (t),
// to a row (tv) or to a column (th) of each frame.
struct NoiseStatistics {
  std::size_t frames = 0;  // of still recordings; 0: unknown
  double total_k = 0.0;    // rms of a value about the mean of its pixel: the noise floor
  double sigma_tvh = 0.0;
  Measured flicker;  // sigma_t
  Measured rows;     // sigma_tv
  Measured columns;  // sigma_th
  // By Whittle's likelihood of the pixels' spectra.
  double white_k = 0.0;  // of the white part, before the frame filter
  Measured corner_hz;    // where 1/f noise equals the white noise
  Measured alpha;        // weight of the frame filter; 1: no filter
  FrameFilter filter = FrameFilter::kNone;
  double spectrum_misfit = 0.0;                              // largest |z| of a band of the spectrum against the fit
  Measured excess_kurtosis;                                  // median over the pixels
  double degrees = std::numeric_limits<double>::infinity();  // of Student's t
  double degrees_error = 0.0;
  // Signs of effects outside the catalogue.
  double neighbour_row_z = 0.0;     // correlation with the pixel to the left
  double neighbour_column_z = 0.0;  // with the pixel above
  double line_hz = 0.0;
  double line_p = 1.0;  // of the strongest line in the frames' means or in the difference of their halves
  // Slow change of the offset: a cubic in each recording.
  double drift_p = 1.0;
  double drift_k = 0.0;
};

// Measures all uniform recordings (if there are none, still ones without a stimulus), after removal of jumps and
// marking of bad pixels. Recordings with values at `ceiling` are excluded.
NoiseStatistics measure_noise(const Session& session, double ceiling);

// True if the camera is still: neighbours' changes are uncorrelated, and a quarter of the pixels vary by noise only.
bool is_still(const Session& session, const Recording& recording);

struct Bin {
  double frequency = 0.0;  // Hz
  double power = 0.0;      // mean over pixels
  double weight = 0.0;     // half the degrees of freedom
};

// Fits the spectrum (in order of frequency) by Whittle's likelihood; writes white noise, corner, filter and misfit.
// `rounding`: variance added after the frame filter by rounding to stored values.
void judge_spectrum(const std::vector<Bin>& spectrum, double rate_hz, double rounding, NoiseStatistics& noise);

// Fits degrees of freedom and scale to values without their means, by likelihood; n.sigma_tvh is known.
void fit_student(const std::vector<double>& x, NoiseStatistics& n);

// Power in bins from 0 to half the sampling rate (Hann window); white noise has its variance in every bin.
std::vector<double> periodogram(const ArrayXd& x);

// --- Timing

// Initial phases and delays of the recordings for a fit: moving bars frame by frame, still bars, choppers. Returns the
// correlation of each recording with its stimulus, 1 without a pattern.
std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels);

// Contradictions between the files' bench description and the pictures (signs, factors, hot and cold exchanged), one
// line each with a better description; empty: it fits, or no other fits better. `state`: as registered.
std::vector<std::string> doubt_description(const Session& session, const State& state, std::span<const int> pixels);

// The local speed of moving bars from their shifts: fits over some 20 frames.
void smooth_speeds(const Session& session, State& state);

struct Transport {
  int lost = 0;           // in all recordings
  int inserted = 0;       // extra frames, not counting identical ones
  double jitter_s = 0.0;  // rms, corrected for the scatter of the measurement
  double jitter_error_s = 0.0;
  double measured_s = 0.0;  // scatter of the measurement
};

// Finds steps of whole frame periods, and the jitter of what remains. Writes each frame's lateness (steps only) to
// state.stimuli[].late_s and registers choppers again.
Transport judge_transport(const Session& session, State& state, double floor_k, std::span<const int> pixels);

// Jitter from the shifts of moving bars in `state`; repeated once effects are known, as model errors scatter shifts.
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
  // For a misfit of unspecific cause: its kind of capture, and whether it is confined to the target's edges.
  std::optional<Kind> misfit{};
  bool at_edges = false;
};

// Significance limit in standard errors, set on effect-free sessions.
inline constexpr double kRemainderLimit = 5.5;
// The same for 1/f noise, which has few bins.
inline constexpr double kClearCorner = 5.0;

// An effect found by its own statistics. `z` and `where` describe the remainder if it is withheld.
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
  // Adds an effect of the catalogue and returns it for completion; by default the confidence follows from `z`.
  FoundEffect& add(const std::string& name, double z, const std::string& where, Estimates parameters,
                   std::optional<double> confidence = std::nullopt);
};

// An effect of the catalogue, as found. Thread: any.
FoundEffect named(const std::string& name, double confidence, Estimates parameters = {});
bool allowed(const Options& options, const std::string& name);

struct Events {
  Session session;  // without jumps; repeated frames and bad pixels are marked
  Session raw;      // as read
  std::vector<Freeze> freezes;
  std::vector<std::size_t> repeated;  // number per recording
  std::vector<Jump> jumps;            // already removed from `session`
  BadPixels bad;
  double step_k = 0.0;  // between values
  bool coarse = false;  // step_k is coarser than the profile's
  double ceiling_k = std::numeric_limits<double>::infinity();
  std::vector<std::string> warnings;
};
Events find_events(Session session, const Options& options);

struct Noise {
  NoiseStatistics statistics;
  double nominal_k = 0.0;  // rms of one value by the profile; measured if not radiometric
  double floor_k = 0.03;
  Findings findings;
};
Noise judge_noise(const Events& events, const Options& options);

// The mean signal: stimulus, transport, effects of the catalogue.
struct Fit {
  Session session;  // that of the events, without jumps that only the prediction reveals
  Session raw;
  std::vector<Jump> jumps;
  std::vector<std::string> wrong_description;  // description of the bench: if not empty, there is no fit
  bool done = false;                           // false: no data to fit; the rest is empty
  State nominal;                               // with fitted stimulus errors, but no effects of the camera
  State state;
  FitResult base;  // the stimuli alone
  Selection selection;
  Score before;  // score of `nominal`
  Findings findings;
};
Result<Fit> fit_means(const Events& events, const Noise& noise, const Options& options, const Progress& progress);

// Omnibus tests of the residual, which locate remainders but name no effect.
std::vector<Remainder> test_remainder(const Events& events, const Noise& noise, const Fit& fit, int threads);

// The stage indicated by the kinds of captures that misfit and those that fit.
std::string stage_of_misfits(std::span<const Remainder> remainders);

struct Field;  // field.hpp
Report make_report(const Events& events, const Noise& noise, const Fit& fit, const Field& field,
                   const std::vector<Remainder>& left, const Options& options);
// Fills report.captures, report.maps and the rest of report.location.
void fill_plots(const Fit& fit, double floor_k, Report& report);

// A frame of a tracked recording, and its residual against other frames; K or counts.
struct SceneFrame {
  Geometry geometry;
  ArrayXf came{};
  ArrayXf corrected{};  // without the pixels' offsets
  ArrayXf missed{};
  ArrayXf left{};  // residual of the corrected frame
};
// Before and after side by side: the frame, its most even part (where a pattern shows best), and the residual.
plot::Rows scene_plots(const SceneFrame& frame);

// One pixel over time, s and K; the plots show the largest deviation from the nominal simulator.
struct Course {
  std::vector<double> t_s;
  std::vector<double> measured;
  std::vector<double> nominal;
  std::vector<double> predicted;
};
std::vector<plot::Plot> course_plots(const Course& course, double floor_k);

// Offset and gain of each pixel from a moving scene, row-major, K or counts; empty: unknown.
struct FieldMaps {
  ArrayXf offset{};
  ArrayXf gain{};   // relative excess; 0: unknown
  ArrayXf level{};  // mean of the scene at each pixel, about which its gain acts
};

// Findings about the camera, from which maps and profile are derived.
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

// Computes Learned::maps by reading the session's captures again. Offset, gain and time constant of each pixel by
// regression on all frames that have a model, with the fitted stimuli; smooth effects (vignetting, heating) from their
// fitted shapes; dead pixels as found. Without a fit, offset and gain from a moving scene. Thread: setup.
Result<model::PixelMaps> learn_maps(const LearnTask& task, int threads);

}  // namespace bolo::diagnose
