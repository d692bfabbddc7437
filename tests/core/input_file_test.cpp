// Anything but a regular file is refused at once, by any name.
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "src/core/input_file.hpp"
#include "src/core/number_rows.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::input_file_test {

namespace fs = std::filesystem;

class InputFileTest : public ::testing::Test {
 protected:
  static void expect_not_read(const fs::path& file, const std::string& word) {
    SCOPED_TRACE(file);
    expect_refused(read_input(file), {file.string() + ": ", word});
    EXPECT_FALSE(stream_input(file));
    EXPECT_FALSE(open_input(file));
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
  std::ofstream(scratch_ / "empty").flush();
  EXPECT_EQ(read_input(scratch_ / "empty").value_or("none"), "");
}

TEST_F(InputFileTest, RefusesWhatWouldBeWaitedForOrReadWithoutEnd) {
  ASSERT_EQ(mkfifo((scratch_ / "pipe").c_str(), 0600), 0);
  fs::create_symlink("pipe", scratch_ / "link");
  expect_not_read(scratch_ / "pipe", "is a pipe, not a file");
  expect_not_read(scratch_ / "link", "is a pipe, not a file");
  expect_not_read("/dev/zero", "is a device, not a file");
  expect_not_read(scratch_.path(), "is a folder, not a file");
  expect_not_read(scratch_ / "none", "No such file");
}

TEST_F(InputFileTest, RefusesASocket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = (scratch_ / "socket").string();
  ASSERT_LT(name.size(), sizeof address.sun_path);
  name.copy(address.sun_path, name.size());
  const UniqueFd bound(socket(AF_UNIX, SOCK_STREAM, 0));
  ASSERT_EQ(bind(bound.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  expect_not_read(name, "is a socket, not a file");
}

TEST_F(InputFileTest, ReadsNoMoreThanMayBe) {
  std::ofstream(scratch_ / "file") << std::string(2048, 'x');
  EXPECT_TRUE(read_input(scratch_ / "file", 2048));
  expect_error(read_input(scratch_ / "file", 2047), {"larger than the 1 KiB"});
}

// It was part of the first number, whose row was refused, or taken for a header.
TEST_F(InputFileTest, RowsAfterAByteOrderMarkAreRows) {
  const Scratch folder;
  std::ofstream(folder / "rows.csv") << "\xef\xbb\xbf"
                                     << "1,2\r\n3,4\r\n";
  double sum = 0.0;
  ASSERT_TRUE(read_rows(folder / "rows.csv", [&sum](std::string_view line, bool) -> Status {
    const auto numbers = numbers_of<2>(line);
    if (!numbers) return bad_input("no numbers");
    sum += (*numbers)[0] + (*numbers)[1];
    return {};
  }));
  EXPECT_EQ(sum, 10.0);
}

}  // namespace bolo::input_file_test
