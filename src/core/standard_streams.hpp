// Standard input, output and error of a process that was started without some of them.
#pragma once

#include <fcntl.h>

#include <cerrno>

namespace bolo {

// Before anything is opened: a file that took the place of a closed stream would be given what is printed, in the
// middle of a recording. What stands there instead refuses reads and writes as a closed one does. Thread: setup.
inline void hold_standard_streams() noexcept {
  for (int stream = 0; stream <= 2; ++stream) {
    if (::fcntl(stream, F_GETFD) >= 0 || errno != EBADF) continue;
    [[maybe_unused]] const int held = ::open("/dev/null", stream == 0 ? O_WRONLY : O_RDONLY);
  }
}

}  // namespace bolo
