// bolo simulate through its executable.
#include <sys/resource.h>

#include <nlohmann/json.hpp>

#include "src/sim/effect.hpp"
#include "tests/capture/frame_values.hpp"
#include "tests/tools/program.hpp"

namespace bolo::sim::simulate_test {

using tools::test::Outcome;
using tools::test::Program;

class SimulateVerb : public tools::test::ProgramTest {
 protected:
  SimulateVerb() : ProgramTest({BOLO_PROGRAM, "simulate"}) {}

  // A small capture, written and opened again.
  Result<capture::CaptureReader> simulated(const std::string& line, const std::string& name = "a.h5") const {
    done(words("-o @" + name + " --overwrite --width 32 --height 12 " + line));
    return capture::CaptureReader::open(file(name));
  }
};

TEST_F(SimulateVerb, TheDefaultsAreThoseOfTheA655sc) {
  const std::string out = printed(words("-o @a.h5 --frames 3"));
  EXPECT_EQ(out.substr(0, out.find(',')), file("a.h5") + ": 3 frames of 640x120");
  const auto reader = must(capture::CaptureReader::open(file("a.h5")));
  EXPECT_EQ(reader->info().format.geometry, (Geometry{640, 120}));
  EXPECT_EQ(reader->info().format.frame_period_s, 0.005);
  EXPECT_EQ(reader->info().format.type, PixelType::kUint16);
  EXPECT_TRUE(reader->info().has_truth);
  const auto stimulus = must(reader->stimulus());
  const auto& scene = std::get<capture::SceneStimulus>(*stimulus);
  EXPECT_NEAR(std::abs((scene.x_px.back() - scene.x_px.front()) / (scene.t_s.back() - scene.t_s.front())), 300.0, 1e-6);
}

TEST_F(SimulateVerb, KeepsItsFramesAndWhatWasThereWhenItsTerminalIsClosed) {
  ASSERT_TRUE(simulated("--frames 3"));
  Program program = start(words("-o @a.h5 --overwrite --width 32 --height 12 --stimulus uniform --frames 1000000"));
  ASSERT_TRUE(eventually([&] { return std::filesystem::exists(file("a.h5.part")); }));
  std::this_thread::sleep_for(std::chrono::milliseconds(200));  // some frames
  program.signal(SIGHUP);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
  expect_parts(outcome.err, {"frames are kept in " + file("a.h5.part") + ", which bolo recover finishes"});
  EXPECT_EQ(must(capture::CaptureReader::open(file("a.h5")))->info().frames, 3U);
  const auto kept = must(capture::CaptureReader::open(file("a.h5.part")));
  EXPECT_GT(kept->info().frames, 3U);
  EXPECT_TRUE(kept->warnings().empty());
}

TEST_F(SimulateVerb, EveryStimulusIsWrittenAsWhatItIs) {
  const auto stimulus = [this](const std::string& line) { return must(simulated(line))->stimulus().value(); };
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

TEST_F(SimulateVerb, FollowsATrajectoryOverAPicture) {
  write("t.csv", "t_s,x_px,y_px\n0,0,0\n0.05,4,2\n0.1,9,1\n");
  const auto reader = must(simulated("--frames 10 --trajectory @t.csv --trajectory-scale 2 --origin 7,3"));
  const auto scene = std::get<capture::SceneStimulus>(reader->stimulus().value());
  std::size_t begin = 0;
  while (scene.t_s[begin] < 0.0) ++begin;
  std::size_t middle = begin;
  while (scene.t_s[middle] < 0.04) ++middle;
  EXPECT_GT(scene.x_px[middle] - scene.x_px[begin], 4.0);
  EXPECT_GT(scene.y_px[middle] - scene.y_px[begin], 2.0);
}

TEST_F(SimulateVerb, FloatFramesWithoutNoiseAndTruth) {
  const auto reader = must(simulated(
      "--stimulus uniform --temperature 299.987 --type float32 --noise 0 --no-truth --compress --frames 2 --rate 50"));
  EXPECT_FALSE(reader->info().has_truth);
  EXPECT_EQ(reader->t()[1], 0.02);
  for (const float k : capture::testing::frame_values<float>(*reader, 1)) EXPECT_NEAR(k, 299.987F, 1e-4F);
}

TEST_F(SimulateVerb, JsonSaysWhatWasWritten) {
  expect_parts(printed(words("-o @a.h5 --width 8 --height 4 --frames 20 --json")),
               {"\"frames\":20", "\"seconds\":0.1"});
}

TEST_F(SimulateVerb, RefusesInOneLineWithExitCodeTwo) {
  refused_each("-o @a.h5 --width 32 --height 12", "--stimulus nothing", "--stimulus scene --scene bars",
               "--stimulus bar_target --scene street", "--stimulus uniform --speed 10",
               "--stimulus chopper --scene street", "--stimulus chopper --frames 3", "--stimulus chopper --pulses 0",
               "--scene street --hot 320", "--scene bars --cold 320", "--temperature 300", "--scene /nonexistent.png",
               "--frames 0", "--frames x", "--rate 0", "--tau 0", "--noise -1", "--quantisation 0",
               "--quantisation 0.001", "--type uint8", "--threads 0", "--speed 1e9", "--effect nothing",
               "--effect iir:alpha=9", "--effect iir --effect iir:alpha=0.7", "--effect", "--session-start -1",
               "--camera-seed x", "--stimulus chopper --stimulus-error sweep=1",
               "--stimulus uniform --stimulus-error sweep_s=0.001", "--stimulus chopper --stimulus-error sweep_s=9",
               "--trajectory /nonexistent.csv", "--trajectory-scale 2", "--origin 1", "--unknown", "stray");
  EXPECT_FALSE(std::filesystem::exists(file("a.h5")) || std::filesystem::exists(file("a.h5.part")));
}

// A blind check reads these files: nothing but the frames may differ.
TEST_F(SimulateVerb, TheFileDoesNotSayWhichEffectsThereWere) {
  const std::string bench = "--stimulus chopper --frames 60 --no-truth --camera-seed 9 ";
  const auto plain = must(simulated(bench));
  const auto hidden = must(simulated(bench + "--effect iir:alpha=0.6,form=box --effect fpn_offset --session-start 40 "
                                             "--stimulus-error sweep_s=0.002,level_k=0.5",
                                     "b.h5"));
  EXPECT_NE(capture::testing::frame_values(*hidden, 59), capture::testing::frame_values(*plain, 59));
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

TEST_F(SimulateVerb, ListsTheEffects) {
  expect_parts(printed({"--list-effects"}), {"row_delay_s=2.8e-05 s (-0.0001 to 0.0001)"});
  const auto effects = nlohmann::json::parse(printed({"--list-effects", "--json"}));
  ASSERT_EQ(effects.size(), sim::effect_descriptions().size());
  for (const auto& effect : effects) {
    EXPECT_NE(sim::find_effect(effect.at("name").get<std::string>()), nullptr);
    for (const char* key : {"stage", "about", "in_catalogue", "parameters", "forms"}) EXPECT_TRUE(effect.contains(key));
  }
}

// The limit on file size simulates a full disk. The program inherits it from this process.
TEST_F(SimulateVerb, AFullDiskLeavesNothing) {
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit limit{rlim_t{2} << 20, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  const auto outcome = run({"-o", file("full.h5"), "--frames", "300", "--width", "160", "--height", "120"});
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_EQ(outcome.exit_code, 1);
  expect_parts(outcome.err, {"no room to write"});
  for (const auto& left : std::filesystem::directory_iterator(folder_)) ADD_FAILURE() << left.path();
}

TEST_F(SimulateVerb, NeedsAnOutput) { refused({}); }

}  // namespace bolo::sim::simulate_test
