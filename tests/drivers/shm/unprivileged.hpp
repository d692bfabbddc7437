#pragma once

#include <grp.h>

#include "tests/child.hpp"

namespace bolo::shm {

inline constexpr uid_t kNobody = 65534;
inline constexpr gid_t kNoGroup = 65534;

// Waits until all other threads of this process sleep. A starting thread may hold the lock of a sanitizer's allocator,
// which a fork would copy in its locked state.
inline void let_others_sleep() {
  const auto awake = [] {
    int count = 0;
    for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
      if (task.path().filename() == std::to_string(gettid())) continue;
      std::ifstream file(task.path() / "stat");
      std::string text;
      std::getline(file, text);
      const std::size_t name_end = text.rfind(") ");
      count += name_end != std::string::npos && text[name_end + 2] == 'S' ? 0 : 1;
    }
    return count;
  };
  for (int quiet = 0; quiet < 3; quiet = awake() == 0 ? quiet + 1 : 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

// Runs `work` in a child without privileges that is a member of `groups`; returns its result. Needs root.
inline int unprivileged(const std::vector<gid_t>& groups, const std::function<int()>& work, uid_t user = kNobody) {
  let_others_sleep();
  return in_child([&] {
    const bool dropped = setgroups(groups.size(), groups.data()) == 0 && setgid(kNoGroup) == 0 && setuid(user) == 0;
    return dropped ? work() : 99;
  });
}

}  // namespace bolo::shm
