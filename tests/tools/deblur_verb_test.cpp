// `bolo deblur` as its user meets it: the program itself, its files, messages and exit codes.
#include "tests/tools/deblur_verb.hpp"
#include "src/capture/pixel_maps_io.hpp"

namespace bolo::tools::deblur_verb_test {

namespace fs = std::filesystem;
using namespace test;

constexpr std::size_t kWindow = 17;

TEST_F(DeblurVerb, WritesASharpFrameForEachFrameWithAFullWindow) {
  const auto out = deblurred();
  EXPECT_EQ(out.info().frames, 60U - (kWindow - 1));
  EXPECT_EQ(out.info().format.type, PixelType::kFloat32);
  EXPECT_EQ(out.info().format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(out.info().format.scale, (LinearScale{Unit::kKelvin, 1.0, 0.0}));
  EXPECT_DOUBLE_EQ(out.info().format.frame_period_s, kPeriod);
  EXPECT_EQ(out.info().camera_model, "a camera");
  const auto in = must(capture::CaptureReader::open(file("in.h5")));
  for (std::size_t i = 0; i < out.info().frames; ++i) {
    EXPECT_EQ(out.t()[i], in->t()[i + kWindow - 1]);
    EXPECT_EQ(out.frame_id()[i], in->frame_id()[i + kWindow - 1]);
  }
  const auto json = report();
  EXPECT_EQ(json["frames_in"], 60);
  EXPECT_EQ(json["frames_out"], 44);
  EXPECT_EQ(json["lost"], 0);
  EXPECT_GT(json["ms_per_frame"].get<double>(), 0.0);
  EXPECT_EQ(json["settings"]["solver"], "admm");
  EXPECT_DOUBLE_EQ(json["settings"]["tau_s"].get<double>(), kTau);
  EXPECT_LT(rmse("deblurred_k"), 0.1 * rmse("blurred_k"));
}

// A camera that is read faster than it takes pictures: only its distinct frames count.
TEST_F(DeblurVerb, FramesThatRepeatAreDroppedAsIfTheyHadNeverBeenRead) {
  write("drop.toml", "[firmware]\ndrop_repeated = true\n");
  const auto once = deblurred("--profile @drop.toml");
  for (const std::size_t reads : {2U, 7U}) {
    write_blurred(file("in.h5"), {.reads = reads});
    const auto out = deblurred("--profile @drop.toml", std::to_string(reads) + ".h5");
    EXPECT_NEAR(out.info().format.frame_period_s, kPeriod, 1e-9);
    ASSERT_EQ(out.info().frames, once.info().frames);
    for (std::size_t n = 0; n < once.info().frames; ++n) {
      const auto want = frame_of(once, n);
      const auto got = frame_of(out, n);
      for (std::size_t i = 0; i < want.size(); ++i) ASSERT_NEAR(got[i], want[i], 1e-3) << n;
    }
  }
}

// A gyro with foreign times changes no bit; one with the frames' times is used, and reported.
TEST_F(DeblurVerb, AGyroIsOnTheCapturesClock) {
  write_blurred(file("in.h5"), {.height = kWidth});
  write("lens.toml", "[lens]\nfocal_px = 1400\n");
  const std::string motion = "--solver motion --profile @lens.toml";
  const auto with_gyro_from = [&](double begin_s, const std::string& name) {
    std::ofstream samples(file("gyro.csv"));
    for (int i = 0; i < 400; ++i) samples << begin_s + 0.001 * i << ",0.01,0.02,0\n";
    samples.close();
    return deblurred(motion + " --gyro @gyro.csv", name);
  };
  const auto alone = deblurred(motion, "alone.h5");
  EXPECT_FALSE(report().contains("gyro"));
  const auto silent = with_gyro_from(200.0, "silent.h5");
  EXPECT_EQ(report()["gyro"]["used"], 0);
  EXPECT_GT(report()["gyro"]["silent"], 30);
  expect_same_frames(alone, silent);
  (void)with_gyro_from(99.95, "told.h5");
  const auto gyro = report()["gyro"];
  EXPECT_EQ(gyro["silent"], 0);
  EXPECT_GT(gyro["used"].get<int>() + gyro["ignored"].get<int>(), 30);  // the bar jumps, which no even turn explains
}

TEST_F(DeblurVerb, TheRmseIsThatOfTheFilesAndTheTruthIsCopied) {
  const auto out = deblurred("--lambda 0.05");
  ASSERT_TRUE(out.info().has_truth);
  const auto in = capture::CaptureReader::open(file("in.h5"));
  double blurred = 0.0;
  double sharp = 0.0;
  std::vector<float> truth(static_cast<std::size_t>(kWidth * kHeight));
  std::vector<float> input_truth(truth.size());
  for (std::size_t n = 0; n < out.info().frames; ++n) {
    ASSERT_TRUE(out.read_truth(n, truth.data()));
    ASSERT_TRUE(in->read_truth(n + kWindow - 1, input_truth.data()));
    ASSERT_EQ(truth, input_truth);
    const auto counts = frame_of(*in, n + kWindow - 1);
    const auto kelvin = frame_of(out, n);
    for (std::size_t i = 0; i < truth.size(); ++i) {
      blurred += std::pow(0.01 * static_cast<double>(counts[i]) - static_cast<double>(truth[i]), 2);
      sharp += std::pow(static_cast<double>(kelvin[i]) - static_cast<double>(truth[i]), 2);
    }
  }
  const double values = static_cast<double>(out.info().frames * truth.size());
  EXPECT_NEAR(rmse("blurred_k"), std::sqrt(blurred / values), 1e-9);
  EXPECT_NEAR(rmse("deblurred_k"), std::sqrt(sharp / values), 1e-9);
}

TEST_F(DeblurVerb, SettingsStandInTheOutput) {
  const auto out =
      deblurred("--solver exact --kappa 0.2 --lambda 0.01 --window 9 --levels 5 --lookahead 2 --tau 0.012");
  EXPECT_EQ(attribute<std::string>(out, "solver"), "exact");
  EXPECT_TRUE(attribute<std::string>(out, "isa"));
  for (const auto& [name, value] : {std::pair{"tau_s", 0.012},
                                    {"kappa", 0.2},
                                    {"lambda", 0.01},
                                    {"window", 9.0},
                                    {"levels", 5.0},
                                    {"lookahead", 2.0},
                                    {"iterations", 0.0}}) {
    EXPECT_EQ(attribute<double>(out, name), value) << name;
  }
  EXPECT_EQ(attribute<double>(deblurred("--iterations 23"), "iterations"), 23.0);
  EXPECT_GT(attribute<double>(deblurred(), "iterations").value_or(0.0), 0.0);
  write("p.toml", "tau_s = 0.009\n");
  EXPECT_EQ(attribute<double>(deblurred("--profile @p.toml"), "tau_s"), 0.009);
  EXPECT_EQ(attribute<double>(deblurred("--profile @p.toml --tau 0.013"), "tau_s"), 0.013);
}

TEST_F(DeblurVerb, ThreadsChangeNoBit) {
  expect_same_frames(deblurred("--threads 1", "one.h5"), deblurred("--threads 4", "four.h5"));
}

TEST_F(DeblurVerb, LambdaMayBeAutomaticAndNoiseGiven) {
  (void)deblurred("--lambda auto --noise 0.05");
  EXPECT_EQ(report()["settings"]["auto_lambda"], true);
  EXPECT_EQ(report()["settings"]["noise_k"], 0.05);
  EXPECT_LT(rmse("deblurred_k"), 0.5 * rmse("blurred_k"));
}

TEST_F(DeblurVerb, AnInstructionSetCanBeChosen) {
  const Outcome refused = run(words("@in.h5 -o @out.h5 --isa none"));
  ASSERT_EQ(refused.exit_code, 2);
  std::string slowest = refused.err.substr(refused.err.rfind(' ') + 1);  // the last of those it offers
  slowest.pop_back();                                                    // the line's end
  (void)deblurred("--isa " + slowest);
  EXPECT_EQ(report()["settings"]["isa"], slowest);
}

TEST_F(DeblurVerb, Uint16OutputKeepsTheInputsScale) {
  const LinearScale scale{Unit::kKelvin, 0.01, 100.0};
  write_blurred(file("in.h5"), {.scale = scale});
  const auto counts = deblurred("--type uint16", "counts.h5");
  const auto kelvin = deblurred("", "kelvin.h5");
  EXPECT_EQ(counts.info().format.type, PixelType::kUint16);
  EXPECT_EQ(counts.info().format.scale, scale);
  for (std::size_t n = 0; n < counts.info().frames; n += 7) {
    const auto c = frame_of(counts, n);
    const auto k = frame_of(kelvin, n);
    for (std::size_t i = 0; i < c.size(); ++i) ASSERT_NEAR(100.0F + 0.01F * c[i], k[i], 0.0051F);
  }
}

TEST_F(DeblurVerb, ACaptureInCountsStaysInCountsAndIsNotJudged) {
  write_blurred(file("in.h5"), {.scale = {Unit::kCount, 1.0, 0.0}});
  const auto out = deblurred("--lambda 0.2");
  EXPECT_EQ(out.info().format.scale.unit, Unit::kCount);
  EXPECT_EQ(out.info().format.type, PixelType::kFloat32);
  for (const float value : frame_of(out, 40)) ASSERT_TRUE(value > 29'000.0F && value < 31'200.0F) << value;
  EXPECT_TRUE(report()["rmse"].is_null());
}

TEST_F(DeblurVerb, FloatCapturesAreTaken) {
  write_blurred(file("in.h5"), {.type = PixelType::kFloat32, .scale = {Unit::kKelvin, 1.0, 0.0}});
  (void)deblurred();
  EXPECT_LT(rmse("deblurred_k"), 0.1 * rmse("blurred_k"));
}

TEST_F(DeblurVerb, ALostFrameIsAGapAndEventsStartAgain) {
  write_blurred(
      file("in.h5"),
      {.frames = 80, .lost = {20}, .events = {{100.0 + 40 * kPeriod, "nuc"}}, .stimulus = capture::Uniform{300.0}});
  const auto out = deblurred();
  EXPECT_EQ(report()["lost"], 1);
  std::vector<std::uint64_t> expected;
  for (std::uint64_t n = kWindow - 1; n < 80; ++n) {
    if (n != 20 && (n < 40 || n >= 40 + kWindow - 1)) expected.push_back(500 + n);
  }
  EXPECT_EQ(out.frame_id(), expected);
  ASSERT_EQ(out.events().size(), 1U);
  EXPECT_EQ(out.events()[0].kind, "nuc");
  const auto stimulus = must(out.stimulus());
  EXPECT_EQ(std::get<capture::Uniform>(*stimulus).temperature_k, 300.0);
}

TEST_F(DeblurVerb, LookaheadLeavesOutFramesAtBothEnds) {
  const auto out = deblurred("--lookahead 2");
  ASSERT_EQ(out.info().frames, 60U - (kWindow - 1));
  EXPECT_EQ(out.frame_id().front(), 500U + kWindow - 1 - 2);
  EXPECT_EQ(out.frame_id().back(), 500U + 59 - 2);
}

TEST_F(DeblurVerb, WithoutJsonItSaysTheSameInALine) {
  write_blurred(file("in.h5"), {.truth = false});
  const Outcome outcome = run(words("@in.h5 -o @out.h5 --lambda auto"));
  expect_parts(outcome.out, {"44 of 60 frames", "lambda auto"});
  EXPECT_EQ(outcome.out.find("truth"), std::string::npos) << outcome.out;
  EXPECT_EQ(outcome.err, "");
}

TEST_F(DeblurVerb, AnInterruptionKeepsWhatWasSolved) {
  write_blurred(file("in.h5"), {.frames = 100, .width = 64, .height = 48});
  {
    Program program = start(words("@in.h5 -o @out.h5 --solver exact --threads 1"));
    std::error_code none;
    while (fs::file_size(file("out.h5.part"), none) < 20 * 64 * 48 * sizeof(float) || none) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    program.signal(SIGINT);
    const Outcome outcome = program.outcome();
    EXPECT_EQ(outcome.exit_code, 1);
    expect_parts(outcome.err, {"frames are kept in " + file("out.h5.part") + ", which bolo recover finishes"});
  }
  EXPECT_FALSE(fs::exists(file("out.h5")));
  EXPECT_EQ(Program({BOLO_PROGRAM, "recover", file("out.h5.part")}, file("log")).wait(), 0);
  const auto kept = must(capture::CaptureReader::open(file("out.h5")));
  const auto whole = deblurred("--solver exact --threads 1", "whole.h5");
  ASSERT_GE(kept->info().frames, 4U);
  ASSERT_LT(kept->info().frames, whole.info().frames);
  for (std::size_t i = 0; i < kept->info().frames; ++i) ASSERT_EQ(frame_of(*kept, i), frame_of(whole, i)) << i;
  EXPECT_EQ(kept->frame_id().front(), whole.frame_id().front());
  EXPECT_EQ(attribute<std::string>(*kept, "solver"), "exact");
}

TEST_F(DeblurVerb, AnOutputThatIsMadeMeanwhileCostsNothing) {
  write_blurred(file("in.h5"), {.frames = 60, .width = 64, .height = 48});
  Program program = start(words("@in.h5 -o @out.h5 --solver exact --threads 1"));
  while (!fs::exists(file("out.h5.part"))) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  write("out.h5", "of another program");
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 1);
  expect_parts(outcome.err, {"stays; what was written is whole in " + file("out.h5.part")});
  EXPECT_EQ(fs::file_size(file("out.h5")), 18U);
  EXPECT_EQ(must(capture::CaptureReader::open(file("out.h5.part")))->info().frames, 44U);
}

// One frame takes this solver seconds, and 64 are queued: neither delays the end.
TEST_F(DeblurVerb, AnInterruptionIsHeardInTheMiddleOfAFrame) {
  write_blurred(file("in.h5"), {.truth = false, .frames = 100, .width = 1024, .height = 768});
  Program program = start(words("@in.h5 -o @out.h5 --solver exact --levels 7 --lambda 0.001 --threads 1"));
  while (!fs::exists(file("out.h5.part"))) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  std::this_thread::sleep_for(std::chrono::seconds(1));
  const auto signalled = std::chrono::steady_clock::now();
  program.signal(SIGTERM);
  EXPECT_EQ(program.outcome().exit_code, 1);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - signalled;
  std::printf("it ended after %.3f s\n", took.count());
  EXPECT_LT(took.count(), 5.0) << "1 s is promised; a busy machine takes longer, all frames far longer";
}

// --- What `bolo deblur` refuses, and in which words.

struct Refusal {
  std::string words;  // "@NAME": the file of that name
  const char* message;
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
    {"@slow.h5 -o @out.h5", "to 10 s; if it is milliseconds, divide /t and frame_period_s by 1000"},
    {"@nan.h5 -o @out.h5", "nan.h5: frame 525, column 1, row 1 of /frames is nan"},
    {"@huge.h5 -o @out.h5", "huge.h5: frame 525, column 1, row 1 of /frames is 3e+38"},
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
    {kUsual + "--points @long.csv",
     "long.csv:1: '111111111111111111111111111111111111111111111111111111111111' is not a point"},
    {kUsual + "--points @far.csv", "far.csv:1: point 39.5,2 is outside"},
    {kUsual + "--points @many.csv", "many.csv: more points than"},
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
    {kUsual + "--threads 0", "--threads 0"},
    {kUsual + "--roi 1,2,3", "four numbers"},
    {kUsual + "--roi 30,0,11,2", "not inside the frame of 40x6"},
    {kUsual + "--profile @none.toml", "none.toml"}};

TEST_F(DeblurVerb, RefusesInOneLineWithExitCode2AndNoOutput) {
  write_blurred(file("few.h5"), {.frames = 16});
  Blurred floats{.type = PixelType::kFloat32, .scale = {Unit::kKelvin, 1.0, 0.0}};
  write_blurred(file("float.h5"), floats);
  write_blurred(file("broken.h5"), {.events = {{100.0 + 10 * kPeriod, "nuc"},
                                               {100.0 + 20 * kPeriod, "nuc"},
                                               {100.0 + 35 * kPeriod, "nuc"},
                                               {100.0 + 50 * kPeriod, "reconnect"}}});
  write_blurred(file("slow.h5"), {.period_s = 114.0});  // milliseconds taken for seconds
  floats.odd = {25, std::numeric_limits<float>::quiet_NaN()};
  write_blurred(file("nan.h5"), floats);
  floats.odd = {25, 3e38F};
  write_blurred(file("huge.h5"), floats);
  write("text.h5", "not a capture\n");
  write("bad.csv", "# points\nx,y\n1,2\n3;4\n");
  write("far.csv", "39.5,2\n");
  write("long.csv", std::string(100'000, '1') + "\n");
  std::string many;
  for (int i = 0; i <= kWidth * kHeight; ++i) many += "1,1\n";
  many += "what follows is not read\n";
  write("many.csv", many);
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
    refused(words(refusal.words), refusal.message);
    EXPECT_FALSE(fs::exists(file("out.h5")));
    EXPECT_FALSE(fs::exists(file("out.h5.part")));
  }
}

}  // namespace bolo::tools::deblur_verb_test
