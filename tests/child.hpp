// A process of its own, for what limits, kills or spoils a process.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include "tests/test.hpp"

namespace bolo {

// What a child that does `work` ends with: its answer, or the negative number of the signal that killed it.
inline int in_child(const std::function<int()>& work) {
  const pid_t pid = fork();
  EXPECT_GE(pid, 0);
  if (pid == 0) _exit(work());
  int status = 0;
  EXPECT_EQ(waitpid(pid, &status, 0), pid);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

}  // namespace bolo
