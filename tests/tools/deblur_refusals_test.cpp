// What `bolo deblur` refuses, and in which words.
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "src/capture/pixel_maps_io.hpp"
#include "tests/tools/deblur_verb.hpp"

namespace bolo::tools::deblur_refusals_test {
namespace {

using namespace test;

struct Refusal {
  std::string words;  // "@NAME": the file of that name
  const char* says;
};

const std::string kUsual = "@in.h5 -o @out.h5 ";
const std::string kGyro = kUsual + "--solver motion --profile @lens.toml --gyro @";

const std::vector<Refusal> kRefusals{
    {"-o @out.h5", "no capture given"},
    {"@in.h5", "-o OUT.h5"},
    {"@in.h5 @few.h5 -o @out.h5", "need a folder"},
    {kUsual + "--smooth 2", "smooth"},
    {"@none.h5 -o @out.h5", "none.h5"},
    {"@text.h5 -o @out.h5", "text.h5"},
    {"@few.h5 -o @out.h5", "few.h5: 16 frames, fewer than one window of 17"},
    {"@broken.h5 -o @out.h5", "broken.h5: no full window of 17 frames"},
    {"@slow.h5 -o @out.h5", "slow.h5: deblur settings: period_s is 114"},
    {"@nan.h5 -o @out.h5", "nan.h5: frame 25, column 1, row 1 of /frames is nan"},
    {"@huge.h5 -o @out.h5", "huge.h5: frame 25, column 1, row 1 of /frames is 3e+38"},
    {"@in.h5 -o @none/out.h5", "none/out.h5"},
    {"@in.h5 -o @in.h5 --overwrite", "both read and written"},
    {kUsual + "--solver magic", "magic"},
    {kUsual + "--type int8", "float32 or uint16"},
    {"@float.h5 -o @out.h5 --type uint16", "use --type float32"},
    {kUsual + "--window 16", "window"},
    {kUsual + "--tau -0.011", "tau"},
    {kUsual + "--lambda some", "--lambda 'some'"},
    {kUsual + "--isa MMX", "\"MMX\" is not available here; use one of auto"},
    {kUsual + "--points @none.csv", "none.csv: cannot be opened"},
    {kUsual + "--points /dev/zero", "/dev/zero: is a device, not a file"},
    {kUsual + "--points @bad.csv", "bad.csv:4: '3;4' is not a point"},
    {kUsual + "--points @far.csv", "far.csv:1: point 39.5,2 is outside"},
    {kUsual + "--points @empty.csv", "empty.csv: no points"},
    {kUsual + "--roi 0,0,2,2 --points @far.csv", "one of them"},
    {kUsual + "--profile @turned.toml", "for frames of 6x40, but"},
    {kUsual + "--profile @lens.toml --gyro @gyro-nan.csv", "--gyro: a gyro is of use to the solver motion alone"},
    {kUsual + "--solver motion --gyro @gyro-nan.csv", "needs lens.focal_px"},
    {kGyro + "gyro-nan.csv", "gyro-nan.csv:3: '2,nan,0,0' is no sample"},
    {kGyro + "gyro-few.csv", "gyro-few.csv:2: '2,0,0' is no sample"},
    {kGyro + "gyro-many.csv", "gyro-many.csv:1: '1,0,0,0,0' is no sample"},
    {kGyro + "gyro-fast.csv", "gyro-fast.csv:1: '1,0,0,101' is no sample"},
    {kGyro + "gyro-back.csv", "gyro-back.csv:3: time does not rise"},
    {kGyro + "gyro-none.csv", "gyro-none.csv: no samples"},
    {kGyro + "none.csv", "none.csv: cannot be opened"},
    {kUsual + "--threads 0", "workers = 0"},
    {kUsual + "--roi 1,2,3", "four numbers"},
    {kUsual + "--roi 30,0,11,2", "not inside the frame of 40x6"},
    {kUsual + "--profile @none.toml", "none.toml"}};

TEST_F(DeblurVerb, RefusesInOneLineWithExitCode2AndNoOutput) {
  write_blurred(file("in.h5"), {});
  write_blurred(file("few.h5"), {.frames = 16});
  write_blurred(file("float.h5"), {.type = PixelType::kFloat32, .scale = {Unit::kKelvin, 1.0, 0.0}});
  write_blurred(file("broken.h5"), {.events = {{100.0 + 10 * kPeriod, "nuc"},
                                               {100.0 + 20 * kPeriod, "nuc"},
                                               {100.0 + 35 * kPeriod, "nuc"},
                                               {100.0 + 50 * kPeriod, "reconnect"}}});
  write_blurred(file("slow.h5"), {.period_s = 114.0});  // milliseconds taken for seconds
  write_with_one(file("nan.h5"), 30, 25, std::numeric_limits<float>::quiet_NaN());
  write_with_one(file("huge.h5"), 30, 25, 3e38F);
  write("text.h5", "not a capture\n");
  write("bad.csv", "# points\nx,y\n1,2\n3;4\n");
  write("far.csv", "39.5,2\n");
  write("empty.csv", "x,y\n# none\n");
  write("lens.toml", "[lens]\nfocal_px = 1400\n");
  write("gyro-nan.csv", "t_s,x_rad_s,y_rad_s,z_rad_s\n1,0,0,0\n2,nan,0,0\n");
  write("gyro-few.csv", "1,0,0,0\n2,0,0\n");
  write("gyro-many.csv", "1,0,0,0,0\n");
  write("gyro-fast.csv", "1,0,0,101\n");
  write("gyro-back.csv", "1,0,0,0\n# one\n1,0,0,0\n");
  write("gyro-none.csv", "# none\n\nt_s,x_rad_s,y_rad_s,z_rad_s\n");
  model::PixelMaps turned;
  turned.geometry = {kHeight, kWidth};
  turned.gain.assign(turned.geometry.pixels(), 1.0F);
  ASSERT_TRUE(capture::write_pixel_maps({file("turned-maps.h5")}, turned));
  write("turned.toml", "maps = \"turned-maps.h5\"\n");
  for (const Refusal& refusal : kRefusals) {
    SCOPED_TRACE(refusal.words);
    std::vector<std::string> words;
    std::istringstream all(refusal.words);
    for (std::string word; all >> word;) words.push_back(word.starts_with('@') ? file(word.substr(1)) : word);
    refused(words, refusal.says);
    EXPECT_FALSE(fs::exists(file("out.h5")));
    EXPECT_FALSE(fs::exists(file("out.h5.part")));
  }
}

}  // namespace
}  // namespace bolo::tools::deblur_refusals_test
