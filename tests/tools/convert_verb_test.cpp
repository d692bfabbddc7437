// `bolo convert` as its user meets it. Radiometric stills are put together here by the structure that exiftool
// documents for FLIR's APP1 segments, and exiftool itself reads them.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "src/capture/capture.hpp"
#include "tests/tools/program.hpp"
#include "tools/convert/flir_still.hpp"
#include "tools/convert/picture.hpp"
#include "tools/convert/program.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;

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
    capture::CaptureInfo info;
    info.format.geometry = {kWidth, kHeight};
    info.format.scale = {Unit::kKelvin, 0.01, 0.0};
    info.format.frame_period_s = 0.005;
    auto writer = capture::CaptureWriter::create(file(name), info);
    ASSERT_TRUE(writer) << writer.error().message;
    std::vector<std::uint16_t> plane(kPixels);
    for (std::size_t i = 0; i < frames; ++i) {
      for (std::size_t p = 0; p < kPixels; ++p) plane[p] = value_at(i, p);
      ASSERT_TRUE(writer->append(1.0 + 0.005 * static_cast<double>(i), 7 + 2 * i, plane.data()));
    }
    ASSERT_TRUE(writer->add_event({1.0, "nuc"}));
    ASSERT_TRUE(writer->close());
  }

  capture::CaptureReader open(const std::string& name) const {
    auto reader = capture::CaptureReader::open(file(name));
    EXPECT_TRUE(reader) << reader.error().message;
    return std::move(*reader);
  }

  void expect_values(const std::string& name, std::size_t frames) const {
    const capture::CaptureReader reader = open(name);
    ASSERT_EQ(reader.info().frames, frames);
    ASSERT_EQ(reader.info().format.type, PixelType::kUint16);
    std::vector<std::uint16_t> plane(kPixels);
    for (std::size_t i = 0; i < frames; ++i) {
      ASSERT_TRUE(reader.read_frame(i, plane.data()));
      for (std::size_t p = 0; p < kPixels; ++p) ASSERT_EQ(plane[p], value_at(i, p));
    }
  }
};

TEST_F(ConvertVerb, PicturesOf16BitsAndBackAreTheSameCounts) {
  write_capture("a.h5", 3);
  const Outcome outcome = run({file("a.h5"), "-o", file("p.png")});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("kelvin = 0.01 * value + 0"), std::string::npos) << outcome.out;
  const std::vector<std::string> pictures{file("p_000000.png"), file("p_000001.png"), file("p_000002.png")};
  done({pictures[0], pictures[1], pictures[2], "-o", file("b.h5"), "--rate", "200", "--scale", "0.01"});
  expect_values("b.h5", 3);
  const capture::CaptureReader reader = open("b.h5");
  EXPECT_EQ(reader.info().format.scale.unit, Unit::kKelvin);
  EXPECT_EQ(reader.info().format.scale.scale, 0.01);
  EXPECT_NEAR(reader.t()[2], 0.010, 1e-12);
  done({pictures[0], "-o", file("c.h5")});
  EXPECT_EQ(open("c.h5").info().format.scale.unit, Unit::kCount) << "nobody said what a count is";
}

TEST_F(ConvertVerb, SaysWhichPicturesItWroteAndTakesOneFrame) {
  write_capture("a.h5", 3);
  const Outcome all = run({file("a.h5"), "-o", file("p.png")});
  EXPECT_NE(all.out.find("3 files, " + file("p_000000.png") + " to p_000002.png: 3 frames of 40x24\n"),
            std::string::npos)
      << all.out;
  const Outcome one = run({file("a.h5"), "-o", file("one.png"), "--frame", "1"});
  ASSERT_EQ(one.exit_code, 0) << one.err;
  EXPECT_TRUE(one.out.starts_with(file("one.png") + ": 1 frame of 40x24\n")) << one.out;
  EXPECT_EQ(test::contents(file("one.png")), test::contents(file("p_000001.png")));
  refused({file("a.h5"), "-o", file("none.png"), "--frame", "3"}, "--frame 3: there are frames 0 to 2");
  done({file("a.h5"), "-o", file("one.h5"), "--frame", "2"});
  const capture::CaptureReader reader = open("one.h5");
  EXPECT_EQ(reader.info().frames, 1U);
  EXPECT_NEAR(reader.t()[0], 1.010, 1e-12);
  EXPECT_EQ(reader.events().size(), 0U);
}

TEST_F(ConvertVerb, PreviewsOfARangeHaveTheSameGreysInEveryFrame) {
  write_capture("a.h5", 40);
  const Outcome made = run({file("a.h5"), "-o", file("p.png"), "--preview", "--range", "290.5,315.5"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_NE(made.out.find("black at 290.5, white at 315.5 K"), std::string::npos) << made.out;
  for (const std::size_t frame : {0U, 39U}) {
    const auto picture = read_png_picture(file(frame == 0 ? "p_000000.png" : "p_000039.png"));
    ASSERT_TRUE(picture) << picture.error().message;
    for (std::size_t p = 0; p < kPixels; ++p) {
      const double level = (0.01 * value_at(frame, p) - 290.5) / 25.0 * 255.0;
      ASSERT_NEAR(picture->u16[p] / 257, std::clamp(level, 0.0, 255.0), 1.01) << frame << " " << p;  // read as 16 bits
    }
  }
  refused({file("a.h5"), "-o", file("q.png"), "--preview", "--range", "300"}, "--range must be LOW,HIGH");
  refused({file("a.h5"), "-o", file("q.png"), "--preview", "--range", "300,290"}, "LOW below HIGH");
  refused({file("a.h5"), "-o", file("q.png"), "--range", "290,300"}, "add --preview");
}

// Each page leads to the next only: to look for each from the first one took minutes.
TEST_F(ConvertVerb, AFilmOfThousandsOfPagesIsGoneThroughOnce) {
  constexpr std::size_t kPages = 6000;
  const std::vector<std::uint16_t> plane(64, 30000);
  auto writer = TiffWriter::create(file("long.tiff"));
  ASSERT_TRUE(writer);
  for (std::size_t i = 0; i < kPages; ++i) ASSERT_TRUE(writer->write({8, 8}, PixelType::kUint16, plane.data()));
  ASSERT_TRUE(writer->close());
  const auto begin = std::chrono::steady_clock::now();
  done({file("long.tiff"), "-o", file("long.h5")});
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
  EXPECT_EQ(open("long.h5").info().frames, kPages);
}

// A pipe would be waited for.
TEST_F(ConvertVerb, RefusesWhatIsNoFile) {
  for (const char* name : {"p.png", "p.tiff", "p.jpg", "p.cptv", "p.mcap", "p.h5"}) {
    ASSERT_EQ(mkfifo(file(name).c_str(), 0600), 0);
    const Outcome outcome = run({file(name), "-o", file("out.h5")});
    EXPECT_EQ(outcome.exit_code, 2) << name;
    EXPECT_TRUE(outcome.err.find("is a pipe, not a file") != std::string::npos ||
                outcome.err.find("is not a regular file") != std::string::npos)
        << outcome.err;
  }
}

TEST_F(ConvertVerb, TiffIsKelvinInFloatingPoint) {
  write_capture("a.h5", 4);
  done({file("a.h5"), "-o", file("a.tiff")});
  const auto pages = count_tiff_pages(file("a.tiff"));
  ASSERT_TRUE(pages);
  EXPECT_EQ(*pages, 4U);
  auto book = TiffReader::open(file("a.tiff"));
  ASSERT_TRUE(book);
  for (const std::size_t i : {0U, 2U, 1U, 1U}) {  // there and back
    const auto one = read_tiff_page(file("a.tiff"), i);
    const auto read = book->read(i);
    ASSERT_TRUE(one && read) << i;
    EXPECT_EQ(read->u16, one->u16) << i;
    EXPECT_EQ(read->f32, one->f32) << i;
  }
  EXPECT_FALSE(book->read(4));
  const auto page = read_tiff_page(file("a.tiff"), 2);
  ASSERT_TRUE(page) << page.error().message;
  for (std::size_t p = 0; p < kPixels; ++p) ASSERT_NEAR(page->f32[p], 0.01 * value_at(2, p), 1e-4);
  done({file("a.tiff"), "-o", file("b.h5"), "--rate", "200"});
  const capture::CaptureReader reader = open("b.h5");
  EXPECT_EQ(reader.info().frames, 4U);
  EXPECT_EQ(reader.info().format.type, PixelType::kFloat32);
  // And pictures from floating point, by the scale that is asked for.
  done({file("a.tiff"), "-o", file("p.png"), "--scale", "0.01", "--offset", "0"});
  const auto picture = read_png_picture(file("p_000002.png"));
  ASSERT_TRUE(picture) << picture.error().message;
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
    done({file("dump.bin"), "--raw", big ? "40x24:u16be" : "40x24", "--skip", "16", "-o", file("a.h5"), "--overwrite"});
    expect_values("a.h5", 3);
  }
  refused({file("dump.bin"), "--raw", "41x24", "-o", file("b.h5")}, "not whole frames");
  refused({file("dump.bin"), "--raw", "41", "-o", file("b.h5")}, "--raw '41'");
  refused({file("dump.bin"), "--raw", "40x24:u8", "-o", file("b.h5")}, "none of u16le");
}

TEST_F(ConvertVerb, ACaptureKeepsNumbersTimesAndEvents) {
  write_capture("a.h5", 5);
  done({file("a.h5"), "-o", file("b.h5")});
  expect_values("b.h5", 5);
  const capture::CaptureReader a = open("a.h5");
  const capture::CaptureReader b = open("b.h5");
  EXPECT_EQ(a.t(), b.t());
  EXPECT_EQ(a.frame_id(), b.frame_id());
  ASSERT_EQ(b.events().size(), 1U);
  EXPECT_EQ(b.events()[0].kind, "nuc");
}

// As MATLAB writes frames(n, x, y): dimensions in reverse, 512 bytes of its own before HDF5's.
TEST_F(ConvertVerb, TheAuthorsMatlabFileBecomesACapture) {
  const std::string script = R"(
import h5py, numpy, sys
with h5py.File(sys.argv[1], 'w', userblock_size=512) as f:
    n, y, x = numpy.meshgrid(numpy.arange(6), numpy.arange(24), numpy.arange(40), indexing='ij')
    f['frames'] = numpy.ascontiguousarray((290 + n + 0.25 * y + 0.5 * x).astype('f4').transpose(1, 2, 0))
    f['t'] = (0.005 * numpy.arange(6)).reshape(6, 1)
with open(sys.argv[1], 'r+b') as f:
    f.write(b'MATLAB 7.3 MAT-file')
)";
  const Outcome made = Program({"/usr/bin/python3", "-c", script, file("a.mat")}, file("made")).outcome();
  if (made.err.find("No module named") != std::string::npos) GTEST_SKIP() << "python3-h5py is not installed";
  ASSERT_EQ(made.exit_code, 0) << made.err;
  done({file("a.mat"), "-o", file("b.h5")});
  const capture::CaptureReader reader = open("b.h5");
  ASSERT_EQ(reader.info().frames, 6U);
  ASSERT_EQ(reader.info().format.geometry, (Geometry{kWidth, kHeight}));
  ASSERT_EQ(reader.info().format.type, PixelType::kFloat32);
  EXPECT_NEAR(reader.t()[5], 0.025, 1e-9);
  std::vector<float> plane(kPixels);
  ASSERT_TRUE(reader.read_frame(3, plane.data()));
  for (std::size_t i = 0; i < kPixels; ++i) {
    ASSERT_EQ(plane[i], 293.0F + 0.25F * static_cast<float>(i / kWidth) + 0.5F * static_cast<float>(i % kWidth));
  }
}

TEST_F(ConvertVerb, AFilmHasAllFrames) {
  if (!output_of({"ffprobe", "-version"}, "ffmpeg")) GTEST_SKIP() << "ffmpeg is not installed";
  write_capture("a.h5", 30);
  done({file("a.h5"), "-o", file("a.mp4")});
  const auto frames = output_of({"ffprobe", "-v", "error", "-count_frames", "-show_entries",
                                 "stream=nb_read_frames,width,height", "-of", "csv=p=0", file("a.mp4")},
                                "ffmpeg");
  ASSERT_TRUE(frames) << frames.error().message;
  EXPECT_EQ(*frames, "40,24,30\n");
}

TEST_F(ConvertVerb, WithoutTheEncoderItIsSaid) {
  write_capture("a.h5", 2);
  const std::string path = std::getenv("PATH");
  setenv("PATH", "/nonexistent", 1);
  refused({file("a.h5"), "-o", file("a.mp4")}, "ffmpeg is not installed");
  setenv("PATH", path.c_str(), 1);
}

TEST_F(ConvertVerb, WrongUsageIsOneLine) {
  write_capture("a.h5", 2);
  refused({"-o", file("b.h5")}, "which files");
  refused({file("a.h5")}, "where to");
  refused({file("a.h5"), "-o", file("b.gif")}, "must end in");
  refused({file("a.h5"), "-o", file("a.h5"), "--overwrite"}, "both read and written");
  refused({file("a.h5"), file("a.h5"), "-o", file("b.h5")}, "one capture at a time");
  refused({file("absent.h5"), "-o", file("b.h5")}, "No such file");
  refused({file("absent.png"), "-o", file("b.h5")}, "absent.png");
  refused({file("notes.txt"), "-o", file("b.h5")}, "--raw");
  refused({file("a.h5"), "-o", file("b.h5"), "--scale", "0"}, "--scale");
  refused({write("bad.tiff", "no TIFF"), "-o", file("b.h5")}, "bad.tiff");
  refused({write("bad.jpg", "no JPEG"), "-o", file("b.h5")}, "bad.jpg");
}

// --- radiometric stills ---

void put16(std::string& out, std::size_t at, std::uint32_t v, bool big) {
  for (std::size_t i = 0; i < 2; ++i) out[at + i] = static_cast<char>(v >> (8 * (big ? 1 - i : i)));
}
void put32(std::string& out, std::size_t at, std::uint32_t v, bool big) {
  for (std::size_t i = 0; i < 4; ++i) out[at + i] = static_cast<char>(v >> (8 * (big ? 3 - i : i)));
}
void put_float(std::string& out, std::size_t at, double v) {
  const auto f = static_cast<float>(v);
  std::uint32_t bits = 0;
  std::memcpy(&bits, &f, sizeof bits);
  put32(out, at, bits, false);
}

FlirConstants constants() {
  FlirConstants c;
  c.planck_r1 = 21106.77;
  c.planck_r2 = 0.012545258;
  c.planck_b = 1501.0;
  c.planck_f = 1.0;
  c.planck_o = -7340.0;
  c.emissivity = 0.95;
  c.distance_m = 2.0;
  c.reflected_k = 295.0;
  c.atmosphere_k = 293.0;
  c.window_k = 294.0;
  c.window_transmission = 0.9;
  c.humidity = 0.5;
  return c;
}

// Record 0x20, little-endian.
std::string camera_info(const FlirConstants& c) {
  std::string out(0x480, '\0');
  put16(out, 0, 2, false);
  for (const auto& [at, value] : std::initializer_list<std::pair<std::size_t, double>>{{0x20, c.emissivity},
                                                                                       {0x24, c.distance_m},
                                                                                       {0x28, c.reflected_k},
                                                                                       {0x2c, c.atmosphere_k},
                                                                                       {0x30, c.window_k},
                                                                                       {0x34, c.window_transmission},
                                                                                       {0x3c, c.humidity},
                                                                                       {0x58, c.planck_r1},
                                                                                       {0x5c, c.planck_b},
                                                                                       {0x60, c.planck_f},
                                                                                       {0x70, c.alpha1},
                                                                                       {0x74, c.alpha2},
                                                                                       {0x78, c.beta1},
                                                                                       {0x7c, c.beta2},
                                                                                       {0x80, c.x},
                                                                                       {0x30c, c.planck_r2}}) {
    put_float(out, at, value);
  }
  put32(out, 0x308, static_cast<std::uint32_t>(static_cast<std::int32_t>(c.planck_o)), false);
  out.replace(0xd4, 11, "FLIR A655sc");
  out.replace(0x104, 8, "55001234");
  return out;
}

// Record 1, little-endian: a head of 32 bytes, then the PNG or the values.
std::string raw_data(const std::string& image) {
  std::string out(0x20, '\0');
  put16(out, 0, 2, false);
  put16(out, 2, kWidth, false);
  put16(out, 4, kHeight, false);
  return out + image;
}

// The FFF block: a big-endian head and directory, then the records.
std::string fff(const std::string& raw, const std::string& info) {
  constexpr std::size_t kHead = 0x40;
  constexpr std::size_t kEntry = 0x20;
  std::string out(kHead + 2 * kEntry, '\0');
  out.replace(0, 3, "FFF");
  put32(out, 0x14, 101, true);
  put32(out, 0x18, kHead, true);
  put32(out, 0x1c, 2, true);
  std::size_t position = out.size();
  std::size_t entry = kHead;
  for (const auto& [type, record] : {std::pair{0x01U, &raw}, {0x20U, &info}}) {
    put16(out, entry, type, true);
    put32(out, entry + 0x0c, static_cast<std::uint32_t>(position), true);
    put32(out, entry + 0x10, static_cast<std::uint32_t>(record->size()), true);
    position += record->size();
    entry += kEntry;
  }
  return out + raw + info;
}

// A JPEG of nothing but the segments: start, FLIR's APP1 in one part, end.
std::string jpeg(const std::string& block) {
  std::string out = "\xFF\xD8\xFF\xE1";
  std::string head(2, '\0');
  put16(head, 0, static_cast<std::uint32_t>(block.size() + 10), true);
  out += head;
  out += std::string("FLIR\0\x01\0\0", 8);
  return out + block + "\xFF\xD9";
}

double scene_k(std::size_t pixel) { return 290.0 + 0.05 * static_cast<double>(pixel % kWidth); }

class FlirStills : public ConvertVerb, public ::testing::WithParamInterface<const char*> {
 protected:
  void SetUp() override {
    ConvertVerb::SetUp();
    if (!output_of({"exiftool", "-ver"}, "libimage-exiftool-perl")) GTEST_SKIP() << "exiftool is not installed";
  }

  // The raw image as this kind of camera stores it.
  std::string image(const std::vector<std::uint16_t>& raw) const {
    const std::string kind = GetParam();
    if (kind == "Values") return {reinterpret_cast<const char*>(raw.data()), 2 * raw.size()};
    std::vector<std::uint16_t> stored = raw;
    if (kind == "SwappedPng") {
      for (std::uint16_t& v : stored) v = static_cast<std::uint16_t>(v << 8U | v >> 8U);
    }
    EXPECT_TRUE(write_png16(file("raw.png"), {kWidth, kHeight}, stored.data()));
    return test::contents(file("raw.png"));
  }
};

TEST_P(FlirStills, BecomeKelvin) {
  std::vector<std::uint16_t> raw(kPixels);
  for (std::size_t p = 0; p < kPixels; ++p) {
    raw[p] = static_cast<std::uint16_t>(std::lround(flir_raw(scene_k(p), constants())));
  }
  done({write("a.jpg", jpeg(fff(raw_data(image(raw)), camera_info(constants())))), "-o", file("a.h5")});
  const capture::CaptureReader reader = open("a.h5");
  EXPECT_EQ(reader.info().camera_model, "FLIR A655sc");
  EXPECT_EQ(reader.info().camera_serial, "55001234");
  EXPECT_EQ(reader.info().format.scale.unit, Unit::kKelvin);
  std::vector<float> plane(kPixels);
  ASSERT_TRUE(reader.read_frame(0, plane.data()));
  for (std::size_t p = 0; p < kPixels; ++p) ASSERT_NEAR(plane[p], scene_k(p), 0.02) << "a count is about 0.03 K";
}

INSTANTIATE_TEST_SUITE_P(Kinds, FlirStills, ::testing::Values("Png", "SwappedPng", "Values"),
                         [](const auto& kind) { return std::string(kind.param); });

// By hand: with everything transparent and black it is Planck's formula alone.
TEST(FlirKelvin, AgreesWithTheFormulaWithoutSurroundings) {
  FlirConstants c = constants();
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
  FlirConstants c = constants();
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

TEST(FlirKelvin, TellsNoTemperatureFromBelowTheScale) { EXPECT_TRUE(std::isnan(flir_kelvin(-1e6, constants()))); }

}  // namespace
}  // namespace bolo::tools
