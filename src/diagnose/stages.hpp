// The diagnosis as stages, each a function of what came before: Session -> Events -> Noise -> Fit -> Remainders ->
// Report.
#pragma once

#include <filesystem>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/events.hpp"
#include "src/diagnose/fit.hpp"
#include "src/diagnose/noise.hpp"
#include "src/diagnose/timing.hpp"

namespace bolo::diagnose {

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

// What a stage adds to the report.
struct Findings {
  std::vector<FoundEffect> effects;
  std::vector<Remainder> remainders;
  std::vector<std::string> warnings;
};

// An effect of the catalogue, as found. Thread: any.
FoundEffect named(const std::string& name, double confidence, std::map<std::string, Estimate> parameters = {});
bool allowed(const Options& options, const std::string& name);
// An effect with statistics of its own: named, or, when it is withheld, left over.
void add(Findings& findings, const Options& options, FoundEffect effect, double z, const std::string& where);

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
  bool done = false;  // false: there is nothing to fit, and what follows is empty
  State nominal;      // with the errors of the stimuli but nothing of the camera
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
Report make_report(const Events& events, const Noise& noise, const Fit& fit, const std::vector<Remainder>& left,
                   const Options& options);
// What is drawn: report.captures, report.maps and the rest of report.location.
void fill_plots(const Fit& fit, double floor_k, Report& report);

}  // namespace bolo::diagnose
