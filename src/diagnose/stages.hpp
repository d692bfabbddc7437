// The diagnosis as stages, each a function of what came before: Session -> Events -> Noise -> Fit -> Remainders ->
// Report; and what the stages are made of.
#pragma once

#include "src/diagnose/fit.hpp"

namespace bolo::diagnose {

// --- Events

struct Freeze {  // frames [first, last] repeat the one before
  std::size_t recording = 0;
  std::size_t first = 0;
  std::size_t last = 0;
};

// A step of the offset at one frame: global, or of each pixel.
struct Jump {
  std::size_t recording = 0;
  std::size_t frame = 0;  // the first one after it
  double global_k = 0.0;
  double pixel_k = 0.0;  // rms over the pixels about the global step, 0: all the same
  bool after_freeze = false;
  bool removed = false;  // global_k is what was taken out, not the first guess
};

struct BadPixels {
  std::vector<int> stuck;  // of the frame, row-major
  std::vector<int> noisy;
  std::vector<int> jumping;                 // of the grid: between two levels
  double step_k = 0.0;                      // of the jumping ones, median
  Mask dead(const Session& session) const;  // the stuck and the noisy ones
};

inline constexpr std::size_t kFreezeFrames = 12;  // shorter runs are repeated frames

// Runs of `wanted` among the flags: the first, and one past the last. Thread: any.
std::vector<std::pair<std::size_t, std::size_t>> runs_of(const std::vector<char>& flags, char wanted);
// Values (of the frame, row-major) of the up to eight pixels around one. Thread: any.
std::vector<double> values_around(const FrameStatistics& statistics, const std::vector<float>& values, PixelPlace at);

// Runs of identical frames: the long ones; short ones are counted in `repeated`. Marks all but the first of each run as
// not used.
std::vector<Freeze> find_freezes(Session& session, std::vector<std::size_t>& repeated_frames);

// Stuck and noisy pixels of the whole frame; then, once jumps have been taken out, those that jump between two levels:
// by more than `step_k`, between whose multiples a value hops that lies at their border.
// Marked in session.good. `of`: the recordings that are asked.
BadPixels find_dead_pixels(Session& session);
void find_jumping_pixels(Session& session, BadPixels& bad, double step_k = 0.0, Kind of = Kind::kUniform);
// Pixels of the frame whose values scatter far more than most do, and at random. Thread: any.
std::vector<int> noisy_pixels(const FrameStatistics& statistics);
// The grid's stuck and noisy pixels are good no more. Thread: one at a time.
void leave_out_dead(Session& session, const BadPixels& bad);

// The clearest step in a series of residuals (frames x pixels of the grid, K): of a uniform recording its own values
// will do. `levels`: what each of the stimulus' levels adds to the frames (frames x levels), since a fit of levels
// takes up a part of every jump; empty: one level that all frames show. `shown`: the mean of each frame as predicted:
// where it leaps itself, a camera that leaps a little differently is no jump; empty: it stands still.
std::optional<Jump> find_jump(const Session& session, std::size_t recording, const Series& residual,
                              const std::vector<Freeze>& freezes, const MatrixXd& levels = {},
                              const VectorXd& shown = {});

// Takes a jump out of the recording's values, with the step of every pixel estimated from `residual` (all pixels of the
// grid).
void remove_jump(Session& session, Jump& jump, const Series& residual, const MatrixXd& levels = {});

// The common step of all values of the recordings.
double find_step(const Session& session);

// Level at which values pile up at the top of a recording's range; infinity: none.
double find_ceiling(const Recording& recording, double level_step);

// What a recording tells without a model of what it looks at, from single pixels and whole frames alone: jumps,
// freezes, flicker, noise, patterns and outlier pixels. Thread: any.
Observation observe(const Recording& recording);
// Frames that nearly all pixels changed at one way, by far more than frames do otherwise. `noise`: standard deviation
// of one value. Thread: any.
std::vector<Observation::Jump> jumps_among(const FrameStatistics& statistics, double noise);

// --- Noise

// An estimate, and how many of its standard errors lie between it and nothing.
struct Measured {
  double value = 0.0;
  double error = 0.0;
  double z = 0.0;
  Estimate estimate() const { return interval(value, error); }
};

// Components of the temporal noise (NVESD's 3-D noise): every pixel and frame for itself (tvh), a whole frame (t), a
// row (tv) and a column (th) in each frame.
struct NoiseStatistics {
  std::size_t frames = 0;  // of still recordings; 0: nothing is known
  double total_k = 0.0;    // rms of a value about its pixel's mean: the noise floor
  double sigma_tvh = 0.0;
  Measured flicker;  // sigma_t
  Measured rows;     // sigma_tv
  Measured columns;  // sigma_th
  // Whittle's likelihood of the pixels' spectra.
  double white_k = 0.0;  // of the white part, before the frame filter
  Measured corner_hz;    // where 1/f noise equals the white noise
  Measured alpha;        // of the frame filter; value 1: none
  FrameFilter filter = FrameFilter::kNone;
  double spectrum_misfit = 0.0;  // largest |z| of a band of the spectrum against the fit
  // Tails.
  Measured excess_kurtosis;                                  // median over the pixels
  double degrees = std::numeric_limits<double>::infinity();  // of Student's t
  double degrees_error = 0.0;
  // What no effect of the catalogue does.
  double neighbour_row_z = 0.0;     // correlation with the pixel to the left
  double neighbour_column_z = 0.0;  // with the pixel above
  double line_hz = 0.0;
  double line_p = 1.0;  // of the strongest line in the frames' means or in the difference of their halves
  // Slow change of the offset, a cubic in each recording.
  double drift_p = 1.0;
  double drift_k = 0.0;
};

// Of all uniform recordings (or, when there is none, of recordings without a stimulus that are still). Jumps have been
// taken out, bad pixels are marked.
// `ceiling`: recordings with values there are left out.
NoiseStatistics measure_noise(const Session& session, double ceiling);

// Whether nothing moves in a recording without a stimulus.
bool is_still(const Session& session, const Recording& recording);

// A bin of a spectrum.
struct Bin {
  double frequency = 0.0;  // Hz
  double power = 0.0;      // mean over pixels
  double weight = 0.0;     // half the degrees of freedom
};

// Fits the spectrum (in order of frequency) by Whittle's likelihood and writes what it says of white noise, corner,
// filter and misfit.
void judge_spectrum(const std::vector<Bin>& spectrum, double rate_hz, NoiseStatistics& noise);

// Fits degrees of freedom and scale by likelihood to values without their means; n.sigma_tvh is known.
void fit_student(const std::vector<double>& x, NoiseStatistics& n);

// Power in each bin from 0 to half the sampling rate through Hann's window; white noise has its variance in every bin.
std::vector<double> periodogram(const ArrayXd& x);

// --- Timing

// Brings the recordings' phases and delays near enough for a fit: moving bars frame by frame, still bars, choppers.
// Returns for each recording how well its stimulus correlates with it, 1 for those without a pattern.
std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels);

// What the files say of the bench that its pictures deny, and what would fit: signs, factors, hot and cold exchanged.
// One line each; empty: the description fits as it is, or nothing else fits better. `state`: as registered.
std::vector<std::string> doubt_description(const Session& session, const State& state, std::span<const int> pixels);

// The local speed of moving bars from their shifts: straight lines over some 20 frames.
void smooth_speeds(const Session& session, State& state);

struct Transport {
  int lost = 0;           // frames, in all recordings
  int inserted = 0;       // frames that came in between, not counting identical ones
  double jitter_s = 0.0;  // rms, less what the measurement itself scatters
  double jitter_error_s = 0.0;
  double measured_s = 0.0;  // scatter of the measurement
};

// Finds steps of whole frame periods and the jitter of the rest. Writes each frame's lateness (steps only) to
// state.stimuli[].late_s; choppers are registered anew.
Transport judge_transport(const Session& session, State& state, double floor_k, std::span<const int> pixels);

// The jitter of frames by the shifts of moving bars as they are in `state`. What the model is off by scatters shifts,
// so it is asked again when the effects are known.
void judge_jitter(const Session& session, const State& state, double floor_k, std::span<const int> pixels,
                  Transport& transport);
bool is_jittered(const Transport& transport);

// The state that knows nothing of transport: shifts follow a smooth motion, no frame is late.
State without_transport(const Session& session, const State& state);

// --- Stages

// Something that no effect explains: what a test of the residual found, or what an effect would have explained that was
// withheld.
struct Remainder {
  std::string stage;
  std::string where;  // one sentence
  double z = 0.0;     // in standard errors
  // Of a misfit that tells no cause by itself: the kind of capture that it is in, and whether it keeps to the target's
  // edges.
  std::optional<Kind> misfit{};
  bool at_edges = false;
};

// Standard errors above which something is left: from sessions without any effect.
inline constexpr double kRemainderLimit = 5.5;
// The same of 1/f noise, which has few bins.
inline constexpr double kClearCorner = 5.0;

// An effect that statistics of its own show, and what is said when it is withheld: by how many standard errors, and
// how, something is left over.
struct Finding {
  FoundEffect effect;
  double z = 0.0;
  std::string where;
};

// What a stage adds to the report.
struct Findings {
  std::vector<Finding> effects;
  std::vector<Remainder> remainders;
  std::vector<std::string> warnings;
  // Adds an effect of the catalogue; without a confidence it is that of `z`. Returns it, to be filled further.
  FoundEffect& add(const std::string& name, double z, const std::string& where, Estimates parameters,
                   std::optional<double> confidence = std::nullopt);
};

// An effect of the catalogue, as found. Thread: any.
FoundEffect named(const std::string& name, double confidence, Estimates parameters = {});
bool allowed(const Options& options, const std::string& name);

// What happens to whole frames and to pixels.
struct Events {
  Session session;  // without its jumps; repeated frames and bad pixels are marked
  Session raw;      // before anything was taken out
  std::vector<Freeze> freezes;
  std::vector<std::size_t> repeated;  // frames of each recording
  std::vector<Jump> jumps;            // that were taken out
  BadPixels bad;
  double step_k = 0.0;  // between values
  bool coarse = false;  // that step is coarser than the profile's
  double ceiling_k = std::numeric_limits<double>::infinity();
  std::vector<std::string> warnings;
};
Events find_events(Session session, const Options& options);

// The noise's own statistics, and what they name.
struct Noise {
  NoiseStatistics statistics;
  double nominal_k = 0.0;  // of one value, rms, by the profile; what was measured where there is no kelvin
  double floor_k = 0.03;
  Findings findings;
};
Noise judge_noise(const Events& events, const Options& options);

// The mean: stimulus, transport, effects of the catalogue.
struct Fit {
  Session session;  // as that of the events, without the jumps that only a prediction shows
  Session raw;
  std::vector<Jump> jumps;
  std::vector<std::string> wrong_description;  // of the bench: then nothing is fitted
  bool done = false;                           // false: there is nothing to fit, and what follows is empty
  State nominal;                               // with the errors of the stimuli but nothing of the camera
  State state;
  FitResult base;  // the stimuli alone
  Selection selection;
  Score before;  // of `nominal`
  Findings findings;
};
Result<Fit> fit_means(const Events& events, const Noise& noise, const Options& options, const Progress& progress);

// Tests of the residual that name no effect: is anything left, and where?
std::vector<Remainder> test_remainder(const Events& events, const Noise& noise, const Fit& fit, int threads);

// The stage that misfits point to by the captures which they are in and those which fit.
std::string stage_of_misfits(std::span<const Remainder> remainders);

// What is said in the end.
struct Field;  // field.hpp
Report make_report(const Events& events, const Noise& noise, const Fit& fit, const Field& field,
                   const std::vector<Remainder>& left, const Options& options);
// What is drawn: report.captures, report.maps and the rest of report.location.
void fill_plots(const Fit& fit, double floor_k, Report& report);

// A picture of values, row-major; those of both signs get the diverging colours.
plot::Plot map_plot(const std::string& title, const std::string& unit, Geometry size, std::vector<float> values);
// Two pictures in the colours of the left one.
std::vector<plot::Plot> beside(plot::Plot left, plot::Plot right);

// One pixel in time, s and K: what is drawn is where the camera and the nominal simulator are furthest apart.
struct Course {
  std::vector<double> t_s;
  std::vector<double> measured;
  std::vector<double> nominal;
  std::vector<double> predicted;
};
std::vector<plot::Plot> course_plots(const Course& course, double floor_k);

// What is learned from: what was found of the camera.
struct LearnTask {
  const Session& session;
  const State* state = nullptr;  // as fitted; null: there was nothing to fit
  const std::vector<Jump>& jumps;
  const BadPixels& bad;
  FrameFilter filter = FrameFilter::kNone;
  const std::vector<FoundEffect>& effects;
  const model::CameraProfile& profile;

  const FoundEffect* found(std::string_view name) const;
};

// Learned::maps. Offset, gain and time constant of each pixel by regression on all frames that have a model, with the
// fitted stimuli; smooth effects (vignetting, heating) from their fitted shapes; dead pixels as found. `files`: the
// session's captures, read a second time. Thread: setup.
Result<model::PixelMaps> learn_maps(const LearnTask& task, const std::vector<std::filesystem::path>& files,
                                    int threads);

}  // namespace bolo::diagnose
