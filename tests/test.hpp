// GoogleTest and what tests take from the standard library. Parsed once for each set of flags (CMakeLists.txt).
#pragma once

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

// The answer of what has to succeed: a test in which it doesn't ends with what it says.
template <typename Answer>
Answer must(Answer answer, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  if (!answer) throw std::runtime_error(file + (":" + std::to_string(line)) + ": " + answer.error().message);
  return answer;
}

// Tries until it is true; false when it never was for a minute, which only a hang can take.
template <typename Condition>
bool eventually(Condition condition) {
  for (int i = 0; i < 6000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

}  // namespace bolo
