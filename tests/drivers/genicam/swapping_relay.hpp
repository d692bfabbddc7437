// Stands between a program and a camera's control channel, and reverses the bytes of registers that are read or written
// as memory: what some FLIR cameras do.
#pragma once

#include "tests/test.hpp"

namespace bolo::genicam::test {

class SwappingRelay {
 public:
  // Listens at `own` for one program at a time and passes on to the camera at `camera`; both IPv4, port 3956.
  SwappingRelay(const std::string& own, const std::string& camera);
  ~SwappingRelay();
  SwappingRelay(const SwappingRelay&) = delete;
  SwappingRelay& operator=(const SwappingRelay&) = delete;

  // Registers that were reversed.
  int swapped() const { return swapped_.load(); }

 private:
  void run();

  int front_;  // towards programs
  int back_;   // towards the camera
  std::atomic<bool> end_{false};
  std::atomic<int> swapped_{0};
  std::thread thread_;
};

}  // namespace bolo::genicam::test
