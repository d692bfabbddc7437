// A temporary folder for a test, removed afterwards.
#pragma once

#include "tests/test.hpp"

namespace bolo {

class Scratch {
 public:
  Scratch() {
    std::string pattern = ::testing::TempDir() + "bolo_test_XXXXXX";
    const char* made = mkdtemp(pattern.data());
    EXPECT_NE(made, nullptr) << pattern;
    if (made != nullptr) folder_ = made;
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  const std::filesystem::path& path() const { return folder_; }
  std::filesystem::path operator/(const std::string& name) const { return folder_ / name; }
  // Writes a file and returns its path.
  std::filesystem::path text(const std::string& name, const std::string& content) const {
    std::ofstream(*this / name, std::ios::binary) << content;
    return *this / name;
  }

 private:
  std::filesystem::path folder_;
};

class ScratchTest : public ::testing::Test {
 protected:
  const Scratch scratch_;
};

}  // namespace bolo
