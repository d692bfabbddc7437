// The faults that are tried, one at a time, and what each must lead to.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tools/lab/eval/faults_run.hpp"

namespace bolo::tools::faults {

struct Scenario {
  std::string name;
  std::string faults;  // as parse_fault() reads them, with spaces between
  double seconds = 1.0;
  Disturbance disturbance{};
  bool resends = false;  // the daemon asks for lost packets and gets them: most frames are saved
  int least_reconnects = 0;
  int most_reconnects = 0;
  // False: what is lost depends on more than the fault: on how fast packets are asked for and sent again, on when a
  // camera is opened again. Then each frame that never came must be counted, and no more is asked.
  bool exact = true;
  std::function<void(RunTask&)> prepare = nullptr;  // what else differs
};

// All of them, of a small scene at 200 Hz. Thread: any.
const std::vector<Scenario>& scenarios();

// What all scenarios look at: 64x24 pixels of a street that passes by, and what an undisturbed run makes of it.
struct Stage {
  Recording scene;
  pipeline::PipelineOptions pipeline;
  std::vector<Counts> reference;
};
Result<Stage> make_stage();

struct Outcome {
  RunResult run;
  Verdict verdict;
  Losses expected{};

  bool losses_match() const { return run.lost == expected; }
};

// Runs it on a camera of its own. Again, up to three times in all, when this computer dropped packets by itself.
// `seed`: another one chooses other packets. Thread: any.
Result<Outcome> play(const Scenario& scenario, const Stage& stage, int seed = 1);

// What must hold and does not, in words; empty when all does. Thread: any.
std::string what_is_wrong(const Scenario& scenario, const Outcome& outcome);

// "incomplete 12, missing 3", or "none". Thread: any.
std::string text_of(const Losses& losses);

}  // namespace bolo::tools::faults
