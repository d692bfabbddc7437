// What a soak found, for programs and for people.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/lab/soak/run.hpp"

namespace bolo::tools::soak {

// Where and how it was measured.
struct Circumstances {
  std::string command;
  std::string version;
  std::string machine;  // processor, kernel, memory
  int processors = 0;
  std::string stress;                 // what took processors and memory
  std::string began;                  // UTC
  std::vector<std::string> not_done;  // what this computer or this run could not do, and why
};
Circumstances circumstances_of(const SoakRequest& request, const Programs& programs, const std::string& command,
                               const std::string& version);

// Everything, but for the timeline's seconds unless asked for. Thread: any.
nlohmann::ordered_json report_json(const SoakRequest& request, const Circumstances& circumstances,
                                   const SoakResult& result, const Findings& findings, bool with_timeline);

// A page that needs nothing but itself. Thread: any.
std::string report_page(const SoakRequest& request, const Circumstances& circumstances, const SoakResult& result,
                        const Findings& findings);

// The table of invariants, and each one that was broken: lines for a terminal. Thread: any.
std::string report_text(const SoakResult& result, const Findings& findings);

// The schedule, a line for each disturbance. Thread: any.
std::string schedule_text(const Schedule& schedule);

}  // namespace bolo::tools::soak
