// GenICam descriptions that a library cannot finish evaluating.
#include <dlfcn.h>
#include <zlib.h>

#include <fmt/format.h>

#include "drivers/genicam/aravis_limits.hpp"
#include "drivers/genicam/description.hpp"
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

// The limits of two features refer to each other, and a selector to what it selects.
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

// --- The description file, from cameras that give wrong addresses, sizes or contents.

constexpr std::uint32_t kFile = 0x10003;  // no multiple of 4
const std::string kXml(700, 'x');

void put(std::string& bytes, std::size_t at, std::uint32_t value, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) bytes[at + i] = static_cast<char>(value >> (8 * i));
}

// A ZIP file with one entry, `packed`; its directory claims `unpacked` bytes.
std::string zip(const std::string& packed, std::uint32_t unpacked, const std::string& comment = "") {
  std::string local(30, '\0');
  local.replace(0, 4, "PK\x03\x04");
  put(local, 26, 5, 2);
  std::string entry(46, '\0');
  entry.replace(0, 4, "PK\x01\x02");
  put(entry, 10, packed == kXml ? 0 : 8, 2);  // stored, or deflated
  put(entry, 20, static_cast<std::uint32_t>(packed.size()), 4);
  put(entry, 24, unpacked, 4);
  put(entry, 28, 5, 2);
  std::string end(22, '\0');
  end.replace(0, 4, "PK\x05\x06");
  put(end, 8, 1, 2);
  put(end, 10, 1, 2);
  put(end, 12, 51, 4);
  put(end, 16, static_cast<std::uint32_t>(35 + packed.size()), 4);
  return local + "a.xml" + packed + entry + "a.xml" + end + comment;
}

std::string deflated(const std::string& text) {
  std::string packed(text.size() + 100, '\0');
  z_stream stream{};
  EXPECT_EQ(deflateInit2(&stream, 9, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY), Z_OK);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  packed.resize(packed.size() - stream.avail_out);
  deflateEnd(&stream);
  return packed;
}

Status taken(const std::string& first, const std::string& second, const std::string& file = kXml) {
  return take_description([&](std::uint32_t address, std::uint32_t bytes) -> std::optional<std::vector<unsigned char>> {
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
std::string place(const std::string& file) { return place("a.ZIP", fmt::format("{:08x}", file.size())); }

// Description that Aravis's own parser then reads from a camera that names `url` as its place.
std::string given(const char* url) {
  using Parse = gboolean(const char*, gssize, char**, char**, char**, char**, char**, guint64*, guint64*);
  const auto parse = reinterpret_cast<Parse*>(dlsym(RTLD_DEFAULT, "arv_parse_genicam_url"));
  char* scheme = nullptr;
  char* path = nullptr;
  guint64 address = 0;
  guint64 size = 0;
  EXPECT_TRUE(parse(url, -1, &scheme, nullptr, &path, nullptr, nullptr, &address, &size));
  const Owned<char> scheme_owner(scheme);
  const Owned<char> path_owner(path);
  if (std::string_view(scheme) != "file") return std::string("of ") + scheme;
  char* text = nullptr;
  gsize bytes = 0;
  if (g_file_get_contents(path, &text, &bytes, nullptr) == FALSE) return "none";
  const Owned<char> text_owner(text);
  return {text, bytes};
}

TEST(DescriptionFile, IsReadWhereverItIs) {
  EXPECT_TRUE(taken(place("a.xml", "2bc"), ""));
  EXPECT_EQ(given("Local:a.xml;10003;2bc"), kXml);
  EXPECT_TRUE(taken("Local:///a.xml;0x10003;2bc?SchemaVersion=1.1.0", place("b.xml", "1")));
  EXPECT_EQ(given(""), kXml);
  EXPECT_TRUE(taken("http://maker/a.xml", place("b.xml", "5")));
  EXPECT_EQ(given(""), "xxxxx");
  for (const std::string& file : {zip(kXml, 700), zip(deflated(kXml), 700), zip(deflated(kXml), 700, "comment"),
                                  "before it" + zip(deflated(kXml), 700)}) {
    EXPECT_TRUE(taken("", place(file), file));
    EXPECT_EQ(given(""), kXml);
  }
}

// When Aravis opens the camera, it may offer another file or name another place.
TEST(DescriptionFile, WhateverTheCameraSaysThenAravisIsGivenTheOneThatWasTaken) {
  const std::string file = zip(deflated(kXml), 700);
  ASSERT_TRUE(taken(place(file), "", file));
  for (const char* url : {"Local:a.zip;10003;89", "File:///dev/zero", "Local:a.xml;10003;ffffffffffffff", ""}) {
    EXPECT_EQ(given(url), kXml) << url;
  }
  EXPECT_FALSE(taken("File:///dev/zero", ""));
  EXPECT_EQ(given("File:///dev/zero"), "none");
}

TEST(DescriptionFile, LargerThanAnyIsRefused) {
  for (const char* bytes :
       {"7fffffffffffffff", "ffffffff", "0xffffffff", "-1", "fffffffffffffffffffffffffff", "4000001"}) {
    expect_refused(taken(place("a.xml", bytes), ""), {"more than any description"});
    expect_refused(taken("", place("a.xml", bytes)), {"more than any description"});
  }
}

TEST(DescriptionFile, WhereNoCameraHasOneIsRefused) {
  for (const char* where : {"a.zip;ffffffffffffffff;40", "a.zip;-1;40", "a.zip;100010003;40", "a.zip;fffffff1;10",
                            "a.zip;ffffffff;2", "a.xml", ";;", "a.xml;10003", "a.xml;10003;", "a.xml;10003;0", ""}) {
    expect_refused(taken(std::string("Local:") + where, ""), {"where no camera has one"});
  }
  int reads = 0;
  EXPECT_TRUE(take_description([&](std::uint32_t address, std::uint32_t bytes) {
    reads += address > 0x400 ? 1 : 0;
    std::vector<unsigned char> memory(bytes, address > 0x400 ? 'x' : 0);
    if (address == 0x200) std::ranges::copy(std::string("Local:a.xml;ffffff80;80"), memory.begin());
    return std::optional(memory);
  }));
  EXPECT_GT(reads, 0) << "up to the last byte it is read";
}

TEST(DescriptionFile, OfASilentCamera) {
  expect_error(take_description([](std::uint32_t, std::uint32_t) { return std::nullopt; }), {"does not say where"});
  expect_error(take_description([](std::uint32_t address, std::uint32_t bytes) {
                 std::vector<unsigned char> memory(bytes);
                 std::ranges::copy(place("a.xml", "2bc").substr(0, bytes), memory.begin());
                 return address < kFile - 3 ? std::optional(memory) : std::nullopt;
               }),
               {"cannot be read", "local:a.xml"});
}

// One packet in three is lost.
TEST(DescriptionFile, OnALossyNetwork) {
  int reads = 0;
  EXPECT_TRUE(take_description([&](std::uint32_t, std::uint32_t bytes) {
    std::vector<unsigned char> memory(bytes);
    std::ranges::copy(place("a.xml", "2000").substr(0, bytes), memory.begin());
    return ++reads % 3 == 0 ? std::nullopt : std::optional(memory);
  }));
}

TEST(DescriptionFile, ThatUnpacksToMoreThanAnyIsRefused) {
  for (const std::string& file : {zip(kXml, 1'500'000'000), zip(kXml, 1'500'000'000, std::string(3000, 'c'))}) {
    expect_refused(taken(place(file), "", file), {"unpacks to 1500000000 bytes"});
  }
}

TEST(DescriptionFile, WithElementsOfEndlessAttributesIsRefused) {
  const auto element = [](int attributes) {
    std::string text = "<Integer Name=\"q\"";
    for (int i = 0; i < attributes; ++i) text += " a" + std::to_string(i) + (i % 2 == 0 ? "='>'" : " = \"1\"");
    return text + "/>";
  };
  const auto place_of = [](const std::string& file) { return place("a.xml", fmt::format("{:x}", file.size())); };
  const std::string many = element(1000);
  expect_refused(taken(place_of(many), "", many), {"hundreds of attributes"});
  std::string few;
  for (int i = 0; i < 100; ++i) few += element(100);
  EXPECT_TRUE(taken(place_of(few), "", few));
}

TEST(DescriptionFile, InAnEncodingThatHidesQuotesIsRefused) {
  const auto take = [](const std::string& file) {
    return taken(place("a.xml", fmt::format("{:x}", file.size())), "", file);
  };
  const auto declared = [](const std::string& what) { return "<?xml version=\"1.0\" " + what + "?><a/>"; };
  const std::string wide("<\0?\0x\0m\0l\0", 10);
  for (const std::string& hidden :
       {declared("encoding=\"UTF-7\""), declared("encoding = 'IBM037'"), declared("encoding='UTF-16"),
        "\xFF\xFE" + wide, wide, std::string("\0<\0?\0x", 6), std::string("\x4C\x6F\xA7\x94")}) {
    expect_refused(take(hidden), {"no XML in UTF-8, ASCII or Latin-1"});
  }
  for (const std::string& seen :
       {declared(""), declared("encoding='utf-8' standalone=\"no\""), declared("encoding=\"ISO-8859-1\""),
        "\xEF\xBB\xBF" + declared("encoding=\"UTF-8\""), std::string("\n<a b='UTF-7'/>")}) {
    EXPECT_TRUE(take(seen));
  }
}

TEST(DescriptionFile, OfThisComputerIsRefused) {
  expect_refused(taken("File:///dev/zero", ""), {"of this computer", "/dev/zero"});
  expect_refused(taken("", "file:/etc/passwd"), {"of this computer"});
  expect_refused(taken("ftp://strangers/a.xml", ""), {"or another", "ftp:"});
}

TEST(DescriptionFile, ThatLeadsBeyondItselfIsRefused) {
  const std::string whole = zip(deflated(kXml), 700);
  const std::size_t end = whole.size() - 22;
  const std::size_t entry = end - 51;
  struct Change {
    const char* what;
    std::size_t at;
    std::uint32_t value;
    std::size_t size;
  };
  for (const Change& change : {Change{"the directory's place", end + 16, 0x7ffffff0U, 4},
                               {"the directory's size", end + 12, 0xfffffff0U, 4},
                               {"more entries than there are", end + 10, 65, 2},
                               {"the entry's place", entry + 42, 0xfffffff0U, 4},
                               {"what is packed", entry + 20, 800, 4},
                               {"packed without an end", entry + 20, 3, 4},
                               {"unpacked to less", entry + 24, 800, 4},
                               {"unpacked to more", entry + 24, 600, 4},
                               {"names before it", 26, 0xffff, 2},
                               {"no end", end, 0, 4}}) {
    std::string file = whole;
    put(file, change.at, change.value, change.size);
    SCOPED_TRACE(change.what);
    expect_refused(taken(place(file), "", file), {"damaged ZIP"});
  }
  for (std::size_t bytes = 1; bytes < whole.size(); ++bytes) {
    const std::string cut = whole.substr(0, bytes);
    expect_refused(taken(place(cut), "", cut), {"damaged ZIP"});
  }
}

}  // namespace bolo::genicam::description_test
