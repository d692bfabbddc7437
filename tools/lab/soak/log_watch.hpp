// What stands in the daemon's log.
#pragma once

#include <string_view>

namespace bolo::tools::soak {

enum class LogLine {
  kUsual,          // informs
  kWarning,        // tells of trouble with the camera or of frames lost
  kError,          // "error" or worse
  kRefusedReload,  // an error: a file that is wrong was not taken up
  kNoLife,         // an error: no signs of life to the service manager's watchdog
  kNoStart,        // "bolod: ...": it ended before it ran
  kForeign,        // no line of bolod's
};

// A line of text: time, level, message (log.format = "text"). Thread: any.
LogLine classify(std::string_view line);

}  // namespace bolo::tools::soak
