// What of a host stands between a camera and sharp frames, each with the fix for it.
#pragma once

#include <string>
#include <vector>

#include "tools/doctor/facts.hpp"

namespace bolo::tools::doctor {

enum class Verdict {
  kGood,
  kAdvice,   // works, but less well than it could
  kProblem,  // frames will be lost, or nothing will work
  kUnknown,  // could not be looked at: `found` says why
};
std::string_view word(Verdict verdict);  // "good", "advice", "problem", "unknown"

struct Check {
  std::string name;   // stable, for programs: "receive_buffer"
  std::string title;  // "Receive buffer"
  Verdict verdict = Verdict::kGood;
  std::string found{};  // what is so
  std::string fix{};    // what to do; empty where nothing is
};

// What the daemon will ask of the host.
struct Needs {
  int socket_buffer_bytes = 8 << 20;
  int packet_bytes = 0;  // 0: the largest that the link carries
  int realtime_priority = 0;
  std::vector<int> cpus;           // that deblurring keeps to
  std::uint64_t shared_bytes = 0;  // of the frames' ring
  std::string address;             // of the camera; empty: any that answers
  bool video = false;              // a video device is wanted
};

// What `chronyc -c tracking` and `pmc 'GET TIME_STATUS_NP'` print, in words; empty: nothing that can be read. Thread:
// any.
std::string chrony_words(const std::string& tracking);
std::string ptp_words(const std::string& time_status);

// Pure: says of each fact what it means. Order: the network, the processor, memory, devices, libraries, the camera.
// Thread: any.
std::vector<Check> judge(const Facts& facts, const Needs& needs);

}  // namespace bolo::tools::doctor
