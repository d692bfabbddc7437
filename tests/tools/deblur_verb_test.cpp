// `bolo deblur` as its user meets it: the program itself, its files, messages and exit codes.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "tests/tools/deblur_verb.hpp"

namespace bolo::tools::deblur_verb_test {
namespace {

namespace fs = std::filesystem;
using namespace test;

constexpr std::size_t kWindow = 17;

TEST_F(DeblurVerb, WritesASharpFrameForEachFrameWithAFullWindow) {
  write_blurred(file("in.h5"), {});
  const auto out = deblurred({"--json"});
  EXPECT_EQ(out.info().frames, 60U - (kWindow - 1));
  EXPECT_EQ(out.info().format.type, PixelType::kFloat32);
  EXPECT_EQ(out.info().format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(out.info().format.scale, (LinearScale{Unit::kKelvin, 1.0, 0.0}));
  EXPECT_DOUBLE_EQ(out.info().format.frame_period_s, kPeriod);
  EXPECT_EQ(out.info().camera_model, "a camera");
  const auto in = capture::CaptureReader::open(file("in.h5"));
  ASSERT_TRUE(in);
  for (std::size_t i = 0; i < out.info().frames; ++i) {
    EXPECT_EQ(out.t()[i], in->t()[i + kWindow - 1]);
    EXPECT_EQ(out.frame_id()[i], in->frame_id()[i + kWindow - 1]);
  }
  const auto json = nlohmann::json::parse(last_.out);
  EXPECT_EQ(json["frames_in"], 60);
  EXPECT_EQ(json["frames_out"], 44);
  EXPECT_EQ(json["lost"], 0);
  EXPECT_GT(json["ms_per_frame"].get<double>(), 0.0);
  EXPECT_GT(json["seconds"].get<double>(), 0.0);
  EXPECT_EQ(json["settings"]["solver"], "admm");
  EXPECT_DOUBLE_EQ(json["settings"]["tau_s"].get<double>(), kTau);
  EXPECT_LT(json["rmse"]["deblurred_k"].get<double>(), 0.1 * json["rmse"]["blurred_k"].get<double>());
}

// A gyro whose times are others' changes no bit; one whose times are the frames' is used, and said so.
TEST_F(DeblurVerb, AGyroIsOnTheCapturesClock) {
  write_blurred(file("in.h5"), {.height = kWidth});
  std::ofstream(file("lens.toml")) << "[lens]\nfocal_px = 1400\n";
  std::ofstream here(file("here.csv"));
  std::ofstream elsewhere(file("elsewhere.csv"));
  for (int i = 0; i < 400; ++i) {
    here << 99.95 + 0.001 * i << ",0.01,0.02,0\n";
    elsewhere << 200.0 + 0.001 * i << ",0.01,0.02,0\n";
  }
  here.close();
  elsewhere.close();
  const std::vector<std::string> motion{"--json", "--solver", "motion", "--profile", file("lens.toml")};
  const auto with = [&](const std::string& csv, const std::string& name) {
    std::vector<std::string> words = motion;
    words.insert(words.end(), {"--gyro", file(csv)});
    return deblurred(words, name);
  };
  const auto alone = deblurred(motion, "alone.h5");
  EXPECT_FALSE(nlohmann::json::parse(last_.out).contains("gyro"));
  const auto silent = with("elsewhere.csv", "silent.h5");
  auto said = nlohmann::json::parse(last_.out)["gyro"];
  EXPECT_EQ(said["used"], 0);
  EXPECT_GT(said["silent"], 30);
  for (std::size_t i = 0; i < alone.info().frames; ++i) EXPECT_EQ(frame_of(alone, i), frame_of(silent, i)) << i;
  const auto told = with("here.csv", "told.h5");
  said = nlohmann::json::parse(last_.out)["gyro"];
  EXPECT_EQ(said["silent"], 0);
  EXPECT_GT(said["used"].get<int>() + said["ignored"].get<int>(), 30);  // the bar jumps, which no even turn explains
}

TEST_F(DeblurVerb, TheRmseIsThatOfTheFilesAndTheTruthIsCopied) {
  write_blurred(file("in.h5"), {});
  const auto out = deblurred({"--json", "--lambda", "0.05"});
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
  const auto json = nlohmann::json::parse(last_.out);
  EXPECT_NEAR(json["rmse"]["blurred_k"].get<double>(), std::sqrt(blurred / values), 1e-9);
  EXPECT_NEAR(json["rmse"]["deblurred_k"].get<double>(), std::sqrt(sharp / values), 1e-9);
}

TEST_F(DeblurVerb, SettingsStandInTheOutput) {
  write_blurred(file("in.h5"), {});
  const auto out = deblurred({"--solver", "exact", "--kappa", "0.2", "--lambda", "0.01", "--window", "9", "--levels",
                              "5", "--lookahead", "2", "--tau", "0.012"});
  EXPECT_EQ(attribute<std::string>(out, "solver"), "exact");
  EXPECT_EQ(attribute<double>(out, "tau_s"), 0.012);
  EXPECT_EQ(attribute<double>(out, "kappa"), 0.2);
  EXPECT_EQ(attribute<double>(out, "lambda"), 0.01);
  EXPECT_EQ(attribute<double>(out, "window"), 9.0);
  EXPECT_EQ(attribute<double>(out, "levels"), 5.0);
  EXPECT_EQ(attribute<double>(out, "lookahead"), 2.0);
  EXPECT_EQ(attribute<double>(out, "iterations"), 0.0);
  EXPECT_TRUE(attribute<std::string>(out, "isa"));
}

TEST_F(DeblurVerb, IterationsInUseStandInTheOutput) {
  write_blurred(file("in.h5"), {});
  EXPECT_EQ(attribute<double>(deblurred({"--iterations", "23"}), "iterations"), 23.0);
  EXPECT_GT(attribute<double>(deblurred({}, "auto.h5"), "iterations").value_or(0.0), 0.0);
}

TEST_F(DeblurVerb, TauComesFromTheProfileUnlessGiven) {
  write_blurred(file("in.h5"), {});
  std::ofstream(file("p.toml")) << "tau_s = 0.009\n";
  EXPECT_EQ(attribute<double>(deblurred({"--profile", file("p.toml")}), "tau_s"), 0.009);
  EXPECT_EQ(attribute<double>(deblurred({"--profile", file("p.toml"), "--tau", "0.013"}, "b.h5"), "tau_s"), 0.013);
}

TEST_F(DeblurVerb, ThreadsChangeNoBit) {
  write_blurred(file("in.h5"), {});
  const auto one = deblurred({"--threads", "1"}, "one.h5");
  const auto four = deblurred({"--threads", "4"}, "four.h5");
  ASSERT_EQ(one.info().frames, four.info().frames);
  for (std::size_t n = 0; n < one.info().frames; ++n) ASSERT_EQ(frame_of(one, n), frame_of(four, n)) << n;
}

TEST_F(DeblurVerb, LambdaMayBeAutomaticAndNoiseGiven) {
  write_blurred(file("in.h5"), {});
  (void)deblurred({"--lambda", "auto", "--noise", "0.05", "--json"}, "a.h5");
  const auto json = nlohmann::json::parse(last_.out);
  EXPECT_EQ(json["settings"]["auto_lambda"], true);
  EXPECT_EQ(json["settings"]["noise_k"], 0.05);
  EXPECT_LT(json["rmse"]["deblurred_k"].get<double>(), 0.5 * json["rmse"]["blurred_k"].get<double>());
  (void)deblurred({"--lambda", "auto"}, "b.h5");
  EXPECT_NE(last_.out.find("lambda auto"), std::string::npos) << last_.out;
}

TEST_F(DeblurVerb, AnInstructionSetCanBeChosen) {
  write_blurred(file("in.h5"), {});
  const Outcome refused = run({file("in.h5"), "-o", file("out.h5"), "--isa", "none"});
  ASSERT_EQ(refused.exit_code, 2);
  std::string slowest = refused.err.substr(refused.err.rfind(' ') + 1);  // the last of those it offers
  slowest.pop_back();                                                    // the line's end
  (void)deblurred({"--isa", slowest, "--json"});
  EXPECT_EQ(nlohmann::json::parse(last_.out)["settings"]["isa"], slowest);
}

TEST_F(DeblurVerb, Uint16OutputKeepsTheInputsScale) {
  Blurred blurred;
  blurred.scale = {Unit::kKelvin, 0.01, 100.0};
  write_blurred(file("in.h5"), blurred);
  const auto counts = deblurred({"--type", "uint16"}, "counts.h5");
  const auto kelvin = deblurred({}, "kelvin.h5");
  EXPECT_EQ(counts.info().format.type, PixelType::kUint16);
  EXPECT_EQ(counts.info().format.scale, blurred.scale);
  for (std::size_t n = 0; n < counts.info().frames; n += 7) {
    const auto c = frame_of(counts, n);
    const auto k = frame_of(kelvin, n);
    for (std::size_t i = 0; i < c.size(); ++i) ASSERT_NEAR(100.0F + 0.01F * c[i], k[i], 0.0051F);
  }
}

TEST_F(DeblurVerb, ACaptureInCountsStaysInCountsAndIsNotJudged) {
  write_blurred(file("in.h5"), {.scale = {Unit::kCount, 1.0, 0.0}});
  const auto out = deblurred({"--json", "--lambda", "0.2"});
  EXPECT_EQ(out.info().format.scale.unit, Unit::kCount);
  EXPECT_EQ(out.info().format.type, PixelType::kFloat32);
  for (const float value : frame_of(out, 40)) ASSERT_TRUE(value > 29'000.0F && value < 31'200.0F) << value;
  EXPECT_TRUE(nlohmann::json::parse(last_.out)["rmse"].is_null());
}

TEST_F(DeblurVerb, FloatCapturesAreTaken) {
  write_blurred(file("in.h5"), {.type = PixelType::kFloat32, .scale = {Unit::kKelvin, 1.0, 0.0}});
  (void)deblurred({"--json"});
  const auto json = nlohmann::json::parse(last_.out);
  EXPECT_LT(json["rmse"]["deblurred_k"].get<double>(), 0.1 * json["rmse"]["blurred_k"].get<double>());
}

TEST_F(DeblurVerb, ALostFrameIsAGapAndEventsStartAgain) {
  write_blurred(
      file("in.h5"),
      {.frames = 80, .lost = {20}, .events = {{100.0 + 40 * kPeriod, "nuc"}}, .stimulus = capture::Uniform{300.0}});
  const auto out = deblurred({"--json"});
  EXPECT_EQ(nlohmann::json::parse(last_.out)["lost"], 1);
  std::vector<std::uint64_t> expected;
  for (std::uint64_t n = kWindow - 1; n < 80; ++n) {
    if (n != 20 && (n < 40 || n >= 40 + kWindow - 1)) expected.push_back(500 + n);
  }
  EXPECT_EQ(out.frame_id(), expected);
  ASSERT_EQ(out.events().size(), 1U);
  EXPECT_EQ(out.events()[0].kind, "nuc");
  const auto stimulus = out.stimulus();
  ASSERT_TRUE(stimulus);
  EXPECT_EQ(std::get<capture::Uniform>(*stimulus).temperature_k, 300.0);
}

TEST_F(DeblurVerb, LookaheadLeavesOutFramesAtBothEnds) {
  write_blurred(file("in.h5"), {});
  const auto out = deblurred({"--lookahead", "2"});
  ASSERT_EQ(out.info().frames, 60U - (kWindow - 1));
  EXPECT_EQ(out.frame_id().front(), 500U + kWindow - 1 - 2);
  EXPECT_EQ(out.frame_id().back(), 500U + 59 - 2);
}

TEST_F(DeblurVerb, WithoutJsonItSaysTheSameInALine) {
  write_blurred(file("in.h5"), {.truth = false});
  (void)deblurred();
  EXPECT_NE(last_.out.find("44 of 60 frames"), std::string::npos) << last_.out;
  EXPECT_EQ(last_.out.find("truth"), std::string::npos) << last_.out;
  EXPECT_EQ(last_.err, "");
}

TEST_F(DeblurVerb, AnInterruptionKeepsWhatWasSolved) {
  write_blurred(file("in.h5"), {.frames = 100, .width = 64, .height = 48});
  const std::vector<std::string> exact{"--solver", "exact", "--threads", "1"};
  {
    Program program = start({file("in.h5"), "-o", file("out.h5"), exact[0], exact[1], exact[2], exact[3]});
    std::error_code none;
    while (fs::file_size(file("out.h5.part"), none) < 20 * 64 * 48 * sizeof(float) || none) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    program.signal(SIGINT);
    const Outcome outcome = program.outcome();
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_NE(outcome.err.find("frames are kept in " + file("out.h5.part") + ", which bolo recover finishes"),
              std::string::npos)
        << outcome.err;
  }
  EXPECT_FALSE(fs::exists(file("out.h5")));
  EXPECT_EQ(Program({BOLO_PROGRAM, "recover", file("out.h5.part")}, file("log")).wait(), 0);
  const auto kept = capture::CaptureReader::open(file("out.h5"));
  ASSERT_TRUE(kept);
  const auto whole = deblurred(exact, "whole.h5");
  ASSERT_GE(kept->info().frames, 4U);
  ASSERT_LT(kept->info().frames, whole.info().frames);
  for (std::size_t i = 0; i < kept->info().frames; ++i) ASSERT_EQ(frame_of(*kept, i), frame_of(whole, i)) << i;
  EXPECT_EQ(kept->frame_id().front(), whole.frame_id().front());
  EXPECT_EQ(attribute<std::string>(*kept, "solver"), "exact");
}

// One frame takes this solver seconds, and 64 wait for it: neither is waited for.
TEST_F(DeblurVerb, AnInterruptionIsHeardInTheMiddleOfAFrame) {
  write_blurred(file("in.h5"), {.truth = false, .frames = 100, .width = 1024, .height = 768});
  Program program = start({file("in.h5"), "-o", file("out.h5"), "--solver", "exact", "--levels", "7", "--lambda",
                           "0.001", "--threads", "1"});
  while (!fs::exists(file("out.h5.part"))) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  std::this_thread::sleep_for(std::chrono::seconds(1));
  const auto told = std::chrono::steady_clock::now();
  program.signal(SIGTERM);
  EXPECT_EQ(program.outcome().exit_code, 1);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - told;
  std::printf("it ended after %.3f s\n", took.count());
  EXPECT_LT(took.count(), 5.0) << "1 s is promised; a busy machine takes longer, all frames far longer";
}

TEST_F(DeblurVerb, AnOutputThatStoodThereBeforeSurvivesAFailure) {
  write_blurred(file("in.h5"), {.frames = 5});
  std::ofstream(file("out.h5")) << "older";
  for (const char* how : {"--json", "--overwrite"}) {
    EXPECT_EQ(run({file("in.h5"), "-o", file("out.h5"), how}).exit_code, 2);
    EXPECT_EQ(test::contents(file("out.h5")), "older");
  }
}

TEST_F(DeblurVerb, HelpListsTheOptions) {
  const Outcome outcome = run({"--help"});
  EXPECT_EQ(outcome.exit_code, 0);
  for (const char* option :
       {"--profile", "--solver", "--iterations", "--kappa", "--lambda", "--lookahead", "--window", "--levels",
        "--threads", "--tau", "--roi", "--points", "--isa", "--noise", "--type", "--json"}) {
    EXPECT_NE(outcome.out.find(option), std::string::npos) << option;
  }
}

}  // namespace
}  // namespace bolo::tools::deblur_verb_test
