// How processes that were started together talk; by MPI (mpi_messenger.cpp), or within a test.
#pragma once

#include <optional>
#include <string>

namespace bolo::tools::cluster {

struct Message {
  int from = 0;
  std::string text;
};

// Nothing here waits for another process, and the death of one is nobody else's: what was sent to it is lost.
// Thread: the one that made it.
class Messenger {
 public:
  virtual ~Messenger() = default;
  virtual int rank() const = 0;   // this process: 0 to size() - 1
  virtual int size() const = 0;   // processes
  virtual int local() const = 0;  // of them on this host
  virtual void send(int to, const std::string& text) = 0;
  virtual std::optional<Message> receive() = 0;
  // The last call. With `all_present` every process makes it, and it waits for them.
  virtual void leave(bool all_present) = 0;
};

}  // namespace bolo::tools::cluster
