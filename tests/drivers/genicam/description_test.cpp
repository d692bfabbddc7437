// Descriptions that no library can evaluate to the end.
#include <dlfcn.h>

#include "drivers/genicam/description.hpp"
#include "drivers/genicam/division_trap.hpp"
#include "tests/refusal.hpp"

namespace bolo::genicam::description_test {

Status checked(const std::string& nodes) {
  const std::string xml =
      "<?xml version=\"1.0\"?><RegisterDescription ModelName=\"x\" "
      "xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">" +
      nodes + "</RegisterDescription>";
  const Ref<ArvGc> description(arv_gc_new(nullptr, xml.data(), xml.size()));
  EXPECT_NE(description, nullptr);
  return check_description(description.get());
}

std::string integer(const std::string& name, const std::string& from) {
  return "<Integer Name=\"" + name + "\"><pValue>" + from + "</pValue></Integer>";
}

TEST(Description, ValuesThatAreTakenFromThemselves) {
  expect_refused(checked(integer("Width", "Width")), {"without an end", "Width"});
  expect_refused(checked(integer("Width", "Height") + integer("Height", "Width")), {"without an end"});
  expect_refused(
      checked("<IntReg Name=\"R\"><pAddress>A</pAddress></IntReg><IntSwissKnife Name=\"A\"><pVariable Name=\"V\">"
              "R</pVariable><Formula>V+1</Formula></IntSwissKnife>"),
      {"without an end"});
  expect_refused(checked("<IntReg Name=\"R\"><IntSwissKnife Name=\"A\"><pVariable Name=\"V\">R</pVariable><Formula>V"
                         "</Formula></IntSwissKnife></IntReg>"),
                 {"without an end"});
}

TEST(Description, ValuesThatTakeForEver) {
  std::string chain;
  std::string from_the_end;
  std::string doubled;
  for (int i = 0; i < 1000; ++i) chain += integer("N" + std::to_string(i), "N" + std::to_string(i + 1));
  for (int i = 9000; i > 1000; --i) from_the_end += integer("N" + std::to_string(i), "N" + std::to_string(i - 1));
  for (int i = 0; i < 60; ++i) {
    const std::string next = "N" + std::to_string(i + 1);
    doubled += "<IntSwissKnife Name=\"N" + std::to_string(i) + "\"><pVariable Name=\"A\">" + next +
               "</pVariable><pVariable Name=\"B\">" + next + "</pVariable><Formula>A+B</Formula></IntSwissKnife>";
  }
  expect_refused(checked(chain), {"without an end"});
  expect_refused(checked(from_the_end), {"without an end"});
  expect_refused(checked(doubled), {"without an end"});
}

TEST(Description, FormulasThatTakeAllMemory) {
  const auto knife = [](const std::string& formula, std::size_t terms) {
    std::string sum = "1";
    for (std::size_t i = 1; i < terms; ++i) sum += "+1";
    return "<IntConverter Name=\"Width\"><" + formula + ">" + sum + "</" + formula + "></IntConverter>";
  };
  for (const char* formula : {"Formula", "FormulaTo", "FormulaFrom", "Expression"}) {
    EXPECT_TRUE(checked(knife(formula, 1000))) << formula;
    expect_refused(checked(knife(formula, 100'000)), {"formulas without an end", "Width"});
  }
}

TEST(Description, RegistersOfImpossibleLengths) {
  for (const char* length : {"1099511627776", "0x10000000000", "65537", "-1", "0", "99999999999999999999"}) {
    for (const std::string kind : {"StringReg", "IntReg", "FloatReg", "MaskedIntReg"}) {
      const std::string node =
          "<" + kind + " Name=\"R\"><Address>8</Address><Length>" + length + "</Length></" + kind + ">";
      expect_refused(checked(node), {"impossible lengths", "R"});
    }
  }
  expect_refused(checked("<StringReg Name=\"S\"><Address>8</Address><pLength>L</pLength></StringReg>"),
                 {"lengths", "S"});
  EXPECT_TRUE(
      checked("<StringReg Name=\"S\"><Address>8</Address><Length>0x200</Length></StringReg>"
              "<Register Name=\"F\"><Address>8</Address><pLength>L</pLength></Register>"
              "<Register Name=\"T\"><Address>8</Address><Length>1000000</Length></Register>"));
}

TEST(Description, FormulasThatDivideTheSmallestInteger) {
  survive_division_of_smallest();
  for (const char* formula : {"(1<<63)/(0-1)", "(1<<63)%(0-1)"}) {
    const Ref<ArvEvaluator> evaluator(arv_evaluator_new(formula));
    EXPECT_EQ(arv_evaluator_evaluate_as_int64(evaluator.get(), nullptr), 0) << formula;
  }
}

TEST(Description, OfADamagedOneTheLibrariesSayNothing) {
  constexpr std::string_view kDamaged = "<?xml version='1.0'?><RegisterDescription><a b=c></RegisterDescription>";
  silence_glib();
  testing::internal::CaptureStderr();
  const Ref<ArvGc> damaged(arv_gc_new(nullptr, kDamaged.data(), kDamaged.size()));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// Limits of two features name one another, and a selector what it selects.
TEST(Description, WhatRealCamerasSayIsTaken) {
  EXPECT_TRUE(checked(""));
  EXPECT_TRUE(
      checked("<Category Name=\"Root\"><pFeature>Width</pFeature></Category>"
              "<Integer Name=\"Width\"><pValue>W</pValue><pMax>Most</pMax><pSelected>Offset</pSelected></Integer>"
              "<IntSwissKnife Name=\"Most\"><pVariable Name=\"O\">Offset</pVariable><Formula>640-O</Formula>"
              "</IntSwissKnife>"
              "<Integer Name=\"Offset\"><pValue>O</pValue><pMax>Left</pMax></Integer>"
              "<IntSwissKnife Name=\"Left\"><pVariable Name=\"W\">Width</pVariable><Formula>640-W</Formula>"
              "</IntSwissKnife>"
              "<IntReg Name=\"W\"><Address>1</Address></IntReg><IntReg Name=\"O\"><Address>2</Address></IntReg>"));
}

// --- Files that no camera has, as their places and directories state them.

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
  put(end, 8, 1, 2);
  put(end, 10, 1, 2);
  put(end, 12, static_cast<std::uint32_t>(entry.size()), 4);
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
  EXPECT_TRUE(checked("http://camera/a.xml", ""));
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

// Aravis takes the last of several places, and the lower 32 bits of an address.
TEST(DescriptionFile, WhereNoCameraHasOneIsRefused) {
  for (const char* where :
       {"a.zip;ffffffffffffffff;40", "a.zip;-1;40", "a.zip;100010003;40", "a.zip;fffffff1;10", "a.zip;ffffffff;2",
        "a.xml;10003;40;x.zip;20000;7fffffffffffffff", "//x;1;2/b.zip;3;4", "a.xml;1;2\nb.zip;3;4"}) {
    expect_refused(checked(std::string("Local:") + where, ""), {"where no camera has one"});
  }
  int reads = 0;
  EXPECT_TRUE(check_description_file([&](std::uint32_t address, std::uint32_t bytes) {
    reads += address > 0x400 ? 1 : 0;
    std::vector<unsigned char> memory(bytes);
    if (address == 0x200) std::ranges::copy(std::string("Local:a.zip;ffffff80;80"), memory.begin());
    return std::optional(memory);
  }));
  EXPECT_GT(reads, 0) << "up to the last byte it is looked at";
}

TEST(DescriptionFile, ThatUnpacksToMoreThanAnyIsRefused) {
  for (const std::string& file : {zip(1'500'000'000), zip(1'500'000'000, std::string(3000, 'c'))}) {
    expect_refused(checked(place(file), "", file), {"unpacks to 1500000000 bytes"});
  }
}

TEST(DescriptionFile, OfThisComputerIsRefused) {
  expect_refused(checked("File:///dev/zero", ""), {"of this computer", "/dev/zero"});
  expect_refused(checked(place("a.xml", "100"), "file:/etc/passwd"), {"of this computer"});
  expect_refused(checked("ftp://strangers/a.xml", ""), {"or another", "ftp:"});
}

// One whose content begins as that of an entry does.
std::string with_entry() {
  std::string file = zip(900);
  put(file, 0, 0x04034b50U, 4);
  put(file, 26, 5, 2);
  put(file, 28, 0, 2);
  put(file, 700 + 20, 600, 4);
  return file;
}

TEST(DescriptionFile, ThatLeadsBeyondItselfIsRefused) {
  EXPECT_TRUE(checked(place(with_entry()), "", with_entry()));
  struct Change {
    const char* what;
    std::size_t at;  // from the directory on
    std::uint32_t value;
    std::size_t size;
  };
  for (const Change& change : {Change{"the directory's place", 51 + 16, 0x7ffffff0U, 4},
                               {"the directory's size", 51 + 12, 0xfffffff0U, 4},
                               {"too many entries", 51 + 10, 65, 2},
                               {"the name", 28, 0xffff, 2},
                               {"the entry's place", 42, 0xfffffff0U, 4},
                               {"what is packed", 20, 800, 4}}) {
    std::string file = with_entry();
    put(file, 700 + change.at, change.value, change.size);
    SCOPED_TRACE(change.what);
    expect_error(checked(place(file), "", file), {"damaged ZIP"});
  }
  const std::string cut = with_entry().substr(0, 700 + 51 + 10);
  expect_refused(checked(place(cut), "", cut), {"damaged ZIP"});
}

TEST(DescriptionFile, WithoutADirectoryIsLeftToTheLibrary) {
  const std::string file(5000, 'P');
  EXPECT_TRUE(checked(place(file), "", file));
  EXPECT_TRUE(check_description_file([](std::uint32_t, std::uint32_t) { return std::nullopt; }));
}

// By the function that Aravis calls with what the camera says then.
TEST(DescriptionFile, NoOtherPlaceThanTheCheckedOnesIsTold) {
  using Parse = gboolean(const char*, gssize, char**, char**, char**, char**, char**, guint64*, guint64*);
  const auto told = [](const char* url) {
    guint64 size = 0;
    const auto parse = reinterpret_cast<Parse*>(dlsym(RTLD_DEFAULT, "arv_parse_genicam_url"));
    return parse(url, -1, nullptr, nullptr, nullptr, nullptr, nullptr, nullptr, &size) != FALSE && size == 0x40;
  };
  EXPECT_TRUE(checked("Local:a.xml;10003;40", "Local:b.xml;10003;40"));
  EXPECT_TRUE(told("Local:a.xml;10003;40") && told("Local:b.xml;10003;40"));
  for (const char* other : {"File:///dev/zero", "Local:a.xml;10003;ffffffffffffff", "Local:c.xml;10003;40", ""}) {
    EXPECT_FALSE(told(other)) << other;
  }
}

}  // namespace bolo::genicam::description_test
