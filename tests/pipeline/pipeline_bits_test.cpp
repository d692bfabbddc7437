// The deblurred planes bit for bit: the solver's own, with any number of workers, and of parts as of the whole.
#include <gtest/gtest.h>

#include <cstring>

#include "src/deblur/solver.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline::pipeline_bits_test {
namespace {

using namespace test;

constexpr int kWindow = 17;
constexpr std::uint64_t kWarmUp = kWindow - 1;

// The pipeline adds nothing to what the solver makes of the same window.
TEST(Pipeline, FullFramesAreTheSolversOwn) {
  MemorySink sink;
  PipelineOptions options = with_workers(2);
  options.output = PixelType::kFloat32;
  play({}, sink, options);
  ASSERT_EQ(sink.frames.size(), 40U);
  auto solver = deblur::Solver::create(options.deblur, test::small_source().format, PixelType::kFloat32);
  ASSERT_TRUE(solver) << solver.error().message;
  for (std::size_t i = kWarmUp; i < 40; ++i) {
    std::vector<const void*> planes;
    for (std::size_t k = i - kWarmUp; k <= i; ++k) planes.push_back(sink.frames[k].raw.data());
    const deblur::WindowView window{planes, kWindow - 1};
    std::vector<std::byte> expected(sink.frames[i].deblurred.size());
    (*solver)->prepare(window);
    const Geometry whole = test::small_source().format.geometry;
    (*solver)->solve(window, {0, 0, whole.width, whole.height}, expected.data());
    EXPECT_EQ(sink.frames[i].deblurred, expected) << i;
  }
}

// `options` are those of one worker.
void expect_the_same_bits(const Script& script, PipelineOptions options, const std::vector<int>& numbers_of_workers) {
  MemorySink expected;
  play(script, expected, options);
  for (const int workers : numbers_of_workers) {
    options.workers = workers;
    MemorySink sink;
    play(script, sink, options);
    ASSERT_EQ(sink.frames.size(), expected.frames.size());
    for (std::size_t i = 0; i < sink.frames.size(); ++i) {
      ASSERT_EQ(sink.frames[i].deblurred, expected.frames[i].deblurred) << workers << " workers, frame " << i;
    }
  }
}

class PipelineTypes : public testing::TestWithParam<std::tuple<PixelType, PixelType>> {};

TEST_P(PipelineTypes, TheNumberOfWorkersChangesNoBit) {
  const auto [input, output] = GetParam();
  Script script;
  script.info.format.type = input;
  if (input == PixelType::kFloat32) script.info.format.scale = {Unit::kKelvin, 1.0, 0.0};
  PipelineOptions options = with_workers(1);
  options.output = output;
  expect_the_same_bits(script, options, {2, 3, 9});  // 9: more than the 7 rows
}

INSTANTIATE_TEST_SUITE_P(All, PipelineTypes,
                         testing::Values(std::tuple{PixelType::kUint16, PixelType::kUint16},
                                         std::tuple{PixelType::kUint16, PixelType::kFloat32},
                                         std::tuple{PixelType::kFloat32, PixelType::kFloat32}));

float value_of(const std::vector<std::byte>& plane, std::size_t i) {
  float value = 0.0F;
  std::memcpy(&value, plane.data() + i * sizeof value, sizeof value);
  return value;
}

class PipelinePixels : public testing::TestWithParam<deblur::Method> {
 protected:
  // Maps of everything, so that pixels depend on their surroundings.
  static PipelineOptions options() {
    PipelineOptions options = with_workers(1);
    options.deblur.method = GetParam();
    options.output = PixelType::kFloat32;
    for (std::size_t i = 0; i < test::small_source().format.geometry.pixels(); ++i) {
      options.maps.tau_s.push_back(0.010F + 2e-5F * static_cast<float>(i % 90));
      options.maps.dead.push_back(i % 11 == 5 ? 1 : 0);
    }
    options.maps.row_delay_s = 1e-4;
    return options;
  }
};

TEST_P(PipelinePixels, ARegionAndPointsAreTheWholeFramesBits) {
  const Geometry geometry = test::small_source().format.geometry;
  const auto width = static_cast<std::size_t>(geometry.width);
  MemorySink whole;
  play({}, whole, options());
  const Region region{3, 1, 17, 5};
  std::vector<std::uint32_t> points;
  for (std::uint32_t i = 0; i < 300; ++i) points.push_back(i * 59 % static_cast<std::uint32_t>(geometry.pixels()));
  for (const int workers : {1, 2, 3}) {
    PipelineOptions few = options();
    few.workers = workers;
    few.region = region;
    MemorySink of_region;
    play({}, of_region, few);
    few.region.reset();
    few.points = points;
    MemorySink of_points;
    play({}, of_points, few);
    ASSERT_EQ(of_region.frames.size(), whole.frames.size());
    ASSERT_EQ(of_points.frames.size(), whole.frames.size());
    EXPECT_EQ(of_points.format.points, points);
    EXPECT_EQ(of_region.format.region, region);
    for (std::size_t n = 0; n < whole.frames.size(); ++n) {
      const std::vector<std::byte>& all = whole.frames[n].deblurred;
      for (std::size_t i = 0; i < points.size(); ++i) {
        ASSERT_EQ(value_of(of_points.frames[n].deblurred, i), value_of(all, points[i])) << n << " " << i;
      }
      for (std::size_t i = 0; i < geometry.pixels(); ++i) {
        const int x = static_cast<int>(i % width);
        const int y = static_cast<int>(i / width);
        const bool inside =
            x >= region.x && x < region.x + region.width && y >= region.y && y < region.y + region.height;
        ASSERT_EQ(value_of(of_region.frames[n].deblurred, i), inside ? value_of(all, i) : 0.0F) << n << " " << i;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, PipelinePixels,
                         testing::Values(deblur::Method::kAdmm, deblur::Method::kDual, deblur::Method::kExact,
                                         deblur::Method::kInverse, deblur::Method::kMmae, deblur::Method::kMotion),
                         [](const auto& each) { return std::string(deblur::name(each.param)); });

// Its picture is large enough for workers to share what is done before they solve.
TEST(Pipeline, MotionGivesTheSameBitsWithAnyWorkers) {
  Script script;
  script.info = test::small_source(96, 72);
  PipelineOptions options = with_workers(1);
  options.deblur.method = deblur::Method::kMotion;
  expect_the_same_bits(script, options, {2, 3, 5});
}

TEST(Pipeline, PixelsOutsideTheFrameAreRefused) {
  for (const Region& region : {Region{0, 0, 25, 1}, Region{-1, 0, 3, 3}, Region{0, 5, 3, 3}, Region{0, 0, 0, 1}}) {
    PipelineOptions options = with_workers(1);
    options.region = region;
    MemorySink sink;
    const auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&sink}, options);
    ASSERT_FALSE(pipeline);
    EXPECT_NE(pipeline.error().message.find("not inside the frame of 24x7"), std::string::npos);
  }
  PipelineOptions options = with_workers(1);
  options.points = {0, 168};
  MemorySink sink;
  EXPECT_FALSE(Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&sink}, options));
}

}  // namespace
}  // namespace bolo::pipeline::pipeline_bits_test
