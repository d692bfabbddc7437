// Recordings of an unknown scene, without a bench. This stage runs between those of noise and report.
#pragma once

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {

// Results from field recordings, which are only observed if any recording of the session has a model.
struct Field {
  bool judged = false;       // false: too little data, or there is a bench
  std::string why;           // reason if not judged
  bool moving = false;       // a moving scene was tracked
  bool patterns = false;     // and pixel patterns were separated from it
  bool still = false;        // one recording is still
  bool tells_tau = false;    // a tracked recording varies its speed enough
  bool tells_delay = false;  // the same
  // Of prediction from other frames, on held-out halves of the data; 1 for still recordings.
  Gaps gap;
  Findings findings;
  std::map<std::string, double> gaps;       // gap before, by file name
  std::map<std::string, Observation> seen;  // by file name, including results from motion
  plot::Rows scene;                         // Report::scene
  FieldMaps maps;                           // of the recording with the most predictions

  // True if the judged recordings identify the effect.
  bool tells(const Effect& effect) const;
};

// Prepares field recordings for the noise measurement: removes and records jumps of the whole picture, and excludes
// pixels with motion in a still recording. No change if any recording has a model.
void prepare_field(Events& events);

// Adds dead pixels that only motion reveals to `events.bad`. kBadInput, kFailed: a file cannot be read again.
Result<Field> judge_field(Events& events, const Noise& noise, const Options& options, const Progress& progress);

}  // namespace bolo::diagnose
