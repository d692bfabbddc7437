// Names and texts of any bytes, as file systems and strangers' captures have them.
#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"

namespace bolo::tools::test::names_test {

class Names : public ProgramTest {
 protected:
  Names() : ProgramTest({BOLO_PROGRAM}) {}

  // Two frames.
  std::string capture(const std::string& note) const {
    SmallCapture capture(file("in.h5"), small_info({2, 1}));
    EXPECT_TRUE(capture->write_attribute("note", note));
    for (const std::uint64_t i : {0U, 1U}) capture.append(0.005 * static_cast<double>(i), i, [](auto) { return 7; });
    capture.close();
    return file("in.h5");
  }
};

TEST_F(Names, JsonIsWrittenWithThem) {
  const std::string name = file("a\xff.h5");           // no UTF-8
  const std::string shown = file("a\xef\xbf\xbd.h5");  // U+FFFD
  const auto json_of = [this](const std::vector<std::string>& words) { return nlohmann::json::parse(printed(words)); };
  EXPECT_EQ(json_of({"simulate", "-o", name, "--frames", "2", "--width", "8", "--height", "4", "--json"})["file"],
            shown);
  std::filesystem::remove(name);
  EXPECT_EQ(json_of({"recover", capture(""), "-o", name, "--json"})["output"], shown);
  const std::string moves =
      "\xc2\x9b"
      "2J\xe2\x80\xae";  // CSI of 8 bits, and letters from right to left
  const std::string printed_json = printed({"info", capture(moves), "--json"});
  EXPECT_EQ(nlohmann::json::parse(printed_json)["attributes"]["note"], moves);
  expect_none(printed_json, {"\xc2\x9b", "\xe2\x80\xae"});
}

TEST_F(Names, InfoShowsAttributesOfAnyBytes) {
  expect_parts(printed({"info", capture("\xc3\xa4\xff")}), {"note \"\xc3\xa4"});
}

// Nor does HDF5 print at exit about objects it could not close: each byte of the first object is damaged once.
TEST_F(Names, OfADamagedCaptureThereIsOneLine) {
  const std::string good = contents(capture(""));
  for (std::size_t at = 96; at < 128; ++at) {
    std::string damaged = good;
    damaged[at] = '\xff';
    std::ofstream(file("damaged.h5"), std::ios::binary) << damaged;
    const std::string output = run({"info", file("damaged.h5")}).err;
    EXPECT_LE(std::count(output.begin(), output.end(), '\n'), 1) << at << ": " << output.substr(0, 300);
  }
}

TEST_F(Names, NoneBreaksALineOrMovesTheCursor) {
  const std::string in = capture("");
  const std::string shown = "a?b?.h5";
  const std::string out = file("a\nb\x1b.h5");
  const std::vector<std::vector<std::string>> all{
      {"simulate", "-o", out, "--frames", "20", "--width", "8", "--height", "4"},
      {"deblur", out, "-o", file("c\nd\x1b.h5")},
      {"deblur", in, out, "-o", file("folder")},  // the first is too short
      {"convert", in, "-o", out, "--overwrite"},
      {"recover", in, "-o", out, "--overwrite"},
      {"a\nb\x1b.h5"}};
  for (const std::vector<std::string>& words : all) {
    const Outcome outcome = run(words);
    const std::string output = outcome.out + outcome.err;
    EXPECT_EQ(output.find_first_of("\x1b"), std::string::npos) << output;
    EXPECT_TRUE(output.find(shown) != std::string::npos || output.find("c?d?.h5") != std::string::npos) << output;
  }
}

TEST_F(Names, TooLongIsSaid) {
  refused({"convert", std::string(300, 'n') + ".jpg", "-o", file("a.h5")}, "File name too long");
}

}  // namespace bolo::tools::test::names_test
