// Work done as another user.
#pragma once

#include <grp.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>
#include <vector>

namespace bolo::shm {

inline constexpr uid_t kNobody = 65534;
inline constexpr gid_t kNoGroup = 65534;

// Runs `work` in a child without privileges, member of `groups`; what it returns. -1: it did not get there. Only root
// can.
inline int unprivileged(const std::vector<gid_t>& groups, const std::function<int()>& work, uid_t user = kNobody) {
  const pid_t child = fork();
  if (child == 0) {
    const bool dropped = setgroups(groups.size(), groups.data()) == 0 && setgid(kNoGroup) == 0 && setuid(user) == 0;
    _exit(dropped ? work() : 99);
  }
  int status = 0;
  return waitpid(child, &status, 0) == child && WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace bolo::shm
