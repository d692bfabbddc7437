// `bolo deblur` as its user meets it: the program itself, its files, messages and exit codes.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/capture/capture.hpp"
#include "src/capture/pixel_maps_io.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/blurred_capture.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using test::Blurred;
using test::kHeight;
using test::kPeriod;
using test::kTau;
using test::kWidth;
using test::Outcome;
using test::Program;
using test::scene_k;
using test::write_blurred;

constexpr std::size_t kWindow = 17;

class DeblurVerb : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  Outcome bolo(std::vector<std::string> words) const {
    words.insert(words.begin(), {BOLO_PROGRAM, "deblur"});
    return Program(folder_, std::move(words)).outcome();
  }

  // Runs on in.h5 with `more` options, expects success, and opens the output.
  capture::CaptureReader deblurred(const std::vector<std::string>& more = {}, const std::string& name = "out.h5") {
    std::vector<std::string> words{path("in.h5"), "-o", path(name), "--overwrite"};
    words.insert(words.end(), more.begin(), more.end());
    last_ = bolo(words);
    EXPECT_EQ(last_.exit_code, 0) << last_.err;
    EXPECT_FALSE(fs::exists(path(name + ".part")));
    auto reader = capture::CaptureReader::open(path(name));
    if (!reader) throw std::runtime_error(reader.error().message);
    return std::move(*reader);
  }

  const Scratch scratch_;
  const fs::path folder_ = scratch_.path();
  Outcome last_;
};

std::vector<float> frame_of(const capture::CaptureReader& reader, std::size_t index) {
  const std::size_t pixels = reader.info().format.geometry.pixels();
  std::vector<float> values(pixels);
  if (reader.info().format.type == PixelType::kFloat32) {
    EXPECT_TRUE(reader.read_frame(index, values.data()));
    return values;
  }
  std::vector<std::uint16_t> counts(pixels);
  EXPECT_TRUE(reader.read_frame(index, counts.data()));
  for (std::size_t i = 0; i < pixels; ++i) values[i] = static_cast<float>(counts[i]);
  return values;
}

template <typename T>
std::optional<T> attribute(const capture::CaptureReader& reader, const std::string& name) {
  const auto attributes = reader.attributes();
  EXPECT_TRUE(attributes);
  for (const capture::Attribute& a : attributes.value_or(std::vector<capture::Attribute>{})) {
    if (a.name == name && std::holds_alternative<T>(a.value)) return std::get<T>(a.value);
  }
  return std::nullopt;
}

TEST_F(DeblurVerb, WritesASharpFrameForEachFrameWithAFullWindow) {
  write_blurred(path("in.h5"), {});
  const auto out = deblurred({"--json"});
  EXPECT_EQ(out.info().frames, 60U - (kWindow - 1));
  EXPECT_EQ(out.info().format.type, PixelType::kFloat32);
  EXPECT_EQ(out.info().format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(out.info().format.scale, (LinearScale{Unit::kKelvin, 1.0, 0.0}));
  EXPECT_DOUBLE_EQ(out.info().format.frame_period_s, kPeriod);
  EXPECT_EQ(out.info().camera_model, "a camera");
  const auto in = capture::CaptureReader::open(path("in.h5"));
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

TEST_F(DeblurVerb, TheRmseIsThatOfTheFilesAndTheTruthIsCopied) {
  write_blurred(path("in.h5"), {});
  const auto out = deblurred({"--json", "--lambda", "0.05"});
  ASSERT_TRUE(out.info().has_truth);
  const auto in = capture::CaptureReader::open(path("in.h5"));
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
  write_blurred(path("in.h5"), {});
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
  write_blurred(path("in.h5"), {});
  EXPECT_EQ(attribute<double>(deblurred({"--iterations", "23"}), "iterations"), 23.0);
  EXPECT_GT(attribute<double>(deblurred({}, "auto.h5"), "iterations").value_or(0.0), 0.0);
}

TEST_F(DeblurVerb, TauComesFromTheProfileUnlessGiven) {
  write_blurred(path("in.h5"), {});
  std::ofstream(path("p.toml")) << "tau_s = 0.009\n";
  EXPECT_EQ(attribute<double>(deblurred({"--profile", path("p.toml")}), "tau_s"), 0.009);
  EXPECT_EQ(attribute<double>(deblurred({"--profile", path("p.toml"), "--tau", "0.013"}, "b.h5"), "tau_s"), 0.013);
}

TEST_F(DeblurVerb, ThreadsChangeNoBit) {
  write_blurred(path("in.h5"), {});
  const auto one = deblurred({"--threads", "1"}, "one.h5");
  const auto four = deblurred({"--threads", "4"}, "four.h5");
  ASSERT_EQ(one.info().frames, four.info().frames);
  for (std::size_t n = 0; n < one.info().frames; ++n) ASSERT_EQ(frame_of(one, n), frame_of(four, n)) << n;
}

TEST_F(DeblurVerb, ARegionIsTheSamePixelsBitForBit) {
  Blurred blurred;
  capture::SceneStimulus scene;
  scene.image_width = 2;
  scene.image_height = 2;
  scene.image_k = {295.0F, 296.0F, 297.0F, 298.0F};
  scene.t_s = {0.0, 1.0};
  scene.x_px = {0.5, 1.0};
  scene.y_px = {0.0, 0.25};
  blurred.stimulus = scene;
  write_blurred(path("in.h5"), blurred);
  const auto whole = deblurred({}, "whole.h5");
  const auto part = deblurred({"--roi", "3,1,21,4"}, "part.h5");
  ASSERT_EQ(part.info().format.geometry, (Geometry{21, 4}));
  ASSERT_EQ(part.info().frames, whole.info().frames);
  std::vector<float> truth(21 * 4);
  std::vector<float> whole_truth(static_cast<std::size_t>(kWidth * kHeight));
  for (std::size_t n = 0; n < part.info().frames; ++n) {
    const auto small = frame_of(part, n);
    const auto large = frame_of(whole, n);
    ASSERT_TRUE(part.read_truth(n, truth.data()));
    ASSERT_TRUE(whole.read_truth(n, whole_truth.data()));
    for (std::size_t i = 0; i < small.size(); ++i) {
      const std::size_t j = (i / 21 + 1) * static_cast<std::size_t>(kWidth) + i % 21 + 3;
      ASSERT_EQ(small[i], large[j]) << "frame " << n << " pixel " << i;
      ASSERT_EQ(truth[i], whole_truth[j]);
    }
  }
  EXPECT_EQ(attribute<std::string>(part, "roi"), "3,1,21,4");
  const auto stimulus = part.stimulus();
  ASSERT_TRUE(stimulus);
  const auto& seen = std::get<capture::SceneStimulus>(*stimulus);
  EXPECT_EQ(seen.x_px, (std::vector<double>{3.5, 4.0}));
  EXPECT_EQ(seen.y_px, (std::vector<double>{1.0, 1.25}));
}

class DeblurVerbPoints : public DeblurVerb, public testing::WithParamInterface<const char*> {};

TEST_P(DeblurVerbPoints, AreTheWholeFramesBits) {
  Blurred blurred;
  blurred.stimulus = capture::Uniform{300.0};
  write_blurred(path("in.h5"), blurred);
  std::ofstream(path("p.csv")) << "x,y\n# comment\n3, 1\n\n39,5\r\n0.4,0\n2.5,4.49\n3,1\n";
  const std::vector<capture::Point> places{{3, 1}, {39, 5}, {0, 0}, {3, 4}, {3, 1}};
  const auto whole = deblurred({"--solver", GetParam()}, "whole.h5");
  const auto part = deblurred({"--solver", GetParam(), "--points", path("p.csv"), "--json"}, "points.h5");
  const auto json = nlohmann::json::parse(last_.out);
  EXPECT_EQ(json["points"], 5);
  EXPECT_TRUE(json["roi"].is_null());
  ASSERT_EQ(part.info().format.geometry, (Geometry{5, 1}));
  ASSERT_EQ(part.info().frames, whole.info().frames);
  ASSERT_TRUE(part.points());
  EXPECT_EQ(*part.points(), places);
  EXPECT_TRUE(whole.points()->empty());
  EXPECT_EQ(attribute<std::string>(part, "points_file"), "p.csv");
  std::vector<float> truth(5);
  std::vector<float> whole_truth(static_cast<std::size_t>(kWidth * kHeight));
  for (std::size_t n = 0; n < part.info().frames; ++n) {
    const auto few = frame_of(part, n);
    const auto all = frame_of(whole, n);
    ASSERT_TRUE(part.read_truth(n, truth.data()));
    ASSERT_TRUE(whole.read_truth(n, whole_truth.data()));
    for (std::size_t i = 0; i < places.size(); ++i) {
      const auto at = static_cast<std::size_t>(places[i].y * kWidth + places[i].x);
      ASSERT_EQ(few[i], all[at]) << "frame " << n << " point " << i;
      ASSERT_EQ(truth[i], whole_truth[at]);
    }
  }
  const Outcome info = Program(folder_, {BOLO_PROGRAM, "info", path("points.h5")}).outcome();
  EXPECT_EQ(info.exit_code, 0) << info.err;
  EXPECT_NE(info.out.find("5 single pixels"), std::string::npos) << info.out;
}

// A texture that moves 1.5 px a frame to the right and 0.5 down; frame 40 is lost.
void write_pan(const fs::path& file) {
  capture::CaptureInfo info;
  info.format.geometry = {100, 60};
  info.format.scale = {Unit::kKelvin, 0.01, 0.0};
  info.format.frame_period_s = kPeriod;
  auto writer = capture::CaptureWriter::create(file, info);
  ASSERT_TRUE(writer);
  const double decay = std::exp(-kPeriod / kTau);
  std::vector<double> y(info.format.geometry.pixels(), 300.0);
  std::vector<std::uint16_t> counts(y.size());
  for (std::size_t n = 0; n < 60; ++n) {
    for (std::size_t i = 0; i < y.size(); ++i) {
      const double column = static_cast<double>(i % 100) - 1.5 * static_cast<double>(n);
      const double row = static_cast<double>(i / 100) - 0.5 * static_cast<double>(n);
      double x = 300.0;  // waves of many directions and lengths, so that nothing repeats
      for (int k = 1; k <= 16; ++k) {
        const double across = 0.05 * k * std::cos(2.4 * k);
        const double down = 0.05 * k * std::sin(2.4 * k);
        x += 1.5 * std::sin(across * column + down * row + 1.7 * k);
      }
      y[i] = decay * y[i] + (1.0 - decay) * x;
      counts[i] = static_cast<std::uint16_t>(std::lround(y[i] / 0.01));
    }
    if (n == 40) continue;
    ASSERT_TRUE(writer->append(0.005 * static_cast<double>(n), n, counts.data()));
  }
  ASSERT_TRUE(writer->close());
}

std::vector<BlockMotion> motion_of(const capture::CaptureReader& reader, std::size_t index) {
  std::vector<BlockMotion> blocks(motion_blocks(reader.info().format.geometry).pixels());
  EXPECT_TRUE(reader.read_motion(index, blocks.data()));
  return blocks;
}

TEST_F(DeblurVerb, MotionIsWrittenBesideTheFrames) {
  write_pan(path("in.h5"));
  const auto out = deblurred({"--solver", "motion", "--noise", "0.03"});
  ASSERT_TRUE(out.info().has_motion);
  for (std::size_t n = 3; n < out.info().frames; ++n) {
    const std::uint64_t id = out.frame_id()[n];
    const auto blocks = motion_of(out, n);
    ASSERT_EQ(blocks.size(), 13U * 8U);
    const bool known = id < 40 || id > 43;  // of three frames each: the lost one, and those after it
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      if (id == 41) {
        ASSERT_EQ(blocks[i].confidence, 0.0F) << i;
      }
      const bool inside = i % 13 > 0 && i % 13 < 12 && i / 13 > 0 && i / 13 < 7;
      if (!known || !inside) continue;
      ASSERT_NEAR(blocks[i].x, 1.5, 0.15) << id << ' ' << i;
      ASSERT_NEAR(blocks[i].y, 0.5, 0.15) << id << ' ' << i;
      ASSERT_GT(blocks[i].confidence, 0.5F) << id << ' ' << i;
      ASSERT_LE(blocks[i].confidence, 1.0F);
    }
  }
  const Outcome info = Program(folder_, {BOLO_PROGRAM, "info", path("out.h5")}).outcome();
  EXPECT_NE(info.out.find("velocity and confidence"), std::string::npos) << info.out;
}

TEST_F(DeblurVerb, MotionOfARegionIsThatOfItsPlaceAndOtherwiseAbsent) {
  write_pan(path("in.h5"));
  const auto whole = deblurred({"--solver", "motion"}, "whole.h5");
  const auto part = deblurred({"--solver", "motion", "--roi", "18,9,33,20"}, "part.h5");
  ASSERT_TRUE(part.info().has_motion);
  const auto all = motion_of(whole, 10);
  const auto some = motion_of(part, 10);
  ASSERT_EQ(some.size(), 5U * 3U);
  EXPECT_EQ(some[0].x, all[13 * 1 + 2].x) << "its middle, 22,13, lies in block 2,1";
  EXPECT_EQ(some[5 * 2 + 4].y, all[13 * 3 + 6].y) << "54,29 in block 6,3";
  std::ofstream(path("p.csv")) << "3,1\n50,30\n";
  EXPECT_FALSE(deblurred({"--solver", "motion", "--points", path("p.csv")}, "points.h5").info().has_motion);
  for (const char* solver : {"admm", "mmae", "inverse"}) {
    EXPECT_FALSE(deblurred({"--solver", solver}, "other.h5").info().has_motion) << solver;
  }
}

INSTANTIATE_TEST_SUITE_P(Solvers, DeblurVerbPoints, testing::Values("admm", "dual", "exact", "inverse", "mmae"),
                         [](const auto& each) { return std::string(each.param); });

TEST_F(DeblurVerb, TakesMapsFromTheProfileAndFillsDeadPixels) {
  write_blurred(path("in.h5"), {});
  const auto plain = deblurred({"--solver", "inverse"}, "plain.h5");
  model::PixelMaps maps;
  maps.geometry = {kWidth, kHeight};
  maps.offset.assign(maps.geometry.pixels(), 0.5F);
  maps.dead.assign(maps.geometry.pixels(), 0);
  maps.dead[static_cast<std::size_t>(kWidth) + 4] = 1;
  ASSERT_TRUE(capture::write_pixel_maps({path("maps.h5")}, maps));
  std::ofstream(path("p.toml")) << "maps = \"maps.h5\"\n";
  for (const std::vector<std::string>& words : {std::vector<std::string>{}, {"--roi", "0,0,20,3"}}) {
    std::vector<std::string> all{"--solver", "inverse", "--profile", path("p.toml")};
    all.insert(all.end(), words.begin(), words.end());
    const auto mapped = deblurred(all, "mapped.h5");
    EXPECT_EQ(attribute<std::string>(mapped, "maps"), "maps.h5");
    const auto width = static_cast<std::size_t>(mapped.info().format.geometry.width);
    const auto before = frame_of(plain, 3);
    const auto after = frame_of(mapped, 3);
    EXPECT_NEAR(after[2 * width + 7], before[2 * kWidth + 7] + 0.5F, 1e-3F);
    float mean = 0.0F;
    for (const int dy : {0, 1, 2}) {
      for (const int x : {3, 4, 5}) {
        if (dy != 1 || x != 4)
          mean += 0.125F * after[static_cast<std::size_t>(dy) * width + static_cast<std::size_t>(x)];
      }
    }
    EXPECT_NEAR(after[width + 4], mean, 2e-3F);
  }
}

TEST_F(DeblurVerb, LambdaMayBeAutomaticAndNoiseGiven) {
  write_blurred(path("in.h5"), {});
  (void)deblurred({"--lambda", "auto", "--noise", "0.05", "--json"}, "a.h5");
  const auto json = nlohmann::json::parse(last_.out);
  EXPECT_EQ(json["settings"]["auto_lambda"], true);
  EXPECT_EQ(json["settings"]["noise_k"], 0.05);
  EXPECT_LT(json["rmse"]["deblurred_k"].get<double>(), 0.5 * json["rmse"]["blurred_k"].get<double>());
  (void)deblurred({"--lambda", "auto"}, "b.h5");
  EXPECT_NE(last_.out.find("lambda auto"), std::string::npos) << last_.out;
}

TEST_F(DeblurVerb, AnInstructionSetCanBeChosen) {
  write_blurred(path("in.h5"), {});
  (void)deblurred({"--isa", "scalar", "--json"});
  EXPECT_EQ(nlohmann::json::parse(last_.out)["settings"]["isa"], "scalar");
}

TEST_F(DeblurVerb, Uint16OutputKeepsTheInputsScale) {
  Blurred blurred;
  blurred.scale = {Unit::kKelvin, 0.01, 100.0};
  write_blurred(path("in.h5"), blurred);
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
  Blurred blurred;
  blurred.scale = {Unit::kCount, 1.0, 0.0};
  write_blurred(path("in.h5"), blurred);
  const auto out = deblurred({"--json", "--lambda", "0.2"});
  EXPECT_EQ(out.info().format.scale.unit, Unit::kCount);
  EXPECT_EQ(out.info().format.type, PixelType::kFloat32);
  for (const float value : frame_of(out, 40)) ASSERT_TRUE(value > 29'000.0F && value < 31'200.0F) << value;
  EXPECT_TRUE(nlohmann::json::parse(last_.out)["rmse"].is_null());
}

TEST_F(DeblurVerb, FloatCapturesAreTaken) {
  Blurred blurred;
  blurred.type = PixelType::kFloat32;
  blurred.scale = {Unit::kKelvin, 1.0, 0.0};
  write_blurred(path("in.h5"), blurred);
  (void)deblurred({"--json"});
  const auto json = nlohmann::json::parse(last_.out);
  EXPECT_LT(json["rmse"]["deblurred_k"].get<double>(), 0.1 * json["rmse"]["blurred_k"].get<double>());
}

TEST_F(DeblurVerb, ALostFrameIsAGapAndEventsStartAgain) {
  Blurred blurred;
  blurred.frames = 80;
  blurred.lost = {20};
  blurred.events = {{100.0 + 40 * kPeriod, "nuc"}};
  blurred.stimulus = capture::Uniform{300.0};
  write_blurred(path("in.h5"), blurred);
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
  write_blurred(path("in.h5"), {});
  const auto out = deblurred({"--lookahead", "2"});
  ASSERT_EQ(out.info().frames, 60U - (kWindow - 1));
  EXPECT_EQ(out.frame_id().front(), 500U + kWindow - 1 - 2);
  EXPECT_EQ(out.frame_id().back(), 500U + 59 - 2);
}

TEST_F(DeblurVerb, WithoutJsonItSaysTheSameInALine) {
  Blurred blurred;
  blurred.truth = false;
  write_blurred(path("in.h5"), blurred);
  (void)deblurred();
  EXPECT_NE(last_.out.find("44 of 60 frames"), std::string::npos) << last_.out;
  EXPECT_EQ(last_.out.find("truth"), std::string::npos) << last_.out;
  EXPECT_EQ(last_.err, "");
}

struct Refusal {
  const char* name;
  std::vector<std::string> words;  // IN, FEW, NAN, FLOAT, DIR are replaced by paths
  const char* says;
};

class DeblurVerbRefuses : public DeblurVerb, public testing::WithParamInterface<Refusal> {};

TEST_P(DeblurVerbRefuses, InOneLineWithExitCode2AndNoOutput) {
  write_blurred(path("in.h5"), {});
  Blurred few;
  few.frames = 16;
  write_blurred(path("few.h5"), few);
  Blurred floats;
  floats.type = PixelType::kFloat32;
  floats.scale = {Unit::kKelvin, 1.0, 0.0};
  write_blurred(path("float.h5"), floats);
  Blurred broken;
  broken.events = {{100.0 + 10 * kPeriod, "nuc"},
                   {100.0 + 20 * kPeriod, "nuc"},
                   {100.0 + 35 * kPeriod, "nuc"},
                   {100.0 + 50 * kPeriod, "reconnect"}};
  write_blurred(path("broken.h5"), broken);
  Blurred slow;
  slow.period_s = 114.0;  // milliseconds taken for seconds
  write_blurred(path("slow.h5"), slow);
  std::ofstream(path("text.h5")) << "not a capture\n";
  std::ofstream(path("bad.csv")) << "# points\nx,y\n1,2\n3;4\n";
  std::ofstream(path("far.csv")) << "39.5,2\n";
  std::ofstream(path("empty.csv")) << "x,y\n# none\n";
  model::PixelMaps turned;
  turned.geometry = {kHeight, kWidth};
  turned.gain.assign(turned.geometry.pixels(), 1.0F);
  ASSERT_TRUE(capture::write_pixel_maps({path("turned-maps.h5")}, turned));
  std::ofstream(path("turned.toml")) << "maps = \"turned-maps.h5\"\n";
  {
    capture::CaptureInfo info;
    info.format.geometry = {3, 2};
    info.format.type = PixelType::kFloat32;
    info.format.scale = {Unit::kKelvin, 1.0, 0.0};
    auto writer = capture::CaptureWriter::create(path("nan.h5"), info);
    ASSERT_TRUE(writer);
    for (std::uint64_t n = 0; n < 30; ++n) {
      std::vector<float> plane(6, 300.0F);
      if (n == 25) plane[4] = std::numeric_limits<float>::quiet_NaN();
      ASSERT_TRUE(writer->append(static_cast<double>(n) * kPeriod, n, plane.data()));
    }
    ASSERT_TRUE(writer->close());
  }
  std::vector<std::string> words = GetParam().words;
  for (std::string& word : words) {
    if (const auto at = word.find('@'); at != std::string::npos) word = word.substr(0, at) + path(word.substr(at + 1));
  }
  const Outcome outcome = bolo(words);
  EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_EQ(outcome.err.rfind("bolo deblur: ", 0), 0U) << outcome.err;
  EXPECT_NE(outcome.err.find(GetParam().says), std::string::npos) << outcome.err;
  EXPECT_EQ(outcome.out, "");
  EXPECT_FALSE(fs::exists(path("out.h5")));
  EXPECT_FALSE(fs::exists(path("out.h5.part")));
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
        Refusal{
            "PointIsNoPoint", {"@in.h5", "-o", "@out.h5", "--points", "@bad.csv"}, "bad.csv:4: '3;4' is not a point"},
        Refusal{
            "PointOutside", {"@in.h5", "-o", "@out.h5", "--points", "@far.csv"}, "far.csv:1: point 39.5,2 is outside"},
        Refusal{"NoPoints", {"@in.h5", "-o", "@out.h5", "--points", "@empty.csv"}, "empty.csv: no points"},
        Refusal{
            "RegionAndPoints", {"@in.h5", "-o", "@out.h5", "--roi", "0,0,2,2", "--points", "@far.csv"}, "one of them"},
        Refusal{
            "MapsOfAnotherSize", {"@in.h5", "-o", "@out.h5", "--profile", "@turned.toml"}, "for frames of 6x40, but"},
        Refusal{"NoThreads", {"@in.h5", "-o", "@out.h5", "--threads", "0"}, "workers = 0"},
        Refusal{"RegionOfThree", {"@in.h5", "-o", "@out.h5", "--roi", "1,2,3"}, "four numbers"},
        Refusal{"RegionOutside", {"@in.h5", "-o", "@out.h5", "--roi", "30,0,11,2"}, "not inside the frame of 40x6"},
        Refusal{"ProfileMissing", {"@in.h5", "-o", "@out.h5", "--profile", "@none.toml"}, "none.toml"}),
    [](const auto& suite) { return suite.param.name; });

TEST_F(DeblurVerb, AnInterruptionKeepsWhatWasSolved) {
  Blurred large;
  large.frames = 100;
  large.width = 64;
  large.height = 48;
  write_blurred(path("in.h5"), large);
  const std::vector<std::string> exact{"--solver", "exact", "--threads", "1"};
  {
    const Program program(
        folder_, {BOLO_PROGRAM, "deblur", path("in.h5"), "-o", path("out.h5"), exact[0], exact[1], exact[2], exact[3]});
    std::error_code none;
    while (fs::file_size(path("out.h5.part"), none) < 20 * 64 * 48 * sizeof(float) || none) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    program.signal(SIGINT);
    const Outcome outcome = program.outcome();
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_NE(outcome.err.find("frames are kept in " + path("out.h5.part") + ", which bolo recover finishes"),
              std::string::npos)
        << outcome.err;
  }
  EXPECT_FALSE(fs::exists(path("out.h5")));
  EXPECT_EQ(Program(folder_, {BOLO_PROGRAM, "recover", path("out.h5.part")}).outcome().exit_code, 0);
  const auto kept = capture::CaptureReader::open(path("out.h5"));
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
  Blurred large;
  large.truth = false;
  large.frames = 100;
  large.width = 1024;
  large.height = 768;
  write_blurred(path("in.h5"), large);
  const Program program(folder_, {BOLO_PROGRAM, "deblur", path("in.h5"), "-o", path("out.h5"), "--solver", "exact",
                                  "--levels", "7", "--lambda", "0.001", "--threads", "1"});
  while (!fs::exists(path("out.h5.part"))) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  std::this_thread::sleep_for(std::chrono::seconds(1));
  const auto told = std::chrono::steady_clock::now();
  program.signal(SIGTERM);
  EXPECT_EQ(program.outcome().exit_code, 1);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - told;
  std::printf("it ended after %.3f s\n", took.count());
  EXPECT_LT(took.count(), 5.0) << "1 s is promised; a busy machine takes longer, all frames far longer";
}

TEST_F(DeblurVerb, AnOutputThatStoodThereBeforeSurvivesAFailure) {
  Blurred few;
  few.frames = 5;
  write_blurred(path("in.h5"), few);
  std::ofstream(path("out.h5")) << "older";
  for (const char* how : {"--json", "--overwrite"}) {
    EXPECT_EQ(bolo({path("in.h5"), "-o", path("out.h5"), how}).exit_code, 2);
    EXPECT_EQ(test::contents(path("out.h5")), "older");
  }
}

TEST_F(DeblurVerb, HelpListsTheOptions) {
  const Outcome outcome = bolo({"--help"});
  EXPECT_EQ(outcome.exit_code, 0);
  for (const char* option :
       {"--profile", "--solver", "--iterations", "--kappa", "--lambda", "--lookahead", "--window", "--levels",
        "--threads", "--tau", "--roi", "--points", "--isa", "--noise", "--type", "--json"}) {
    EXPECT_NE(outcome.out.find(option), std::string::npos) << option;
  }
}

}  // namespace
}  // namespace bolo::tools
