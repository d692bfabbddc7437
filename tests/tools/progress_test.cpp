// The line of progress, on a terminal.
#include <gtest/gtest.h>

#include <fcntl.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>

#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

// Stands for stderr while it lives.
class Terminal {
 public:
  Terminal() : stderr_(::dup(STDERR_FILENO)), terminal_(::posix_openpt(O_RDWR | O_NOCTTY)) {
    if (::grantpt(terminal_) != 0 || ::unlockpt(terminal_) != 0) return;
    const int line = ::open(::ptsname(terminal_), O_RDWR | O_NOCTTY);
    ::dup2(line, STDERR_FILENO);
    ::close(line);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;
  ~Terminal() {
    ::dup2(stderr_, STDERR_FILENO);
    ::close(stderr_);
    ::close(terminal_);
  }
  std::string said() const {
    std::string text(4096, '\0');
    const ssize_t count = ::read(terminal_, text.data(), text.size());
    text.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
    return text;
  }

 private:
  int stderr_;
  int terminal_;
};

TEST(Progress, SaysTheRateSinceTheWorkBeganAndTheTimeLeft) {
  std::string said;
  {
    const Terminal terminal;
    Progress progress("work", 100);
    progress.start_rate(50);
    std::this_thread::sleep_for(std::chrono::milliseconds(250));
    progress.update(51);
    said = terminal.said();
  }
  EXPECT_NE(said.find("work: 51 of 100 (51 %), "), std::string::npos) << said;
  const double rate = std::atof(said.c_str() + said.find("%), ") + 4);
  EXPECT_GT(rate, 0.0);
  EXPECT_LE(rate, 4.0) << "one in a quarter of a second or more: " << said;
  const double left_s = std::atof(said.c_str() + said.find(" a second, ") + 11);
  EXPECT_GE(left_s, 12.0) << "49 at that rate: " << said;
  EXPECT_NE(said.find(" s left"), std::string::npos) << said;
}

TEST(Progress, SaysNoRateBeforeTheWorkBegan) {
  std::string said;
  {
    const Terminal terminal;
    Progress progress("work", 100);
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    progress.start_rate(16);
    progress.update(16);
    said = terminal.said();
  }
  EXPECT_NE(said.find("work: 16 of 100"), std::string::npos) << said;
  EXPECT_EQ(said.find("second"), std::string::npos) << said;
}

}  // namespace
}  // namespace bolo::tools
