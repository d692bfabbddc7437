// [ros2]: bolo-ros2 publishes frames to ROS 2, in a separate process, so that DDS traffic cannot stop frames.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "src/model/strict_toml.hpp"

namespace bolo::daemon {

struct Ros2Options {
  bool enabled = false;
  bool kelvin = false;
  std::string frame_id;  // empty: the daemon's name
  int domain = 0;        // ROS_DOMAIN_ID

  // Thread: any.
  void declare(model::KeyTable& keys);
  // kBadInput if bolo-ros2 is not installed. Thread: any.
  Status check(const model::KeyTable& keys, bool has_shared_memory) const;
};

// Runs bolo-ros2, and restarts it when it has ended. Thread: main.
class Ros2Process {
 public:
  Ros2Process(const Ros2Options& options, const std::string& name);
  Ros2Process(const Ros2Process&) = delete;
  Ros2Process& operator=(const Ros2Process&) = delete;
  ~Ros2Process();  // terminates the process

  // Starts the process if it does not run; reports an unexpected end by `warn`, once until it has run for a while.
  void poll(const std::function<void(const std::string&)>& warn);

 private:
  void start(const std::function<void(const std::string&)>& warn);

  std::vector<std::string> words_;  // empty: disabled
  pid_t pid_ = -1;
  std::int64_t started_ns_ = 0;
  bool warned_ = false;
};

}  // namespace bolo::daemon
