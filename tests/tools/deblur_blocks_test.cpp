// `bolo deblur` in blocks, as shards, and interrupted: the same bytes as at once, and nothing done twice.
#include <gtest/gtest.h>

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/capture/pixel_maps_io.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/blurred_capture.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::Blurred;
using test::contents;
using test::Outcome;
using test::Program;
using test::write_blurred;
using Words = std::vector<std::string>;

// With everything in it that a capture may have: losses, a break, a truth, a stimulus.
Blurred rough() {
  Blurred capture;
  capture.frames = 170;
  capture.lost = {20, 21, 57, 90, 120, 121, 122};
  capture.events = {{100.0 + 75 * test::kPeriod, "nuc"}};
  capture.stimulus = capture::Uniform{300.0};
  return capture;
}

class DeblurBlocks : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  Outcome bolo(Words words) const {
    words.insert(words.begin(), {BOLO_PROGRAM, "deblur"});
    return Program(folder_, std::move(words)).outcome();
  }

  // Runs, expects success, and reads what --json says.
  json done(Words words) const {
    words.emplace_back("--json");
    const Outcome outcome = bolo(words);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    json summary = json::parse(outcome.out, nullptr, false);
    if (summary.is_discarded()) throw std::runtime_error("no JSON: " + outcome.out + outcome.err);
    return summary;
  }

  // in.h5 at once into whole.h5, with these options.
  json whole(Words options = {}) const {
    options.insert(options.begin(), {path("in.h5"), "-o", path("whole.h5")});
    return done(options);
  }

  Words in_blocks(const Words& options, const std::string& block = "16") const {
    Words words{path("in.h5"), "-o", path("out.h5"), "--block", block};
    words.insert(words.end(), options.begin(), options.end());
    return words;
  }

  void expect_identical(const std::string& one = "whole.h5", const std::string& other = "out.h5") const {
    ASSERT_TRUE(fs::exists(path(other)));
    EXPECT_TRUE(contents(path(one)) == contents(path(other))) << one << " and " << other << " differ";
  }

  fs::path record(const std::string& piece) const { return folder_ / "out.h5.job" / "done" / (piece + ".json"); }
  fs::path data(const std::string& piece) const { return folder_ / "out.h5.job" / "data" / piece; }

  const Scratch scratch_;
  const fs::path folder_ = scratch_.path();
};

struct Options {
  const char* name;
  Words words;
  Words blocks = {"16", "50"};
  PixelType type = PixelType::kUint16;
};

class AnyOptions : public DeblurBlocks, public testing::WithParamInterface<Options> {};

TEST_P(AnyOptions, BlocksAreTheWholeByteForByte) {
  Blurred capture = rough();
  capture.type = GetParam().type;
  if (capture.type == PixelType::kFloat32) capture.scale = {Unit::kKelvin, 1.0, 0.0};
  write_blurred(path("in.h5"), capture);
  std::ofstream(path("points.csv")) << "x,y\n3,1\n17,4\n0,0\n";
  const json at_once = whole(GetParam().words);
  for (const std::string& block : GetParam().blocks) {
    fs::remove_all(path("out.h5.job"));
    fs::remove(path("out.h5"));
    const json summary = done(in_blocks(GetParam().words, block));
    expect_identical();
    for (const char* key : {"frames_in", "frames_out", "lost", "settings", "roi", "points", "maps", "rmse"}) {
      EXPECT_EQ(summary.at(key), at_once.at(key)) << key << ", block " << block;
    }
    EXPECT_TRUE(fs::is_empty(folder_ / "out.h5.job" / "data"));
  }
}

INSTANTIATE_TEST_SUITE_P(OfTheVerb, AnyOptions,
                         testing::Values(Options{"Defaults", {}, {"1", "16", "163", "1000"}},
                                         Options{"LookAhead", {"--lookahead", "2"}},
                                         Options{"Inverse", {"--solver", "inverse", "--window", "9"}},
                                         Options{"Mmae", {"--solver", "mmae", "--lookahead", "1"}},
                                         Options{"AutoLambda", {"--lambda", "auto"}, {"70"}},
                                         Options{"Region", {"--roi", "3,1,20,4"}},
                                         Options{"Counts", {"--type", "uint16"}},
                                         Options{"Floats", {"--solver", "dual"}, {"16"}, PixelType::kFloat32}),
                         [](const testing::TestParamInfo<Options>& one) { return std::string(one.param.name); });

TEST_F(DeblurBlocks, PointsAreTheSameToo) {
  write_blurred(path("in.h5"), rough());
  std::ofstream(path("points.csv")) << "x,y\n3,1\n17,4\n0,0\n";
  (void)whole({"--points", path("points.csv")});
  (void)done(in_blocks({"--points", path("points.csv")}));
  expect_identical();
}

TEST_F(DeblurBlocks, WhatAProfileUndoesGoesOnFromBlockToBlock) {
  write_blurred(path("in.h5"), rough());
  model::PixelMaps maps;
  maps.geometry = {test::kWidth, test::kHeight};
  for (int i = 0; i < test::kWidth * test::kHeight; ++i) {
    maps.tau_s.push_back(0.010F + 2e-5F * static_cast<float>(i % 90));
  }
  ASSERT_TRUE(capture::write_pixel_maps({path("maps.h5")}, maps));
  std::ofstream(path("p.toml")) << "tau_s = 0.011\nmaps = \"maps.h5\"\n";
  (void)whole({"--profile", path("p.toml")});
  (void)done(in_blocks({"--profile", path("p.toml")}));
  expect_identical();
  std::ofstream(path("p.toml"), std::ios::app) << "noise_k = 0.04\n";
  const Outcome other = bolo(in_blocks({"--profile", path("p.toml")}));
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("/sha256/profile"), std::string::npos) << other.err;
}

TEST_F(DeblurBlocks, ShardsInAnyOrderAreTheWhole) {
  write_blurred(path("in.h5"), rough());
  (void)whole({"--solver", "mmae"});
  for (const char* shard : {"3/4", "1/4", "2/4"}) {
    const json summary = done(in_blocks({"--solver", "mmae", "--shard", shard}));
    EXPECT_GT(summary.at("job").at("pieces_left"), 0);
    EXPECT_FALSE(fs::exists(path("out.h5"))) << "not before all is done";
  }
  EXPECT_EQ(done(in_blocks({"--solver", "mmae", "--shard", "4/4"})).at("job").at("pieces_left"), 0);
  expect_identical();
}

TEST_F(DeblurBlocks, WhatIsDoneIsNotDoneTwice) {
  write_blurred(path("in.h5"), rough());
  (void)whole();
  EXPECT_EQ(done(in_blocks({"--shard", "0/2"})).at("job").at("pieces_done"), 5);
  const json second = done(in_blocks({})).at("job");
  EXPECT_EQ(second.at("pieces_before"), 5);
  EXPECT_EQ(second.at("pieces_done"), 7) << "six blocks and the output";
  const auto written = fs::last_write_time(path("out.h5"));
  const json third = done(in_blocks({})).at("job");
  EXPECT_EQ(third.at("pieces_done"), 0);
  EXPECT_EQ(fs::last_write_time(path("out.h5")), written);
  expect_identical();
}

TEST_F(DeblurBlocks, AnOutputThatIsGoneOrCutOffIsMadeAgain) {
  write_blurred(path("in.h5"), rough());
  (void)whole();
  (void)done(in_blocks({}));
  fs::remove(path("out.h5"));
  (void)done(in_blocks({}));
  expect_identical();
  fs::resize_file(path("out.h5"), fs::file_size(path("out.h5")) - 1);
  (void)done(in_blocks({}));
  expect_identical();
}

// A kill at any moment leaves blocks that are done and nothing that is taken for one.
TEST_F(DeblurBlocks, AKilledRunGoesOnFromWhereItWas) {
  Blurred capture = rough();
  capture.frames = 400;
  write_blurred(path("in.h5"), capture);
  const Words slow{"--solver", "exact", "--levels", "7", "--threads", "1"};
  (void)whole(slow);
  int kills = 0;
  for (int after = 1; after <= 3; ++after) {
    Words words = in_blocks(slow, "40");
    words.insert(words.begin(), {BOLO_PROGRAM, "deblur"});
    const Program program(folder_, words);
    const auto records = [&] {
      std::error_code none;
      return std::distance(fs::directory_iterator(folder_ / "out.h5.job" / "done", none), fs::directory_iterator());
    };
    while (!fs::exists(path("out.h5")) && records() < after) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    program.signal(SIGKILL);
    kills += program.outcome().exit_code == -1 ? 1 : 0;
  }
  EXPECT_GE(kills, 1);
  const json last = done(in_blocks(slow, "40")).at("job");
  EXPECT_GE(last.at("pieces_before"), 1);
  EXPECT_LE(last.at("pieces_done"), 10);
  expect_identical();
  EXPECT_TRUE(fs::is_empty(folder_ / "out.h5.job" / "data")) << "what the killed runs left";
}

TEST_F(DeblurBlocks, AnInterruptedRunSaysHowItGoesOn) {
  Blurred capture = rough();
  capture.frames = 400;
  write_blurred(path("in.h5"), capture);
  Words words = in_blocks({"--solver", "exact", "--threads", "1"}, "40");
  words.insert(words.begin(), {BOLO_PROGRAM, "deblur"});
  const Program program(folder_, words);
  while (!fs::exists(record("c00000-block-00000"))) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  program.signal(SIGINT);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_NE(outcome.err.find("the same command goes on from there"), std::string::npos) << outcome.err;
}

TEST_F(DeblurBlocks, TornBlocksAreDoneAgain) {
  write_blurred(path("in.h5"), rough());
  (void)whole();
  (void)done(in_blocks({"--shard", "0/2"}));
  fs::resize_file(data("c00000-block-00003"), fs::file_size(data("c00000-block-00003")) / 2);
  fs::remove(data("c00000-block-00001"));
  fs::resize_file(record("c00000-block-00002"), 40);
  const json summary = done(in_blocks({})).at("job");
  EXPECT_EQ(summary.at("pieces_before"), 2);
  expect_identical();
}

TEST_F(DeblurBlocks, ABlockThatChangedOnTheDiskIsDoneAgainInTheSameRun) {
  write_blurred(path("in.h5"), rough());
  (void)whole({"--solver", "mmae"});
  (void)done(in_blocks({"--solver", "mmae", "--shard", "0/2"}));
  for (const char* piece : {"c00000-block-00003", "c00000-walk-00002"}) {
    std::fstream file(data(piece), std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(20);
    const char other = static_cast<char>(file.get() ^ 1);
    file.seekp(20);
    file.put(other);
  }
  (void)done(in_blocks({"--solver", "mmae"}));
  expect_identical();
}

TEST_F(DeblurBlocks, OtherSettingsInTheSameFolderAreRefused) {
  write_blurred(path("in.h5"), rough());
  (void)done(in_blocks({"--shard", "0/2"}));
  struct Other {
    Words words;
    const char* said;
  };
  for (const Other& other : {Other{{"--lambda", "0.5"}, "/settings/lambda"}, Other{{"--lookahead", "1"}, "lookahead"},
                             Other{{"--roi", "0,0,8,4"}, "/settings/roi"}, Other{{"--block", "20"}, "/block_frames"}}) {
    Words words = in_blocks({});
    words.insert(words.end(), other.words.begin(), other.words.end());
    const Outcome outcome = bolo(words);
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_NE(outcome.err.find(other.said), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("remove the folder"), std::string::npos) << outcome.err;
  }
  Blurred changed = rough();
  changed.frames = 171;
  write_blurred(path("in.h5"), changed);
  EXPECT_NE(bolo(in_blocks({})).err.find("/captures/0/"), std::string::npos);
}

class DeblurMany : public DeblurBlocks {
 protected:
  void SetUp() override {
    fs::create_directory(path("archive"));
    write_blurred(path("archive/a.h5"), rough());
    Blurred other = rough();
    other.frames = 60;
    other.lost = {};
    write_blurred(path("archive/b.h5"), other);
    other.type = PixelType::kFloat32;
    other.scale = {Unit::kKelvin, 1.0, 0.0};
    write_blurred(path("archive/c.h5"), other);
  }
};

TEST_F(DeblurMany, AFolderOfCapturesBecomesAFolder) {
  const json summary = done({path("archive"), "-o", path("sharp"), "--block", "50"});
  EXPECT_EQ(summary.at("captures").size(), 3U);
  std::uint64_t frames = 0;
  for (const char* name : {"a", "b", "c"}) {
    const std::string file = std::string(name) + ".h5";
    (void)done({path("archive/" + file), "-o", path("one-" + file)});
    expect_identical("one-" + file, "sharp/" + file);
  }
  for (const json& capture : summary.at("captures")) frames += capture.at("frames_out").get<std::uint64_t>();
  EXPECT_EQ(summary.at("frames_out"), frames);
  EXPECT_TRUE(fs::exists(path("sharp.job/plan.json")));
}

TEST_F(DeblurMany, OneBadCaptureDoesNotStopTheOthers) {
  {
    fs::remove(path("archive/b.h5"));
    const auto info = capture::CaptureReader::open(path("archive/c.h5"))->info();
    auto writer = capture::CaptureWriter::create(path("archive/b.h5"), info);
    std::vector<float> plane(info.format.geometry.pixels(), 300.0F);
    for (std::size_t i = 0; i < 60; ++i) {
      if (i == 40) plane[7] = std::numeric_limits<float>::quiet_NaN();
      ASSERT_TRUE(writer->append(static_cast<double>(i) * test::kPeriod, i, plane.data()));
    }
    ASSERT_TRUE(writer->close());
  }
  const Outcome outcome = bolo({path("archive"), "-o", path("sharp"), "--block", "25", "--json"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_NE(outcome.err.find("b.h5: frame 40, column 7, row 0 of /frames is nan"), std::string::npos) << outcome.err;
  const json summary = json::parse(outcome.out);
  EXPECT_EQ(summary.at("captures").size(), 2U);
  ASSERT_EQ(summary.at("failed").size(), 1U);
  EXPECT_EQ(summary.at("failed")[0].at("piece"), "c00001-block-00001");
  EXPECT_TRUE(fs::exists(path("sharp/a.h5")));
  EXPECT_FALSE(fs::exists(path("sharp/b.h5")));
  EXPECT_TRUE(fs::exists(path("sharp/c.h5")));
}

TEST_F(DeblurMany, WhatCannotBeIsRefusedInOneLine) {
  struct Refusal {
    Words words;
    const char* said;
  };
  fs::create_directory(path("empty"));
  fs::create_directory(path("more"));
  fs::copy(path("archive/a.h5"), path("more/a.h5"));
  const std::string a = path("archive/a.h5");
  const Refusal refusals[] = {
      {{a, path("archive/b.h5"), "-o", path("out.h5")}, "need a folder"},
      {{a, path("more/a.h5"), "-o", path("sharp")}, "another capture would also become"},
      {{path("archive"), "-o", path("archive")}, "both read and written"},
      {{path("empty"), "-o", path("sharp")}, "no captures"},
      {{a, "-o", path("out.h5"), "--block", "-1"}, "--block -1"},
      {{a, "-o", path("out.h5"), "--shard", "2"}, "--shard '2'"},
      {{a, "-o", path("out.h5"), "--block", "9", "--rank-timeout", "0"}, "--rank-timeout"},
      {{a, path("none.h5"), "-o", path("sharp")}, "none.h5"},
      {{a, "-o", path("out.h5"), "--job", path("archive/b.h5")}, "cannot be made a folder"},
  };
  for (const Refusal& refusal : refusals) {
    const Outcome outcome = bolo(refusal.words);
    EXPECT_EQ(outcome.exit_code, 2) << refusal.said;
    EXPECT_NE(outcome.err.find(refusal.said), std::string::npos) << outcome.err;
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
  }
}

TEST_F(DeblurMany, AJobOnAnotherFileSystemIsRefused) {
  struct stat one {};
  struct stat other {};
  if (::stat(folder_.c_str(), &one) != 0 || ::stat("/dev/shm", &other) != 0 || one.st_dev == other.st_dev) {
    GTEST_SKIP() << "/dev/shm is no other file system here";
  }
  const fs::path job = "/dev/shm/bolo-test-job-" + folder_.filename().string();
  const Outcome outcome = bolo({path("archive"), "-o", path("sharp"), "--job", job.string()});
  fs::remove_all(job);
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_NE(outcome.err.find("same file system"), std::string::npos) << outcome.err;
}

}  // namespace
}  // namespace bolo::tools
