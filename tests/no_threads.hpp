// Makes the start of any thread fail, as when a service has reached its thread limit: the default stack exceeds any
// address space, which is refused under every overcommit setting.
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
