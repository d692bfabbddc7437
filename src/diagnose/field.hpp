// Recordings of an unknown scene, without a bench. A stage between the noise and the report.
#pragma once

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {

// Results from field recordings. If any recording of a session has a model, the bench decides and these are only
// observed.
struct Field {
  bool judged = false;       // false: the data do not suffice, or there is a bench
  std::string why;           // reason if not judged
  bool moving = false;       // one was tracked
  bool patterns = false;     // and pixel patterns were separated from the scene
  bool still = false;        // one is still
  bool tells_tau = false;    // a tracked one varies its speed enough
  bool tells_delay = false;  // the same
  // Of the prediction from other frames, on held-out halves of the data; 1 for still recordings.
  Gaps gap;
  Findings findings;
  std::map<std::string, double> gaps;       // before, by file name
  std::map<std::string, Observation> seen;  // by file name, with the motion's results
  plot::Rows scene;                         // Report::scene
  FieldMaps maps;                           // of the recording with the most predictions

  // True if such recordings identify the effect.
  bool tells(const Effect& effect) const;
};

// Prepares field recordings for the noise's measurement: removes and records jumps of the whole picture, and excludes
// pixels of a still recording with motion. No change if any recording has a model.
void prepare_field(Events& events);

// Dead pixels found by motion only are added to `events.bad`. kBadInput, kFailed: a file cannot be read again.
Result<Field> judge_field(Events& events, const Noise& noise, const Options& options, const Progress& progress);

}  // namespace bolo::diagnose
