// One diagnosis from session to report: what is found at each step, and what the next one needs of it.
#pragma once

#include <limits>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "events.hpp"
#include "fit.hpp"
#include "noise.hpp"
#include "omnibus.hpp"
#include "select.hpp"
#include "src/diagnose/diagnose.hpp"
#include "transport.hpp"

namespace bolo::diagnose {

class Diagnosis {
 public:
  Diagnosis(Session session, const Options& options, const Progress& progress)
      : session_(std::move(session)), options_(options), progress_(progress) {}

  Result<Report> run();
  // What the pipeline can use of it, after run().
  Result<Learned> learn(const std::vector<std::filesystem::path>& captures, const Report& report) const;

 private:
  bool allowed(const std::string& name) const;
  void remain(const std::string& stage, const std::string& where, double z);
  // An effect with statistics of its own: named, or, when it is withheld, left over.
  void found(FoundEffect effect, double z, const std::string& where);
  bool has(const std::string& effect) const;
  double nominal_noise() const;  // of one value, K rms; what was measured where there is no kelvin

  // What happens to frames and pixels.
  void leave_out_frozen();
  void judge_events();
  void judge_values();
  void name_jumps();

  // The noise's own statistics.
  void judge_noise();
  void set_floor();
  void name_noise(const std::string& name, double z, std::map<std::string, Estimate> parameters,
                  const std::string& where);
  void judge_components();
  void judge_spectrum_and_tails();
  void judge_rest_of_noise();

  // The mean: stimulus, transport, effects of the catalogue.
  Status judge_means();
  void match_stimuli(std::span<const int> some);
  void judge_ceiling();
  void correct_jumps(const State& state);
  void correct_jumps_again(const State& state);
  FitResult with_times(const Fitter& fitter, const FitResult& base, bool free) const;
  void name_losses(const Transport& transport);
  void name_chosen(const FitResult& base, const Selection& selection);
  void compare_with_nominal(const FitResult& base, const Selection& selection);
  void test_what_is_left(const Fitter& fitter);
  void say_stimulus();

  // The report's figures.
  void conclude();
  void conclude_noise();
  void conclude_gap();
  void conclude_verdict();
  bool testable() const;
  void observe_rest();

  Session session_;
  Session raw_;  // before anything was taken out
  const Options& options_;
  const Progress& progress_;
  Report report_;
  std::vector<Freeze> freezes_;
  std::vector<std::size_t> repeated_;  // frames of each recording
  std::vector<Jump> jumps_;
  BadPixels bad_;
  NoiseStatistics noise_;
  double step_k_ = 0.0;  // between values
  bool coarse_ = false;  // that step is coarser than the profile's
  double floor_k_ = 0.03;
  double ceiling_k_ = std::numeric_limits<double>::infinity();
  State state_;
  std::vector<Remainder> remainders_;
  bool fitted_ = false;
};

// An effect of the catalogue as found. Thread: any.
FoundEffect named(const std::string& name, double confidence);

}  // namespace bolo::diagnose
