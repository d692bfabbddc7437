// Child processes for tests that limit, kill or corrupt a process.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include "tests/test.hpp"

namespace bolo {

// Runs `work` in a child; returns its result, or the negative number of the signal that killed it.
inline int in_child(const std::function<int()>& work) {
  const pid_t pid = fork();
  EXPECT_GE(pid, 0);
  if (pid == 0) _exit(work());
  int status = 0;
  EXPECT_EQ(waitpid(pid, &status, 0), pid);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

}  // namespace bolo
