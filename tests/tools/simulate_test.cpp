// bolo simulate through its executable.
#include <chrono>
#include <cmath>
#include <filesystem>
#include <thread>

#include <nlohmann/json.hpp>

#include "tests/sim/support.hpp"
#include "tests/tools/program.hpp"

namespace bolo::sim {
namespace {

using testing::Scratch;
using tools::test::Outcome;
using tools::test::Program;

// What it prints anywhere is in `out`.
Outcome run_bolo(const std::string& arguments) {
  const Scratch scratch;
  return Program({"/bin/sh", "-c", BOLO_PROGRAM " simulate " + arguments + " 2>&1"}, scratch / "log").outcome();
}

// A small capture, written and opened again.
Result<capture::CaptureReader> simulated(const Scratch& scratch, const std::string& arguments) {
  const auto file = scratch / "a.h5";
  const Outcome outcome = run_bolo("-o '" + file.string() + "' --overwrite --width 32 --height 12 " + arguments);
  EXPECT_EQ(outcome.exit_code, 0) << outcome.out;
  return capture::CaptureReader::open(file);
}

TEST(SimulateVerb, TheDefaultsAreThoseOfTheA655sc) {
  const Scratch scratch;
  const auto file = scratch / "a.h5";
  const Outcome outcome = run_bolo("-o '" + file.string() + "' --frames 3");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.out;
  EXPECT_EQ(outcome.out.substr(0, outcome.out.find(',')), file.string() + ": 3 frames of 640x120");
  const auto reader = capture::CaptureReader::open(file);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->info().format.geometry, (Geometry{640, 120}));
  EXPECT_EQ(reader->info().format.frame_period_s, 0.005);
  EXPECT_EQ(reader->info().format.type, PixelType::kUint16);
  EXPECT_TRUE(reader->info().has_truth);
  const auto stimulus = reader->stimulus();
  ASSERT_TRUE(stimulus);
  const auto& scene = std::get<capture::SceneStimulus>(*stimulus);
  EXPECT_NEAR(std::abs((scene.x_px.back() - scene.x_px.front()) / (scene.t_s.back() - scene.t_s.front())), 300.0, 1e-6);
}

TEST(SimulateVerb, KeepsItsFramesWhenItsTerminalIsClosed) {
  const Scratch scratch;
  const std::string file = (scratch / "a.h5").string();
  Program program({BOLO_PROGRAM, "simulate", "-o", file, "--width", "32", "--height", "12", "--stimulus", "uniform",
                   "--frames", "1000000"},
                  scratch / "log");
  for (int i = 0; i < 3000 && !std::filesystem::exists(file + ".part"); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(200));  // some frames
  program.signal(SIGHUP);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
  EXPECT_NE(outcome.err.find("the capture holds the frames until then"), std::string::npos) << outcome.err;
  EXPECT_FALSE(std::filesystem::exists(file + ".part"));
  EXPECT_TRUE(capture::CaptureReader::open(file));
}

TEST(SimulateVerb, EveryStimulusIsWrittenAsWhatItIs) {
  const Scratch scratch;
  const auto stimulus = [&scratch](const std::string& arguments) {
    const auto reader = simulated(scratch, arguments);
    EXPECT_TRUE(reader) << reader.error().message;
    return reader->stimulus().value();
  };
  EXPECT_EQ(std::get<capture::Uniform>(stimulus("--stimulus uniform --temperature 310 --frames 4")).temperature_k, 310);
  const auto bars = std::get<capture::BarTarget>(stimulus("--scene bars --period 20 --speed -50 --frames 4"));
  EXPECT_EQ(bars.period_px, 20.0);
  EXPECT_EQ(bars.velocity_px_s, -50.0);
  const auto chopper = std::get<capture::Chopper>(stimulus("--stimulus chopper"));
  ASSERT_GE(chopper.on_s.size(), 10U);  // five lengths at two heights
  EXPECT_NEAR(chopper.off_s.front() - chopper.on_s.front(), 0.012, 1e-12);
  EXPECT_LT(chopper.off_s.back(), 2.0);
  EXPECT_EQ(chopper.level_k[9], 320.0);
  EXPECT_TRUE(std::holds_alternative<capture::SceneStimulus>(stimulus("--stimulus scene --frames 4")));
}

TEST(SimulateVerb, FollowsATrajectoryOverAPicture) {
  const Scratch scratch;
  const auto csv = scratch.text("t.csv", "t_s,x_px,y_px\n0,0,0\n0.05,4,2\n0.1,9,1\n");
  const auto reader =
      simulated(scratch, "--frames 10 --trajectory '" + csv.string() + "' --trajectory-scale 2 --origin 7,3");
  ASSERT_TRUE(reader) << reader.error().message;
  const auto scene = std::get<capture::SceneStimulus>(reader->stimulus().value());
  std::size_t begin = 0;
  while (scene.t_s[begin] < 0.0) ++begin;
  std::size_t middle = begin;
  while (scene.t_s[middle] < 0.04) ++middle;
  EXPECT_GT(scene.x_px[middle] - scene.x_px[begin], 4.0);
  EXPECT_GT(scene.y_px[middle] - scene.y_px[begin], 2.0);
}

TEST(SimulateVerb, FloatFramesWithoutNoiseAndTruth) {
  const Scratch scratch;
  const auto reader =
      simulated(scratch,
                "--stimulus uniform --temperature 299.987 --type float32 --noise 0 --no-truth --compress "
                "--frames 2 --rate 50 --camera visible --exposure 0.02");
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_FALSE(reader->info().has_truth);
  EXPECT_EQ(reader->t()[1], 0.02);
  std::vector<float> plane(32 * 12);
  ASSERT_TRUE(reader->read_frame(1, plane.data()));
  for (const float k : plane) EXPECT_NEAR(k, 299.987F, 1e-4F);
}

TEST(SimulateVerb, JsonSaysWhatWasWritten) {
  const Scratch scratch;
  const auto file = scratch / "a.h5";
  const Outcome outcome = run_bolo("-o '" + file.string() + "' --width 8 --height 4 --frames 20 --json");
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_NE(outcome.out.find("\"frames\":20"), std::string::npos) << outcome.out;
  EXPECT_NE(outcome.out.find("\"seconds\":0.1"), std::string::npos) << outcome.out;
}

class Refused : public ::testing::TestWithParam<const char*> {};

TEST_P(Refused, InOneLineWithExitCodeTwo) {
  const Scratch scratch;
  const auto file = scratch / "a.h5";
  const Outcome outcome = run_bolo("-o '" + file.string() + "' --width 32 --height 12 " + GetParam());
  EXPECT_EQ(outcome.exit_code, 2) << outcome.out;
  EXPECT_EQ(outcome.out.find("bolo simulate: "), 0U) << outcome.out;
  EXPECT_EQ(outcome.out.find('\n'), outcome.out.size() - 1) << outcome.out;
  EXPECT_FALSE(std::filesystem::exists(file));
  EXPECT_FALSE(std::filesystem::exists(file.string() + ".part"));
}

INSTANTIATE_TEST_SUITE_P(
    Usage, Refused,
    ::testing::Values(
        "--stimulus nothing", "--stimulus scene --scene bars", "--stimulus bar_target --scene street",
        "--stimulus uniform --speed 10", "--stimulus chopper --scene street", "--stimulus chopper --frames 3",
        "--stimulus chopper --pulses 0", "--scene street --hot 320", "--scene bars --cold 320", "--temperature 300",
        "--scene /nonexistent.png", "--frames 0", "--frames x", "--rate 0", "--tau 0", "--noise -1", "--quantisation 0",
        "--quantisation 0.001", "--type uint8", "--camera infrared", "--camera visible --tau 0.01",
        "--camera visible --exposure 1", "--exposure 0.001", "--threads 0", "--speed 1e9", "--effect nothing",
        "--effect iir:alpha=9", "--effect iir --effect iir:alpha=0.7", "--effect iir --camera visible", "--effect",
        "--session-start -1", "--camera-seed x", "--stimulus chopper --stimulus-error sweep=1",
        "--stimulus uniform --stimulus-error sweep_s=0.001", "--stimulus chopper --stimulus-error sweep_s=9",
        "--trajectory /nonexistent.csv", "--trajectory-scale 2", "--origin 1", "--unknown", "stray"));

std::vector<std::uint16_t> last_frame(const capture::CaptureReader& reader) {
  std::vector<std::uint16_t> plane(reader.info().format.geometry.pixels());
  EXPECT_TRUE(reader.read_frame(reader.t().size() - 1, plane.data()));
  return plane;
}

// A blind check reads these files: nothing but the frames may differ.
TEST(SimulateVerb, TheFileDoesNotSayWhichEffectsThereWere) {
  const Scratch scratch;
  const std::string bench = "--stimulus chopper --frames 60 --no-truth --camera-seed 9 ";
  const auto plain = simulated(scratch, bench);
  ASSERT_TRUE(plain) << plain.error().message;
  const Scratch other;
  const auto hidden = simulated(other, bench +
                                           "--effect iir:alpha=0.6,form=box --effect fpn_offset "
                                           "--session-start 40 --stimulus-error sweep_s=0.002,level_k=0.5");
  ASSERT_TRUE(hidden) << hidden.error().message;
  EXPECT_NE(last_frame(*hidden), last_frame(*plain));
  EXPECT_EQ(hidden->t(), plain->t());
  EXPECT_EQ(hidden->frame_id(), plain->frame_id());
  EXPECT_EQ(hidden->info().camera_model, plain->info().camera_model);
  EXPECT_EQ(hidden->info().camera_serial, plain->info().camera_serial);
  const auto a = plain->attributes().value();
  const auto b = hidden->attributes().value();
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].name, b[i].name);
    EXPECT_EQ(a[i].value, b[i].value) << a[i].name;
  }
  const auto nominal = std::get<capture::Chopper>(plain->stimulus().value());
  const auto stated = std::get<capture::Chopper>(hidden->stimulus().value());
  EXPECT_EQ(stated.on_s, nominal.on_s);
  EXPECT_EQ(stated.level_k, nominal.level_k);
  EXPECT_EQ(stated.cold_k, nominal.cold_k);
}

TEST(SimulateVerb, ListsTheEffects) {
  const Outcome table = run_bolo("--list-effects");
  EXPECT_EQ(table.exit_code, 0);
  EXPECT_NE(table.out.find("row_delay_s=2.8e-05 s (-0.0001 to 0.0001)"), std::string::npos) << table.out;
  const Outcome json = run_bolo("--list-effects --json");
  const auto effects = nlohmann::json::parse(json.out);
  ASSERT_EQ(effects.size(), sim::effect_descriptions().size());
  for (const auto& effect : effects) {
    EXPECT_NE(sim::find_effect(effect.at("name").get<std::string>()), nullptr);
    for (const char* key : {"stage", "about", "in_catalogue", "parameters", "forms"}) EXPECT_TRUE(effect.contains(key));
  }
}

TEST(SimulateVerb, NeedsAnOutputThatIsNotAnInput) {
  const Scratch scratch;
  EXPECT_EQ(run_bolo("").exit_code, 2);
  const auto csv = scratch.text("t.csv", "t_s,x_px,y_px\n0,0,0\n9,4,2\n");
  const auto size = std::filesystem::file_size(csv);
  const Outcome outcome = run_bolo("-o '" + csv.string() + "' --frames 2 --trajectory '" + csv.string() + "'");
  EXPECT_EQ(outcome.exit_code, 2) << outcome.out;
  EXPECT_EQ(std::filesystem::file_size(csv), size);
  const Outcome overwritten =
      run_bolo("-o '" + csv.string() + "' --overwrite --frames 2 --trajectory '" + csv.string() + "'");
  EXPECT_EQ(overwritten.exit_code, 2) << overwritten.out;
  EXPECT_EQ(std::filesystem::file_size(csv), size);
}

}  // namespace
}  // namespace bolo::sim
