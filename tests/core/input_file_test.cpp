// What is no regular file is refused at once, by whatever name it has.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "src/core/input_file.hpp"
#include "tests/scratch.hpp"

namespace bolo::input_file_test {
namespace {

namespace fs = std::filesystem;

class InputFileTest : public ::testing::Test {
 protected:
  void expect_refused(const fs::path& file, const std::string& word) const {
    SCOPED_TRACE(file);
    const auto text = read_input(file);
    const auto stream = stream_input(file);
    const auto descriptor = open_input(file);
    ASSERT_FALSE(text);
    EXPECT_FALSE(stream);
    EXPECT_FALSE(descriptor);
    EXPECT_EQ(text.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(text.error().message.find(file.string() + ": "), std::string::npos) << text.error().message;
    EXPECT_NE(text.error().message.find(word), std::string::npos) << text.error().message;
  }

  Scratch scratch_;
};

TEST_F(InputFileTest, GivesAFileAndALinkToIt) {
  const fs::path file = scratch_ / "file";
  std::ofstream(file) << std::string(100'000, 'x') << "end";
  fs::create_symlink("file", scratch_ / "link");
  for (const char* name : {"file", "link"}) {
    EXPECT_EQ(read_input(scratch_ / name).value_or(""), std::string(100'000, 'x') + "end");
    auto stream = stream_input(scratch_ / name);
    ASSERT_TRUE(stream);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(*stream), {}).size(), 100'003U);
    EXPECT_TRUE(open_input(scratch_ / name));
  }
}

TEST_F(InputFileTest, GivesAnEmptyFile) {
  std::ofstream(scratch_ / "empty").flush();
  EXPECT_EQ(read_input(scratch_ / "empty").value_or("none"), "");
}

TEST_F(InputFileTest, RefusesWhatWouldBeWaitedForOrReadWithoutEnd) {
  ASSERT_EQ(mkfifo((scratch_ / "pipe").c_str(), 0600), 0);
  fs::create_symlink("pipe", scratch_ / "link");
  expect_refused(scratch_ / "pipe", "is a pipe, not a file");
  expect_refused(scratch_ / "link", "is a pipe, not a file");
  expect_refused("/dev/zero", "is a device, not a file");
  expect_refused(scratch_.path(), "is a folder, not a file");
  expect_refused(scratch_ / "none", "No such file");
}

TEST_F(InputFileTest, RefusesASocket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = (scratch_ / "socket").string();
  ASSERT_LT(name.size(), sizeof address.sun_path);
  name.copy(address.sun_path, name.size());
  const UniqueFd bound(socket(AF_UNIX, SOCK_STREAM, 0));
  ASSERT_EQ(bind(bound.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  expect_refused(name, "is a socket, not a file");
}

TEST_F(InputFileTest, ReadsNoMoreThanMayBe) {
  std::ofstream(scratch_ / "file") << std::string(2048, 'x');
  EXPECT_TRUE(read_input(scratch_ / "file", 2048));
  const auto text = read_input(scratch_ / "file", 2047);
  ASSERT_FALSE(text);
  EXPECT_NE(text.error().message.find("larger than the 1 KiB"), std::string::npos) << text.error().message;
}

}  // namespace
}  // namespace bolo::input_file_test
