// Recordings without a bench: the scene is unknown, but it is one scene. A stage between the noise and the report.
#pragma once

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {

// What field recordings say. Where any recording of a session has a model, the bench speaks and these are observed
// only.
struct Field {
  bool judged = false;       // false: nothing is known well enough, or there is a bench
  std::string why;           // not
  bool moving = false;       // one of them was followed
  bool patterns = false;     // so far that patterns of pixels were told from the scene
  bool still = false;        // one of them stands still
  bool tells_tau = false;    // of those that were followed, one changes its speed enough
  bool tells_delay = false;  // the same
  // Of what is predicted from the scene itself, on halves of the data that were not fitted; 1 where it stands still.
  double gap_before = 1.0;
  double gap_after = 1.0;
  Findings findings;
  std::map<std::string, double> gaps;       // before, by file name
  std::map<std::string, Observation> seen;  // by file name: also what the motion tells
  plot::Rows scene;                         // Report::scene

  // Whether such recordings tell an effect.
  bool tells(const Effect& effect) const;
};

// Brings the events of field recordings to where noise can be measured: jumps of the whole picture are taken out and
// noted, and pixels of a still recording in which something moves are left out. Nothing where a recording has a model.
void prepare_field(Events& events);

// Dead pixels that only motion shows are added to `events.bad`. kBadInput, kFailed: a file cannot be read again.
Result<Field> judge_field(const std::vector<std::filesystem::path>& files, Events& events, const Noise& noise,
                          const Options& options, const Progress& progress);

}  // namespace bolo::diagnose
