// What `bolo deblur` refuses, and in which words.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "src/capture/pixel_maps_io.hpp"
#include "tests/tools/deblur_verb.hpp"

namespace bolo::tools::deblur_refusals_test {
namespace {

namespace fs = std::filesystem;
using namespace test;

struct Refusal {
  const char* name;
  std::vector<std::string> words;  // IN, FEW, NAN, FLOAT, DIR are replaced by paths
  const char* says;
};

class DeblurVerbRefuses : public DeblurVerb, public testing::WithParamInterface<Refusal> {};

TEST_P(DeblurVerbRefuses, InOneLineWithExitCode2AndNoOutput) {
  write_blurred(file("in.h5"), {});
  Blurred few;
  few.frames = 16;
  write_blurred(file("few.h5"), few);
  Blurred floats;
  floats.type = PixelType::kFloat32;
  floats.scale = {Unit::kKelvin, 1.0, 0.0};
  write_blurred(file("float.h5"), floats);
  Blurred broken;
  broken.events = {{100.0 + 10 * kPeriod, "nuc"},
                   {100.0 + 20 * kPeriod, "nuc"},
                   {100.0 + 35 * kPeriod, "nuc"},
                   {100.0 + 50 * kPeriod, "reconnect"}};
  write_blurred(file("broken.h5"), broken);
  Blurred slow;
  slow.period_s = 114.0;  // milliseconds taken for seconds
  write_blurred(file("slow.h5"), slow);
  std::ofstream(file("text.h5")) << "not a capture\n";
  std::ofstream(file("bad.csv")) << "# points\nx,y\n1,2\n3;4\n";
  std::ofstream(file("far.csv")) << "39.5,2\n";
  std::ofstream(file("empty.csv")) << "x,y\n# none\n";
  std::ofstream(file("lens.toml")) << "[lens]\nfocal_px = 1400\n";
  std::ofstream(file("gyro-nan.csv")) << "t_s,x_rad_s,y_rad_s,z_rad_s\n1,0,0,0\n2,nan,0,0\n";
  std::ofstream(file("gyro-few.csv")) << "1,0,0,0\n2,0,0\n";
  std::ofstream(file("gyro-many.csv")) << "1,0,0,0,0\n";
  std::ofstream(file("gyro-fast.csv")) << "1,0,0,101\n";
  std::ofstream(file("gyro-back.csv")) << "1,0,0,0\n# one\n1,0,0,0\n";
  std::ofstream(file("gyro-none.csv")) << "# none\n\nt_s,x_rad_s,y_rad_s,z_rad_s\n";
  model::PixelMaps turned;
  turned.geometry = {kHeight, kWidth};
  turned.gain.assign(turned.geometry.pixels(), 1.0F);
  ASSERT_TRUE(capture::write_pixel_maps({file("turned-maps.h5")}, turned));
  std::ofstream(file("turned.toml")) << "maps = \"turned-maps.h5\"\n";
  for (const auto& [name, value] : {std::pair{"nan.h5", std::numeric_limits<float>::quiet_NaN()}, {"huge.h5", 3e38F}}) {
    capture::CaptureInfo info;
    info.format.geometry = {3, 2};
    info.format.type = PixelType::kFloat32;
    info.format.scale = {Unit::kKelvin, 1.0, 0.0};
    auto writer = capture::CaptureWriter::create(file(name), info);
    ASSERT_TRUE(writer);
    for (std::uint64_t n = 0; n < 30; ++n) {
      std::vector<float> plane(6, 300.0F);
      if (n == 25) plane[4] = value;
      ASSERT_TRUE(writer->append(static_cast<double>(n) * kPeriod, n, plane.data()));
    }
    ASSERT_TRUE(writer->close());
  }
  std::vector<std::string> words = GetParam().words;
  for (std::string& word : words) {
    if (const auto at = word.find('@'); at != std::string::npos) word = word.substr(0, at) + file(word.substr(at + 1));
  }
  refused(words, GetParam().says);
  EXPECT_FALSE(fs::exists(file("out.h5")));
  EXPECT_FALSE(fs::exists(file("out.h5.part")));
}

INSTANTIATE_TEST_SUITE_P(
    All, DeblurVerbRefuses,
    testing::Values(
        Refusal{"NoInput", {"-o", "@out.h5"}, "no capture given"}, Refusal{"NoOutput", {"@in.h5"}, "-o OUT.h5"},
        Refusal{"TwoInputs", {"@in.h5", "@few.h5", "-o", "@out.h5"}, "need a folder"},
        Refusal{"UnknownOption", {"@in.h5", "-o", "@out.h5", "--smooth", "2"}, "smooth"},
        Refusal{"MissingFile", {"@none.h5", "-o", "@out.h5"}, "none.h5"},
        Refusal{"NotACapture", {"@text.h5", "-o", "@out.h5"}, "text.h5"},
        Refusal{"TooFewFrames", {"@few.h5", "-o", "@out.h5"}, "few.h5: 16 frames, fewer than one window of 17"},
        Refusal{"NoFullWindow", {"@broken.h5", "-o", "@out.h5"}, "broken.h5: no full window of 17 frames"},
        Refusal{"PeriodOfMinutes", {"@slow.h5", "-o", "@out.h5"}, "slow.h5: deblur settings: period_s is 114"},
        Refusal{"NotANumber", {"@nan.h5", "-o", "@out.h5"}, "nan.h5: frame 25, column 1, row 1 of /frames is nan"},
        Refusal{
            "NoTemperature", {"@huge.h5", "-o", "@out.h5"}, "huge.h5: frame 25, column 1, row 1 of /frames is 3e+38"},
        Refusal{"OutputFolderMissing", {"@in.h5", "-o", "@none/out.h5"}, "none/out.h5"},
        Refusal{"OutputIsInput", {"@in.h5", "-o", "@in.h5", "--overwrite"}, "both read and written"},
        Refusal{"UnknownSolver", {"@in.h5", "-o", "@out.h5", "--solver", "magic"}, "magic"},
        Refusal{"UnknownType", {"@in.h5", "-o", "@out.h5", "--type", "int8"}, "float32 or uint16"},
        Refusal{"FloatToUint16", {"@float.h5", "-o", "@out.h5", "--type", "uint16"}, "use --type float32"},
        Refusal{"WindowNotAPowerOfTwo", {"@in.h5", "-o", "@out.h5", "--window", "16"}, "window"},
        Refusal{"TauNegative", {"@in.h5", "-o", "@out.h5", "--tau", "-0.011"}, "tau"},
        Refusal{"LambdaWord", {"@in.h5", "-o", "@out.h5", "--lambda", "some"}, "--lambda 'some'"},
        Refusal{"UnknownIsa",
                {"@in.h5", "-o", "@out.h5", "--isa", "MMX"},
                "\"MMX\" is not available here; use one of auto"},
        Refusal{"NoPointsFile", {"@in.h5", "-o", "@out.h5", "--points", "@none.csv"}, "none.csv: cannot be opened"},
        Refusal{"PointsOfADevice",
                {"@in.h5", "-o", "@out.h5", "--points", "/dev/zero"},
                "/dev/zero: is a device, not a file"},
        Refusal{
            "PointIsNoPoint", {"@in.h5", "-o", "@out.h5", "--points", "@bad.csv"}, "bad.csv:4: '3;4' is not a point"},
        Refusal{
            "PointOutside", {"@in.h5", "-o", "@out.h5", "--points", "@far.csv"}, "far.csv:1: point 39.5,2 is outside"},
        Refusal{"NoPoints", {"@in.h5", "-o", "@out.h5", "--points", "@empty.csv"}, "empty.csv: no points"},
        Refusal{
            "RegionAndPoints", {"@in.h5", "-o", "@out.h5", "--roi", "0,0,2,2", "--points", "@far.csv"}, "one of them"},
        Refusal{
            "MapsOfAnotherSize", {"@in.h5", "-o", "@out.h5", "--profile", "@turned.toml"}, "for frames of 6x40, but"},
        Refusal{"GyroOfAnotherSolver",
                {"@in.h5", "-o", "@out.h5", "--profile", "@lens.toml", "--gyro", "@gyro-nan.csv"},
                "--gyro: a gyro is of use to the solver motion alone"},
        Refusal{"GyroWithoutALens",
                {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--gyro", "@gyro-nan.csv"},
                "needs lens.focal_px"},
        Refusal{"GyroNotANumber",
                {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--profile", "@lens.toml", "--gyro", "@gyro-nan.csv"},
                "gyro-nan.csv:3: '2,nan,0,0' is no sample"},
        Refusal{"GyroTooFewNumbers",
                {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--profile", "@lens.toml", "--gyro", "@gyro-few.csv"},
                "gyro-few.csv:2: '2,0,0' is no sample"},
        Refusal{
            "GyroTooMany",
            {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--profile", "@lens.toml", "--gyro", "@gyro-many.csv"},
            "gyro-many.csv:1: '1,0,0,0,0' is no sample"},
        Refusal{
            "GyroFasterThanAnyHand",
            {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--profile", "@lens.toml", "--gyro", "@gyro-fast.csv"},
            "gyro-fast.csv:1: '1,0,0,101' is no sample"},
        Refusal{
            "GyroTimeGoesBack",
            {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--profile", "@lens.toml", "--gyro", "@gyro-back.csv"},
            "gyro-back.csv:3: time does not rise"},
        Refusal{
            "GyroWithoutSamples",
            {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--profile", "@lens.toml", "--gyro", "@gyro-none.csv"},
            "gyro-none.csv: no samples"},
        Refusal{"GyroMissing",
                {"@in.h5", "-o", "@out.h5", "--solver", "motion", "--profile", "@lens.toml", "--gyro", "@none.csv"},
                "none.csv: cannot be opened"},
        Refusal{"NoThreads", {"@in.h5", "-o", "@out.h5", "--threads", "0"}, "workers = 0"},
        Refusal{"RegionOfThree", {"@in.h5", "-o", "@out.h5", "--roi", "1,2,3"}, "four numbers"},
        Refusal{"RegionOutside", {"@in.h5", "-o", "@out.h5", "--roi", "30,0,11,2"}, "not inside the frame of 40x6"},
        Refusal{"ProfileMissing", {"@in.h5", "-o", "@out.h5", "--profile", "@none.toml"}, "none.toml"}),
    [](const auto& suite) { return suite.param.name; });

}  // namespace
}  // namespace bolo::tools::deblur_refusals_test
