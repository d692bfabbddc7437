// No thread can be started, as when all that a service may have are taken: the default stack is larger than any address
// space, so that it is refused whatever the system promises of its memory.
#pragma once

#include <pthread.h>

#include "tests/test.hpp"

namespace bolo {

class NoThreads {
 public:
  NoThreads() {
    pthread_attr_t huge{};
    EXPECT_EQ(pthread_getattr_default_np(&before_), 0);
    pthread_attr_init(&huge);
    EXPECT_EQ(pthread_attr_setstacksize(&huge, std::size_t{1} << 62), 0);
    EXPECT_EQ(pthread_setattr_default_np(&huge), 0);
  }
  NoThreads(const NoThreads&) = delete;
  NoThreads& operator=(const NoThreads&) = delete;
  ~NoThreads() { pthread_setattr_default_np(&before_); }

 private:
  pthread_attr_t before_{};
};

}  // namespace bolo
