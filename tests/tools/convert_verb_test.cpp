// `bolo convert` as its user meets it. Radiometric stills are put together here by the structure that exiftool
// documents for FLIR's APP1 segments, and exiftool itself reads them.
#include <sys/resource.h>
#include <sys/stat.h>

#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"
#include "tools/cli/process.hpp"
#include "tools/convert/flir_still.hpp"
#include "tools/convert/picture.hpp"

namespace bolo::tools::convert_verb_test {

namespace fs = std::filesystem;
using test::Outcome;

constexpr int kWidth = 40;
constexpr int kHeight = 24;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;

std::uint16_t value_at(std::size_t frame, std::size_t pixel) {
  return static_cast<std::uint16_t>(29000 + 10 * frame + 3 * pixel);
}

class ConvertVerb : public test::ProgramTest {
 protected:
  ConvertVerb() : ProgramTest({BOLO_PROGRAM, "convert"}) {}

  // kelvin = 0.01 v, frame numbers with a gap, an event.
  void write_capture(const std::string& name, std::size_t frames) const {
    test::SmallCapture capture(file(name), test::small_info({kWidth, kHeight}));
    for (std::size_t i = 0; i < frames; ++i) {
      capture.append(1.0 + 0.005 * static_cast<double>(i), 7 + 2 * i, [i](std::size_t p) { return value_at(i, p); });
    }
    ASSERT_TRUE(capture->add_event({1.0, "nuc"}));
    ASSERT_TRUE(capture->write_attribute("solver", "admm"));
    capture.close();
  }

  capture::CaptureReader open(const std::string& name) const { return *must(capture::CaptureReader::open(file(name))); }

  capture::CaptureReader expect_values(const std::string& name, std::size_t frames) const {
    capture::CaptureReader reader = open(name);
    EXPECT_EQ(reader.info().frames, frames);
    EXPECT_EQ(reader.info().format.type, PixelType::kUint16);
    for (std::size_t i = 0; i < frames; ++i) {
      std::vector<std::uint16_t> plane(kPixels);
      for (std::size_t p = 0; p < kPixels; ++p) plane[p] = value_at(i, p);
      EXPECT_EQ(test::frame_values(reader, i), plane) << "frame " << i;
    }
    return reader;
  }
};

TEST_F(ConvertVerb, PicturesOf16BitsAndBackAreTheSameCounts) {
  write_capture("a.h5", 3);
  expect_parts(
      printed(words("@a.h5 -o @p.png")),
      {"kelvin = 0.01 * value + 0", "3 files, " + file("p_000000.png") + " to p_000002.png: 3 frames of 40x24\n"});
  done(words("@p_000000.png @p_000001.png @p_000002.png -o @b.h5 --rate 200 --scale 0.01"));
  const capture::CaptureReader reader = expect_values("b.h5", 3);
  EXPECT_EQ(reader.info().format.scale.unit, Unit::kKelvin);
  EXPECT_EQ(reader.info().format.scale.scale, 0.01);
  EXPECT_NEAR(reader.t()[2], 0.010, 1e-12);
  done(words("@p_000000.png -o @c.h5"));
  EXPECT_EQ(open("c.h5").info().format.scale.unit, Unit::kCount) << "nobody said what a count is";
  const std::string one = printed(words("@a.h5 -o @one.png --frame 1"));
  EXPECT_TRUE(one.starts_with(file("one.png") + ": 1 frame of 40x24\n")) << one;
  EXPECT_EQ(test::contents(file("one.png")), test::contents(file("p_000001.png")));
  refused(words("@a.h5 -o @none.png --frame 3"), "--frame 3: there are frames 0 to 2");
}

TEST_F(ConvertVerb, ANameWithACommaIsOneFile) {
  write_capture("a,b.h5", 2);
  write_capture("b.h5", 4);
  done(words("@a,b.h5 -o @c.h5"));
  expect_values("c.h5", 2);
}

TEST_F(ConvertVerb, ACaptureKeepsNumbersTimesAndEvents) {
  write_capture("a.h5", 5);
  fs::copy(file("a.h5"), file("a.mat"));  // what such a file holds is tests/capture/capture_variants_test.cpp's
  done(words("@a.mat -o @b.h5"));
  const capture::CaptureReader a = open("a.h5");
  const capture::CaptureReader b = expect_values("b.h5", 5);
  EXPECT_EQ(a.t(), b.t());
  EXPECT_EQ(a.frame_id(), b.frame_id());
  ASSERT_EQ(b.events().size(), 1U);
  EXPECT_EQ(b.events()[0].kind, "nuc");
  ASSERT_EQ(must(a.attributes())->size(), 1U);
  done(words("@a.h5 -o @one.h5 --frame 2"));
  const capture::CaptureReader one = open("one.h5");
  EXPECT_EQ(one.info().frames, 1U);
  EXPECT_EQ(must(one.attributes())->size(), 1U);
  EXPECT_NEAR(one.t()[0], 1.010, 1e-12);
  EXPECT_EQ(one.events().size(), 0U);
}

// The limit on file size simulates a full disk. The program inherits it from this process.
TEST_F(ConvertVerb, AFullDiskLeavesNothingOfACapture) {
  write_capture("a.h5", 3000);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit limit{fs::file_size(file("a.h5")) / 2, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  ended(1, words("@a.h5 -o @b.h5"), {"File too large"});
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  for (const char* name : {"b.h5", "b.h5.part", "b.h5.part.journal"}) EXPECT_FALSE(fs::exists(file(name))) << name;
}

TEST_F(ConvertVerb, PreviewsOfARangeHaveTheSameGreysInEveryFrame) {
  write_capture("a.h5", 40);
  expect_parts(printed(words("@a.h5 -o @p.png --preview --range 290.5,315.5")), {"black at 290.5, white at 315.5 K"});
  for (const std::size_t frame : {0U, 39U}) {
    const auto picture = must(read_png_picture(file(frame == 0 ? "p_000000.png" : "p_000039.png")));
    for (std::size_t p = 0; p < kPixels; ++p) {
      const double level = (0.01 * value_at(frame, p) - 290.5) / 25.0 * 255.0;
      ASSERT_NEAR(picture->u16[p] / 257, std::clamp(level, 0.0, 255.0), 1.01) << frame << " " << p;  // read as 16 bits
    }
  }
  refused(words("@a.h5 -o @q.png --preview --range 300"), "--range must be LOW,HIGH");
  refused(words("@a.h5 -o @q.png --preview --range 300,290"), "LOW below HIGH");
  refused(words("@a.h5 -o @q.png --range 290,300"), "add --preview");
}

// Each page links to the next only: seeking each from the first one took minutes.
TEST_F(ConvertVerb, AFilmOfThousandsOfPagesIsGoneThroughOnce) {
  constexpr std::size_t kPages = 6000;
  const std::vector<std::uint16_t> plane(64, 30000);
  auto writer = must(TiffWriter::create(file("long.tiff")));
  for (std::size_t i = 0; i < kPages; ++i) ASSERT_TRUE(writer->write({8, 8}, PixelType::kUint16, plane.data()));
  ASSERT_TRUE(writer->close());
  const auto begin = std::chrono::steady_clock::now();
  done({file("long.tiff"), "-o", file("long.h5")});
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
  EXPECT_EQ(open("long.h5").info().frames, kPages);
  fs::resize_file(file("long.tiff"), fs::file_size(file("long.tiff")) / 2 + 100);
  refused({file("long.tiff"), "-o", file("half.h5")}, "is cut off or damaged: of its pages only ");
  EXPECT_FALSE(fs::exists(file("half.h5")));
}

// Reading from a pipe would wait.
TEST_F(ConvertVerb, RefusesWhatIsNoFile) {
  for (const char* name : {"p.png", "p.tiff", "p.jpg", "p.cptv", "p.mcap", "p.h5"}) {
    ASSERT_EQ(mkfifo(file(name).c_str(), 0600), 0);
    refused({file(name), "-o", file("out.h5")},
            std::string(name) == "p.h5" ? "is not a regular file" : "is a pipe, not a file");
  }
}

TEST_F(ConvertVerb, ATiffThatBecomesShorterWhileItIsReadIsDamaged) {
  write_capture("a.h5", 3);
  done(words("@a.h5 -o @a.tiff"));
  auto book = must(TiffReader::open(file("a.tiff")));
  EXPECT_TRUE(book->read(0));
  fs::resize_file(file("a.tiff"), 0);
  expect_refused(book->read(2), {"damaged TIFF"});
}

TEST_F(ConvertVerb, TiffIsKelvinInFloatingPoint) {
  write_capture("a.h5", 4);
  done(words("@a.h5 -o @a.tiff"));
  const auto pages = must(count_tiff_pages(file("a.tiff")));
  EXPECT_EQ(*pages, 4U);
  auto book = must(TiffReader::open(file("a.tiff")));
  for (const std::size_t i : {0U, 2U, 1U, 1U}) {  // there and back
    const auto page = must(book->read(i));
    for (std::size_t p = 0; p < kPixels; ++p) ASSERT_NEAR(page->f32[p], 0.01 * value_at(i, p), 1e-4) << i;
  }
  EXPECT_FALSE(book->read(4));
  done(words("@a.tiff -o @b.h5 --rate 200"));
  const capture::CaptureReader reader = open("b.h5");
  EXPECT_EQ(reader.info().frames, 4U);
  EXPECT_EQ(reader.info().format.type, PixelType::kFloat32);
  // Also pictures from floating point, with the given scale.
  done(words("@a.tiff -o @p.png --scale 0.01 --offset 0"));
  const auto picture = must(read_png_picture(file("p_000002.png")));
  for (std::size_t p = 0; p < kPixels; ++p) ASSERT_NEAR(picture->u16[p], value_at(2, p), 1);
}

TEST_F(ConvertVerb, RawDumpsInEitherByteOrder) {
  for (const bool big : {false, true}) {
    std::ofstream out(file("dump.bin"), std::ios::binary | std::ios::trunc);
    out << "header16 bytes..";
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t p = 0; p < kPixels; ++p) {
        const std::uint16_t v = value_at(i, p);
        const std::array<char, 2> little{static_cast<char>(v & 0xFFU), static_cast<char>(v >> 8U)};
        out.put(little[big ? 1 : 0]).put(little[big ? 0 : 1]);
      }
    }
    out.close();
    done(words(std::string("@dump.bin --raw ") + (big ? "40x24:u16be" : "40x24") + " --skip 16 -o @a.h5 --overwrite"));
    (void)expect_values("a.h5", 3);
  }
  done(words("@dump.bin @dump.bin --raw 40x24:u16be --skip 16 -o @one.png --frame 4"));
  EXPECT_EQ(must(read_png_picture(file("one.png")))->u16[7], value_at(1, 7)) << "the second dump's second";
  refused(words("@dump.bin --raw 41x24 -o @b.h5"), "not whole frames");
  refused(words("@dump.bin --raw 41 -o @b.h5"), "--raw '41'");
  refused(words("@dump.bin --raw 40x24:u8 -o @b.h5"), "none of u16le");
}

TEST_F(ConvertVerb, AFilmHasAllFramesAndNeedsItsEncoder) {
  write_capture("a.h5", 30);
  const std::string path = std::getenv("PATH");
  setenv("PATH", "/nonexistent", 1);
  refused(words("@a.h5 -o @a.mp4"), "ffmpeg is not installed");
  setenv("PATH", path.c_str(), 1);
  if (!output_of({"ffprobe", "-version"}, "ffmpeg")) GTEST_SKIP() << "ffmpeg is not installed";
  done(words("@a.h5 -o @a.mp4"));
  const auto frames = must(output_of(
      words("ffprobe -v error -count_frames -show_entries stream=nb_read_frames,width,height -of csv=p=0 @a.mp4"),
      "ffmpeg"));
  EXPECT_EQ(contents(frames->file), "40,24,30\n");
}

TEST_F(ConvertVerb, WrongUsageIsOneLine) {
  write_capture("a.h5", 2);
  refused(words("-o @b.h5"), "which files");
  refused(words("@a.h5"), "where to");
  refused(words("@a.h5 -o @b.gif"), "must end in");
  refused(words("@a.h5 -o @a.h5 --overwrite"), "both read and written");
  refused(words("@a.h5 @a.h5 -o @b.h5"), "one capture at a time");
  refused(words("@absent.h5 -o @b.h5"), "No such file");
  refused(words("@absent.png -o @b.h5"), "absent.png");
  refused(words("@notes.txt -o @b.h5"), "--raw");
  refused(words("@a.h5 -o @b.h5 --scale 0"), "--scale");
  for (const char* unused : {"--rate 100", "--scale 0.04", "--offset -100", "--skip 16", "--topic /a"}) {
    refused(words("@a.h5 -o @b.h5 " + std::string(unused)), words(unused).front());
  }
  refused({write("bad.tiff", "no TIFF"), "-o", file("b.h5")}, "bad.tiff");
  refused({write("bad.jpg", "no JPEG"), "-o", file("b.h5")}, "bad.jpg: is no JPEG");
  fs::resize_file(write("huge.jpg", "\xff\xd8\xff"), std::uintmax_t{1} << 40U);
  refused({file("huge.jpg"), "-o", file("b.h5")}, "huge.jpg: is larger than a still can be");
  refused(words("@a.png -o @a.mcap --rate 1e-7"), "--rate must be");  // no reader takes such a period
}

// --- radiometric stills ---

// Writes a number of so many bytes, little-endian or `big`.
void put(std::string& out, std::size_t at, std::size_t bytes, std::uint32_t v, bool big = false) {
  for (std::size_t i = 0; i < bytes; ++i) out[at + i] = static_cast<char>(v >> (8 * (big ? bytes - 1 - i : i)));
}
constexpr FlirConstants kConstants{.planck_r1 = 21106.77,
                                   .planck_r2 = 0.012545258,
                                   .planck_b = 1501.0,
                                   .planck_o = -7340.0,
                                   .emissivity = 0.95,
                                   .distance_m = 2.0,
                                   .reflected_k = 295.0,
                                   .atmosphere_k = 293.0,
                                   .window_k = 294.0,
                                   .window_transmission = 0.9};

// Record 0x20, little-endian.
std::string camera_info(const FlirConstants& c) {
  std::string out(0x480, '\0');
  put(out, 0, 2, 2);
  const std::map<std::size_t, double> floats{
      {0x20, c.emissivity},   {0x24, c.distance_m}, {0x28, c.reflected_k},
      {0x2c, c.atmosphere_k}, {0x30, c.window_k},   {0x34, c.window_transmission},
      {0x3c, c.humidity},     {0x58, c.planck_r1},  {0x5c, c.planck_b},
      {0x60, c.planck_f},     {0x70, c.alpha1},     {0x74, c.alpha2},
      {0x78, c.beta1},        {0x7c, c.beta2},      {0x80, c.x},
      {0x30c, c.planck_r2}};
  for (const auto& [at, value] : floats) put(out, at, 4, std::bit_cast<std::uint32_t>(static_cast<float>(value)));
  put(out, 0x308, 4, static_cast<std::uint32_t>(static_cast<std::int32_t>(c.planck_o)));
  out.replace(0xd4, 11, "FLIR A655sc");
  out.replace(0x104, 8, "55001234");
  return out;
}

// Record 1, little-endian: a head of 32 bytes, then the PNG or the values.
std::string raw_data(const std::string& image) {
  std::string out(0x20, '\0');
  put(out, 0, 2, 2);
  put(out, 2, 2, kWidth);
  put(out, 4, 2, kHeight);
  return out + image;
}

// The FFF block: a big-endian head and directory, then the records.
std::string fff(const std::string& raw, const std::string& info) {
  constexpr std::size_t kHead = 0x40;
  constexpr std::size_t kEntry = 0x20;
  std::string out(kHead + 2 * kEntry, '\0');
  out.replace(0, 3, "FFF");
  put(out, 0x14, 4, 101, true);
  put(out, 0x18, 4, kHead, true);
  put(out, 0x1c, 4, 2, true);
  std::size_t position = out.size();
  std::size_t entry = kHead;
  for (const auto& [type, record] : {std::pair{0x01U, &raw}, {0x20U, &info}}) {
    put(out, entry, 2, type, true);
    put(out, entry + 0x0c, 4, static_cast<std::uint32_t>(position), true);
    put(out, entry + 0x10, 4, static_cast<std::uint32_t>(record->size()), true);
    position += record->size();
    entry += kEntry;
  }
  return out + raw + info;
}

// A JPEG of nothing but the segments: start, FLIR's APP1 in one part, end.
std::string jpeg(const std::string& block) {
  std::string out = "\xFF\xD8\xFF\xE1";
  out += std::string("\0\0FLIR\0\x01\0\0", 10);
  put(out, 4, 2, static_cast<std::uint32_t>(block.size() + 10), true);
  return out + block + "\xFF\xD9";
}

// The formula of flir_still.hpp, as it stands there.
double flir_raw(double kelvin, const FlirConstants& c) {
  const auto radiation = [&c](double k) {
    return c.planck_r1 / (c.planck_r2 * (std::exp(c.planck_b / k) - c.planck_f)) - c.planck_o;
  };
  const double w = c.window_transmission;
  const double e = c.emissivity;
  const double t = atmosphere_transmission(c);
  return w * (e * t * radiation(kelvin) + (1.0 - e) * t * radiation(c.reflected_k) +
              (1.0 - t) * radiation(c.atmosphere_k)) +
         (1.0 - w) * radiation(c.window_k);
}

double scene_k(std::size_t pixel) { return 290.0 + 0.05 * static_cast<double>(pixel % kWidth); }

// The raw image as a PNG, as a byte-swapped PNG, and as bare values: there are cameras of each kind.
TEST_F(ConvertVerb, RadiometricStillsBecomeKelvin) {
  if (!output_of({"exiftool", "-ver"}, "libimage-exiftool-perl")) GTEST_SKIP() << "exiftool is not installed";
  std::vector<std::uint16_t> raw;
  std::vector<std::uint16_t> swapped;
  for (std::size_t p = 0; p < kPixels; ++p) {
    raw.push_back(static_cast<std::uint16_t>(std::lround(flir_raw(scene_k(p), kConstants))));
    swapped.push_back(static_cast<std::uint16_t>(raw[p] << 8U | raw[p] >> 8U));
  }
  ASSERT_TRUE(write_png16(file("raw.png"), {kWidth, kHeight}, raw.data()));
  ASSERT_TRUE(write_png16(file("swapped.png"), {kWidth, kHeight}, swapped.data()));
  for (const std::string& image : {test::contents(file("raw.png")), test::contents(file("swapped.png")),
                                   std::string(reinterpret_cast<const char*>(raw.data()), 2 * kPixels)}) {
    write("a.jpg", jpeg(fff(raw_data(image), camera_info(kConstants))));
    done(words("@a.jpg -o @a.h5 --overwrite"));
    const capture::CaptureReader reader = open("a.h5");
    EXPECT_EQ(reader.info().camera_model, "FLIR A655sc");
    EXPECT_EQ(reader.info().camera_serial, "55001234");
    EXPECT_EQ(reader.info().format.scale.unit, Unit::kKelvin);
    const auto plane = test::frame_values<float>(reader, 0);
    for (std::size_t p = 0; p < kPixels; ++p) ASSERT_NEAR(plane[p], scene_k(p), 0.02) << "a count is about 0.03 K";
  }
}

// A single pixel without a temperature does not spoil the still.
TEST_F(ConvertVerb, AStillWhoseConstantsMakeNoTemperaturesIsRefused) {
  if (!output_of({"exiftool", "-ver"}, "libimage-exiftool-perl")) GTEST_SKIP() << "exiftool is not installed";
  std::vector<std::uint16_t> raw(kPixels, static_cast<std::uint16_t>(std::lround(flir_raw(300.0, kConstants))));
  raw[3] = 0;
  const std::string image(reinterpret_cast<const char*>(raw.data()), 2 * kPixels);
  const auto still = [&](double FlirConstants::*constant, double value) {
    FlirConstants constants = kConstants;
    constants.*constant = value;
    return write("a.jpg", jpeg(fff(raw_data(image), camera_info(constants))));
  };
  refused({still(&FlirConstants::planck_r1, 0.0), "-o", file("a.h5")}, "no temperature of any pixel");
  refused({still(&FlirConstants::planck_b, -1501.0), "-o", file("a.h5")}, "no temperature of any pixel");
  refused({still(&FlirConstants::planck_b, 1e30), "-o", file("a.h5")}, "no temperature of any pixel");
  refused({still(&FlirConstants::humidity, -1.0), "-o", file("a.h5")}, "no temperature of any pixel");
  done({still(&FlirConstants::planck_b, kConstants.planck_b), "-o", file("a.h5")});
  const auto plane = test::frame_values<float>(open("a.h5"), 0);
  EXPECT_TRUE(std::isnan(plane[3]));
  EXPECT_NEAR(plane[4], 300.0, 0.02);
}

// By hand: with everything transparent and black it is Planck's formula alone.
TEST(FlirKelvin, AgreesWithTheFormulaWithoutSurroundings) {
  FlirConstants c = kConstants;
  c.emissivity = 1.0;
  c.distance_m = 0.0;
  c.window_transmission = 1.0;
  const double raw = 15000.0;
  const double expected = 1501.0 / std::log(21106.77 / (0.012545258 * (raw - 7340.0)) + 1.0);
  EXPECT_NEAR(flir_kelvin(raw, c), expected, 1e-9);
  EXPECT_NEAR(atmosphere_transmission(c), 1.0, 1e-12);
}

// A black body as warm as all that surrounds it looks the same through anything.
TEST(FlirKelvin, SurroundingsOfTheSameTemperatureDoNotShow) {
  FlirConstants c = kConstants;
  c.reflected_k = c.atmosphere_k = c.window_k = 300.0;
  c.emissivity = 0.6;
  c.distance_m = 50.0;
  FlirConstants bare = c;
  bare.emissivity = bare.window_transmission = 1.0;
  bare.distance_m = 0.0;
  EXPECT_NEAR(flir_kelvin(flir_raw(300.0, bare), c), 300.0, 1e-9);
  EXPECT_LT(atmosphere_transmission(c), 0.95);
  EXPECT_GT(atmosphere_transmission(c), 0.5);
}

}  // namespace bolo::tools::convert_verb_test
