// Files that no camera has, as their places and directories state them.
#include "drivers/genicam/description_file.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "tests/refusal.hpp"

namespace bolo::genicam::description_file_test {
namespace {

constexpr std::uint32_t kFile = 0x10003;  // no multiple of 4

void put(std::string& bytes, std::size_t at, std::uint32_t value, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) bytes[at + i] = static_cast<char>(value >> (8 * i));
}

// A ZIP file of one entry, as its directory tells of it.
std::string zip(std::uint32_t unpacked, const std::string& comment = "") {
  const std::string content(700, 'x');
  std::string entry(46, '\0');
  entry.replace(0, 4, "PK\x01\x02");
  put(entry, 24, unpacked, 4);
  put(entry, 28, 5, 2);
  entry += "a.xml";
  std::string end(22, '\0');
  end.replace(0, 4, "PK\x05\x06");
  put(end, 10, 1, 2);
  put(end, 16, static_cast<std::uint32_t>(content.size()), 4);
  return content + entry + end + comment;
}

Status checked(const std::string& first, const std::string& second, const std::string& file = "") {
  return check_description_file(
      [&](std::uint32_t address, std::uint32_t bytes) -> std::optional<std::vector<unsigned char>> {
        EXPECT_EQ(address % 4, 0U);
        EXPECT_TRUE(bytes % 4 == 0 && bytes <= 512 && bytes > 0);
        std::string memory(0x200, '\0');
        memory += first + std::string(0x200 - first.size(), '\0') + second + std::string(0x200 - second.size(), '\0');
        memory.resize(kFile);
        memory += file;
        memory.resize(std::max<std::size_t>(memory.size(), std::size_t{address} + bytes));
        return std::vector<unsigned char>(memory.begin() + address, memory.begin() + address + bytes);
      });
}

std::string place(const std::string& name, const std::string& bytes) { return "Local:" + name + ";10003;" + bytes; }
std::string place(const std::string& file) {
  std::string hexadecimal(8, '0');
  std::snprintf(hexadecimal.data(), hexadecimal.size() + 1, "%08zx", file.size());
  return place("a.ZIP", hexadecimal);
}

TEST(DescriptionFile, OfAnySizeThatDescriptionsHave) {
  EXPECT_TRUE(checked(place("a.xml", "12345"), ""));
  EXPECT_TRUE(checked("Local:///a.xml;0x10003;500000?SchemaVersion=1.1.0", place("b.xml", "1")));
  EXPECT_TRUE(checked("", ""));
  EXPECT_TRUE(checked("http://camera/a.xml", "File:///a.xml"));
  EXPECT_TRUE(checked("Local:a.xml", "Local:;;"));
  EXPECT_TRUE(checked(place(zip(3'000'000)), "", zip(3'000'000)));
}

TEST(DescriptionFile, LargerThanAnyIsRefused) {
  for (const char* bytes :
       {"7fffffffffffffff", "ffffffff", "0xffffffff", "-1", "fffffffffffffffffffffffffff", "4000001"}) {
    expect_refused(checked(place("a.xml", bytes), ""), {"more than any description"});
    expect_refused(checked("", place("a.xml", bytes)), {"more than any description"});
  }
}

TEST(DescriptionFile, ThatUnpacksToMoreThanAnyIsRefused) {
  for (const std::string& file : {zip(1'500'000'000), zip(1'500'000'000, std::string(3000, 'c'))}) {
    expect_refused(checked(place(file), "", file), {"unpacks to 1500000000 bytes"});
  }
}

TEST(DescriptionFile, WithoutADirectoryIsLeftToTheLibrary) {
  const std::string file(5000, 'P');
  EXPECT_TRUE(checked(place(file), "", file));
  std::string far = zip(1);
  put(far, far.size() - 6, 0xfffffff0U, 4);
  EXPECT_TRUE(checked(place(far), "", far)) << "a directory beyond the file";
  EXPECT_TRUE(check_description_file([](std::uint32_t, std::uint32_t) { return std::nullopt; }));
}

}  // namespace
}  // namespace bolo::genicam::description_file_test
