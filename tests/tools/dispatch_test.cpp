// What becomes of a verb that a library's exception ends.
#include "tools/cli/dispatch.hpp"

#include <gtest/gtest.h>

#include <array>
#include <new>
#include <stdexcept>
#include <string>

#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

int run_out_of_memory(int, char**) { throw std::bad_alloc(); }
int fail(int, char**) { throw std::runtime_error("no\nthread"); }
constexpr std::array<Verb, 2> kVerbs{{{"hunger", "", run_out_of_memory}, {"fail", "", fail}}};

// The line of error; exit code 1 is expected.
std::string ended(std::string verb) {
  std::string program = "bolo";
  std::array<char*, 2> words{program.data(), verb.data()};
  testing::internal::CaptureStderr();
  const int code = dispatch({"bolo", ""}, kVerbs, static_cast<int>(words.size()), words.data());
  std::string said = testing::internal::GetCapturedStderr();
  EXPECT_EQ(code, kExitFailed);
  return said;
}

TEST(Dispatch, AnExceptionIsAFailureInOneLine) {
  EXPECT_EQ(ended("hunger"), "bolo hunger: not enough memory\n");
  EXPECT_EQ(ended("fail"), "bolo fail: no?thread\n");
}

}  // namespace
}  // namespace bolo::tools
