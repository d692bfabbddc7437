// Values that a key table accepts and refuses, and its messages.
#include "src/core/input_file.hpp"
#include "src/model/camera_profile.hpp"
#include "src/model/strict_toml.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::model::profile_strict_toml_test {

enum class Fruit { kApple, kPear };
constexpr std::array<std::pair<std::string_view, Fruit>, 2> kFruits{{{"apple", Fruit::kApple}, {"pear", Fruit::kPear}}};

struct Things {
  double weight = 1.5;
  int count = 3;
  double share = 0.5;
  bool any_share = true;
  std::optional<double> extra;
  std::optional<int> spare;
  unsigned mode = 0644;
  std::vector<int> cpus{1, 2};
  bool ripe = true;
  std::string label = "a \"b\"";
  std::filesystem::path file;
  Fruit fruit = Fruit::kPear;
  std::optional<Fruit> second;

  KeyTable keys() {
    KeyTable k;
    k.number("weight", weight, {0.0, 10.0, "kg"}, "Weight");
    k.text("label", label, "Label");
    k.number_or_word("share", share, any_share, "any", {0.0, 1.0, ""}, "Share");
    k.section("box", "the box");
    k.integer("count", count, {1, 9, "pieces"}, "Count");
    k.number("extra", extra, 2.5, {0.0, 5.0, "kg"}, "Extra");
    k.integer("spare", spare, 4, {0, 5, ""}, "Spare");
    k.octal("mode", mode, {0600, 0777, ""}, "Mode");
    k.integers("cpus", cpus, {0, 7, ""}, "CPUs");
    k.boolean("ripe", ripe, "Ripe");
    k.file("file", file, "x.h5", "File");
    k.choice<Fruit>("fruit", fruit, kFruits, "Fruit");
    k.choice<Fruit>("second", second, kFruits, "Second");
    return k;
  }
};

class StrictToml : public ScratchTest {
 protected:
  // Error of reading `text`, without the file's name; "" if valid.
  std::string complaint(const std::string& text) {
    const std::string file = scratch_.text("a.toml", text);
    KeyTable keys = things_.keys();
    const Status status = keys.read(file);
    if (status) return "";
    EXPECT_EQ(status.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(status.error().message.find('\n'), std::string::npos) << "one line";
    EXPECT_TRUE(status.error().message.starts_with(file + ":")) << status.error().message;
    return status.error().message.substr(file.size() + 1);
  }

  Things things_;
};

TEST_F(StrictToml, EveryKindOfValueIsRead) {
  EXPECT_EQ(complaint("weight = 2\nlabel = 'x'\n[box]\ncount = 9\nextra = 0.25\nspare = 0\nmode = 0o600\ncpus = []\n"
                      "ripe = false\nfile = 'sub/y.h5'\nfruit = 'apple'\nsecond = 'pear'\n"),
            "");
  EXPECT_EQ(things_.weight, 2.0) << "a whole number is a number";
  EXPECT_EQ(things_.label, "x");
  EXPECT_EQ(things_.count, 9);
  EXPECT_EQ(things_.extra, 0.25);
  EXPECT_EQ(things_.spare, 0);
  EXPECT_EQ(things_.mode, 0600U);
  EXPECT_TRUE(things_.cpus.empty());
  EXPECT_FALSE(things_.ripe);
  EXPECT_EQ(things_.file, scratch_ / "sub/y.h5");
  EXPECT_EQ(things_.fruit, Fruit::kApple);
  EXPECT_EQ(things_.second, Fruit::kPear);
  for (const std::string stays : {"/a/b.h5", ""}) {
    EXPECT_EQ(complaint("[box]\nfile = '" + stays + "'\n"), "");
    EXPECT_EQ(things_.file, stays);
  }
}

// Nested tables are read and freed recursively, on the stack.
TEST_F(StrictToml, TablesInTablesWithoutEndAreRefused) {
  std::string key = "a";
  for (int i = 0; i < 100'000; ++i) key += ".a";
  EXPECT_EQ(complaint("weight = 1\n" + key + " = 1\n"), "2:1: no key has so many parts");
  const std::string dots(100, '.');
  EXPECT_EQ(complaint("# " + dots + "\nlabel = '" + dots + "'  # " + dots + "\n"), "") << "no key's";
  std::string numbers = "0.5";
  for (int i = 0; i < 100; ++i) numbers += ", 0.5";
  EXPECT_EQ(complaint("numbers = [" + numbers + "]\n").find("so many parts"), std::string::npos);
}

TEST_F(StrictToml, ANumberMayBeAWord) {
  EXPECT_EQ(complaint("share = 1\n"), "");
  EXPECT_EQ(things_.share, 1.0);
  EXPECT_FALSE(things_.any_share);
  EXPECT_NE(things_.keys().document().find("# 0 to 1, or \"any\"; default 1.0\nshare = 1.0\n"), std::string::npos);
  EXPECT_EQ(complaint("share = 'any'\n"), "");
  EXPECT_TRUE(things_.any_share);
  EXPECT_EQ(things_.share, 1.0) << "the word leaves the number alone";
  EXPECT_NE(things_.keys().document().find("share = \"any\"\n"), std::string::npos);
}

TEST_F(StrictToml, WhatIsWrongIsNamedWithLineRangeAndUnit) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {"weight = 11", "1:10: weight = 11 is out of range: 0 to 10 kg"},
      {"weight = -0.5", "1:10: weight = -0.5 is out of range: 0 to 10 kg"},
      {"weight = nan", "1:10: weight = nan is out of range: 0 to 10 kg"},
      {"weight = inf", "1:10: weight = inf is out of range: 0 to 10 kg"},
      {"weight = '2'", "1:10: weight must be a number: 0 to 10 kg"},
      {"weight = true", "1:10: weight must be a number: 0 to 10 kg"},
      {"share = 2", "1:9: share = 2 is out of range: 0 to 1, or \"any\""},
      {"share = 'some'", "1:9: share must be a number: 0 to 1, or \"any\""},
      {"share = true", "1:9: share must be a number: 0 to 1, or \"any\""},
      {"label = 3", "1:9: label must be a text in quotes"},
      {"[box]\ncount = 10", "2:9: box.count = 10 is out of range: 1 to 9 pieces"},
      {"[box]\ncount = 9223372036854775807", "2:9: box.count = 9223372036854775807 is out of range: 1 to 9 pieces"},
      {"[box]\ncount = 2.0", "2:9: box.count must be a whole number: 1 to 9 pieces"},
      {"[box]\nextra = 5.5", "2:9: box.extra = 5.5 is out of range: 0 to 5 kg"},
      {"[box]\nspare = 6", "2:9: box.spare = 6 is out of range: 0 to 5"},
      {"[box]\nmode = '0644'", "2:8: box.mode must be an octal number such as 0o640, without quotes"},
      {"[box]\nmode = 644", "2:8: box.mode = 0o1204 is out of range: 0o600 to 0o777"},
      {"[box]\nmode = -1", "2:8: box.mode = -1 is out of range: 0o600 to 0o777"},
      {"[box]\ncpus = [0, 8]", "2:8: box.cpus = 8 is out of range: 0 to 7"},
      {"[box]\ncpus = 1", "2:8: box.cpus must be a list of whole numbers such as [2, 3]"},
      {"[box]\ncpus = ['a']", "2:8: box.cpus must be a list of whole numbers such as [2, 3]"},
      {"[box]\nripe = 'true'", "2:8: box.ripe must be true or false, without quotes"},
      {"[box]\nfile = 1", "2:8: box.file must be a file name in quotes"},
      {"[box]\nfruit = 'plum'", "2:9: box.fruit = \"plum\" is none of \"apple\" | \"pear\""},
      {"[box]\nsecond = 1", "2:10: box.second must be one of \"apple\" | \"pear\""},
      {"[box]\ncount = 2020-01-01", "2:9: box.count must be a whole number: 1 to 9 pieces"},
      {"[box.count]\nx = 1", "1:1: box.count must be a whole number: 1 to 9 pieces"},
      {"weigth = 1", "1:1: unknown key 'weigth'; did you mean 'weight'?"},
      {"[box]\ncuont = 1", "2:1: unknown key 'box.cuont'; did you mean 'box.count'?"},
      {"count = 1", "1:1: unknown key 'count'; did you mean 'box.count'?"},
      {"[bxo]\ncount = 1", "1:2: unknown key 'bxo'; did you mean 'box'?"},
      {"temperature = 1", "1:1: unknown key 'temperature'"},
      {"box = 3", "1:1: 'box' is a section: write [box]"},
      {"[[box]]\ncount = 1", "1:3: 'box' is a section: write [box]"},
      {"[box]\nfruit = 3\ncount = 10\nx = 1", "2:9: box.fruit must be one of \"apple\" | \"pear\" (and 2 more wrong)"},
  };
  for (const auto& [text, expected] : cases) EXPECT_EQ(complaint(text), expected) << text;
}

// A key or value of any length is quoted by its beginning.
TEST_F(StrictToml, WhatIsQuotedIsBounded) {
  const std::string most(80, 'p');
  const std::string more = most + std::string(400'000, 'p');
  EXPECT_EQ(complaint("[box]\nfruit = '" + more + "'"),
            "2:9: box.fruit = \"" + most + "...\" is none of \"apple\" | \"pear\"");
  EXPECT_EQ(complaint(more + " = 1"), "1:1: unknown key '" + most + "...'");
  EXPECT_EQ(complaint("[box]\n" + more + " = 1"), "2:1: unknown key 'box." + most.substr(4) + "...'");
  EXPECT_LE(complaint(more + " = 1\n" + more + " = 1").size(), 1000U) << "of the library's own words";
}

TEST_F(StrictToml, NothingIsStoredWhenAnythingIsWrong) {
  EXPECT_NE(complaint("weight = 9\n[box]\ncount = 10\n"), "");
  EXPECT_EQ(things_.weight, 1.5);
}

TEST_F(StrictToml, SyntaxErrorsHaveAPlace) {
  for (const std::string text : {"weight = ", "weight 3", "[box", "weight = 1\nweight = 2", "label = \"\xff\xfe\"",
                                 "a = [[[[[[[[", "\x01\x02\x03"}) {
    const std::string message = complaint(text);
    ASSERT_FALSE(message.empty()) << text;
    EXPECT_TRUE(message[0] == '1' || message[0] == '2') << message;
  }
  EXPECT_TRUE(complaint("weight = 1\nweight = 2").starts_with("2:")) << "a key given twice";
}

TEST_F(StrictToml, FilesThatCannotBeReadAreNamed) {
  KeyTable keys = things_.keys();
  EXPECT_EQ(keys.read("/nonexistent/x.toml").error().message, "/nonexistent/x.toml: no such file");
  EXPECT_EQ(keys.read("/tmp").error().message, "/tmp: is a folder, not a file");
  // Can be opened, but not read.
  const std::string unreadable = "/sys/class/net/lo/speed";
  EXPECT_EQ(keys.read(unreadable).error().message, unreadable + ": cannot be read: Invalid argument");
  EXPECT_TRUE(complaint(std::string((1 << 20) + 1, '\n')).ends_with("is larger than the 1 MiB that it may be"));
}

TEST_F(StrictToml, TheDocumentReadsBackAsTheDefaults) {
  const std::string document = things_.keys().document();
  expect_parts(document, {"# Weight\n# 0 to 10 kg; default 1.5\nweight = 1.5\n", "label = \"a \\\"b\\\"\"\n",
                          "\n[box]  # the box\n", "# Extra\n# 0 to 5 kg; no default, example 2.5\n#extra = 2.5\n",
                          "# 0o600 to 0o777; default 0o644\nmode = 0o644\n",
                          "# list of 0 to 7; default [1, 2]\ncpus = [1, 2]\n", "#file = \"x.h5\"\n",
                          "# \"apple\" | \"pear\"; default \"pear\"\nfruit = \"pear\"\n", "#second = \"apple\"\n"});
  things_.weight = 7.0;
  things_.mode = 0600;
  things_.cpus = {};
  EXPECT_EQ(complaint(""), "");
  EXPECT_EQ(things_.weight, 7.0) << "what no key names stays";
  EXPECT_EQ(complaint(document), "");
  EXPECT_EQ(things_.weight, 1.5);
  EXPECT_EQ(things_.mode, 0644U);
  EXPECT_EQ(things_.cpus, (std::vector<int>{1, 2}));
  EXPECT_EQ(things_.label, "a \"b\"");
  EXPECT_FALSE(things_.extra.has_value());
}

const std::string kShipped = std::string(BOLO_SOURCE_DIR) + "/config/a655sc.toml";

Result<CameraProfile> read_text(const std::string& text, const Scratch& scratch = {}) {
  return read_profile(scratch.text("profile.toml", text));
}

TEST(Profile, MistakesAreNamed) {
  expect_refused(read_text("tau = 0.011"), {":1:1: unknown key 'tau'; did you mean 'tau_s'?"});
  expect_refused(read_text("tau_s = 11"), {":1:9: tau_s = 11 is out of range: 0.0001 to 1 s"});
  expect_refused(read_text("tau_s = 0"), {"out of range"});
  expect_refused(read_text("[transport]\nbyte_order = 'middle'"),
                 {":2:14: transport.byte_order = \"middle\" is none of"});
}

TEST(Profile, TheShippedProfileIsTheDocumentedDefaultAndReadsAsIt) {
  EXPECT_EQ(*must(read_input(kShipped)), document_profile(CameraProfile())) << "config/a655sc.toml is out of date";
  const auto profile = must(read_profile(kShipped));
  EXPECT_EQ(document_profile(*profile), document_profile(CameraProfile()));
}

TEST(Profile, WhatIsUndoneReadsBackAsItWasWritten) {
  CameraProfile profile;
  profile.maps = "maps of one camera.h5";
  profile.undo = {FrameFilter::kBox, 0.75, 0.02, 0.21, 0.04, 0.003, true, 0.96, 288.5, 311.25, 0.012, true, true};
  const Scratch scratch;
  const auto read = must(read_text(document_profile(profile), scratch));
  EXPECT_EQ(read->undo, profile.undo);
  EXPECT_EQ(read->maps, scratch / "maps of one camera.h5");
}

// Cameras and files may have any bytes in their names.
TEST(Profile, TextsOfAnyBytesReadBack) {
  CameraProfile profile;
  profile.model = "a\n\"b\\c\"\x1b\x7f\t = 1 # \xc3\xa4\xff";
  profile.serial = std::string("4\0002\r", 4);
  profile.maps = "maps\nof one.h5";
  const Scratch scratch;
  const auto read = must(read_text(document_profile(profile), scratch));
  EXPECT_EQ(read->model, "a\n\"b\\c\"\x1b\x7f\t = 1 # \xc3\xa4?") << "TOML has no place for what is not UTF-8";
  EXPECT_EQ(read->serial, profile.serial);
  EXPECT_EQ(read->maps, scratch / "maps\nof one.h5");
}

TEST(Profile, SaysWhereValuesComeFromAndWhatChanged) {
  CameraProfile profile;
  profile.tau_s = 0.011 * 1.1;  // plus a rounding error
  profile.undo.emissivity = 0.96;
  const std::string text = document_profile(profile, {{"noise_k", "measured"}});
  EXPECT_NE(text.find("default 0.011\ntau_s = 0.0121\n"), std::string::npos) << text;
  EXPECT_NE(text.find("; measured\nnoise_k = 0.03\n"), std::string::npos) << text;
  EXPECT_EQ(changes({}, profile), (std::vector<std::string>{"radiometry.emissivity = 0.96", "tau_s = 0.0121"}));
  EXPECT_TRUE(changes(profile, profile).empty());
}

TEST(Profile, ABoxThatCannotBeUndoneIsRefused) {
  expect_refused(read_text("[firmware]\nframe_filter = 'box'\nframe_filter_weight = 0.5\n"),
                 {":3:23: frame_filter_weight of a box must be above 0.5"});
  EXPECT_TRUE(read_text("[firmware]\nframe_filter = 'recursive'\nframe_filter_weight = 0.5\n"));
}

}  // namespace bolo::model::profile_strict_toml_test
