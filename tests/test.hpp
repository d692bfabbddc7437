#ifndef BOLO_TESTS_TEST_HPP  // a guard, not #pragma once: a precompiled header from a cache is another file to that
#define BOLO_TESTS_TEST_HPP

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <deque>
#include <filesystem>
#include <fstream>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

namespace bolo {

// The result of a call that must succeed: otherwise the test ends with the error's message.
template <typename Answer>
Answer must(Answer answer, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  if (!answer) throw std::runtime_error(file + (":" + std::to_string(line)) + ": " + answer.error().message);
  return answer;
}

// Polls the condition; false after a minute, which only a hang can reach.
template <typename Condition>
bool eventually(Condition condition) {
  for (int i = 0; i < 6000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

}  // namespace bolo

#endif
