// Names and texts of any bytes, as file systems and strangers' captures have them.
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/capture/capture.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

constexpr const char* kNoUtf8 = "a\xff.h5";

class Names : public ProgramTest {
 protected:
  Names() : ProgramTest({BOLO_PROGRAM}) {}

  // Two frames.
  std::string capture(const std::string& name, const std::string& note) const {
    capture::CaptureInfo info;
    info.format.geometry = {2, 1};
    info.format.frame_period_s = 0.005;
    auto writer = capture::CaptureWriter::create(file(name), info);
    EXPECT_TRUE(writer);
    EXPECT_TRUE(writer->write_attribute("note", note));
    const std::vector<std::uint16_t> plane(2, 7);
    for (std::uint64_t i = 0; i < 2; ++i) {
      EXPECT_TRUE(writer->append(0.005 * static_cast<double>(i), i, plane.data()));
    }
    EXPECT_TRUE(writer->close());
    return file(name);
  }

  // A file's name in the JSON that a verb prints.
  std::string told(const std::vector<std::string>& words, const char* key) const {
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    const auto json = nlohmann::json::parse(outcome.out, nullptr, false);
    return json.is_object() ? json.value(key, "") : outcome.out;
  }
};

TEST_F(Names, JsonIsWrittenWithThem) {
  const std::string shown = file("a\xef\xbf\xbd.h5");  // U+FFFD
  const std::vector<std::string> small{"--frames", "2", "--width", "8", "--height", "4", "--json"};
  std::vector<std::string> words{"simulate", "-o", file(kNoUtf8)};
  words.insert(words.end(), small.begin(), small.end());
  EXPECT_EQ(told(words, "file"), shown);
  std::filesystem::remove(file(kNoUtf8));
  EXPECT_EQ(told({"recover", capture("b.h5", ""), "-o", file(kNoUtf8), "--json"}, "output"), shown);
}

TEST_F(Names, InfoShowsAttributesOfAnyBytes) {
  const Outcome outcome = run({"info", capture("a.h5", "x\xff")});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("note \"x"), std::string::npos) << outcome.out;
}

TEST_F(Names, TooLongIsSaid) {
  refused({"convert", std::string(300, 'n') + ".jpg", "-o", file("a.h5")}, "File name too long");
}

}  // namespace
}  // namespace bolo::tools::test
