// Deblurred planes bit for bit: equal to the solver's, for any number of workers and for parts; other value types.
#include "src/pipeline/convert.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tests/pipeline/fakes.hpp"
#include "tests/refusal.hpp"

namespace bolo::pipeline::pipeline_bits_test {

using namespace test;

constexpr std::uint64_t kWarmUp = 16;

// The pipeline does not change the solver's result for a window.
TEST(Pipeline, FullFramesAreTheSolversOwn) {
  MemorySink sink;
  play({}, {&sink}, {.output = PixelType::kFloat32});
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = kWarmUp; i < 40; ++i) {
    EXPECT_EQ(sink.frames[i].deblurred, solved(sink.frames, i, {}, PixelType::kFloat32)) << i;
  }
}

// Compares with `options`, which are for one worker.
void expect_the_same_bits(const Script& script, PipelineOptions options, const std::vector<int>& numbers_of_workers) {
  MemorySink expected;
  play(script, {&expected}, options);
  for (const int workers : numbers_of_workers) {
    options.workers = workers;
    MemorySink sink;
    play(script, {&sink}, options);
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
  expect_the_same_bits(script, {.output = output, .workers = 1}, {2, 3, 9});  // 9: more than the 7 rows
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
  // All maps, so that pixels depend on their neighbours.
  static PipelineOptions options() {
    PipelineOptions options{.deblur = {.method = GetParam()}, .output = PixelType::kFloat32, .workers = 1};
    for (std::size_t i = 0; i < test::small_source().format.geometry.pixels(); ++i) {
      options.maps.tau_s.push_back(0.010F + 2e-5F * static_cast<float>(i % 90));
      options.maps.gain.push_back(1.0F + 1e-3F * static_cast<float>(i % 7));
      options.maps.dead.push_back(i % 11 == 5 ? 1 : 0);
    }
    options.maps.row_delay_s = 1e-4;
    return options;
  }
};

TEST_P(PipelinePixels, ARegionAndPointsAreTheWholeFramesBits) {
  const Geometry geometry = test::small_source().format.geometry;
  const auto width = static_cast<std::size_t>(geometry.width);
  Script script;
  script.frames.erase(script.frames.begin() + 30);  // a lost frame
  MemorySink whole;
  play(script, {&whole}, options());
  const Region region{3, 1, 17, 5};
  std::vector<std::uint32_t> points;
  for (std::uint32_t i = 0; i < 300; ++i) points.push_back(i * 59 % static_cast<std::uint32_t>(geometry.pixels()));
  for (const int workers : {1, 2, 3}) {
    PipelineOptions few = options();
    few.workers = workers;
    few.region = region;
    MemorySink of_region;
    play(script, {&of_region}, few);
    few.region.reset();
    few.points = points;
    MemorySink of_points;
    play(script, {&of_points}, few);
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

// Large enough for workers to share the preparation before they solve.
TEST(Pipeline, MotionGivesTheSameBitsWithAnyWorkers) {
  const PipelineOptions options{.deblur = {.method = deblur::Method::kMotion}, .workers = 1};
  expect_the_same_bits({.info = test::small_source(96, 72)}, options, {3});
}

TEST(Pipeline, PixelsOutsideTheFrameAreRefused) {
  MemorySink sink;
  for (const Region& region : {Region{0, 0, 25, 1}, Region{-1, 0, 3, 3}, Region{0, 5, 3, 3}, Region{0, 0, 0, 1}}) {
    expect_refused(create({}, {&sink}, {.region = region}), {"not inside the frame of 24x7"});
  }
  EXPECT_FALSE(create({}, {&sink}, {.points = {0, 168}}));
}

std::vector<test::MemorySink::Frame> published(test::Script script, const model::Undo& undo) {
  test::MemorySink sink;
  test::play(std::move(script), {&sink}, {.undo = undo});
  return std::move(sink.frames);
}

TEST(PipelineCorrections, PublishesRawFramesAsTheyCame) {
  const auto plain = published({}, {});
  const auto undone =
      published({}, {.filter = model::FrameFilter::kRecursive, .filter_weight = 0.7, .emissivity = 0.95});
  ASSERT_EQ(plain.size(), undone.size());
  for (std::size_t i = 0; i < plain.size(); ++i) {
    EXPECT_EQ(plain[i].raw, undone[i].raw) << i;
    EXPECT_NE(plain[i].deblurred, undone[i].deblurred) << i;
  }
}

// With the filter undone, the result is that of the frames before the filter, except for rounding to counts.
TEST(PipelineCorrections, SeesThroughAFilter) {
  constexpr double kWeight = 0.75;
  test::Script script;
  std::vector<double> before;
  script.fill = [&before](rt::FrameSlot& slot, const StreamFormat& format) {
    test::fill_moving_bar(slot, format);
    if (before.empty()) before.assign(slot.u16(), slot.u16() + format.geometry.pixels());
    for (std::size_t p = 0; p < before.size(); ++p) {
      before[p] = kWeight * slot.u16()[p] + (1.0 - kWeight) * before[p];
      slot.u16()[p] = static_cast<std::uint16_t>(std::lround(before[p]));
    }
  };
  const auto wanted = published({}, {});
  const auto seen = published(script, {.filter = model::FrameFilter::kRecursive, .filter_weight = kWeight});
  ASSERT_EQ(wanted.size(), seen.size());
  double squares = 0.0;
  double count = 0.0;
  for (std::size_t i = 20; i < wanted.size(); ++i) {
    const auto* a = reinterpret_cast<const std::uint16_t*>(wanted[i].deblurred.data());
    const auto* b = reinterpret_cast<const std::uint16_t*>(seen[i].deblurred.data());
    for (std::size_t p = 0; p < before.size(); ++p, ++count) squares += std::pow(double{1.0} * a[p] - b[p], 2);
  }
  EXPECT_LT(std::sqrt(squares / count), 2.0) << "counts; the bar is 900 high";
}

TEST(PipelineCorrections, RepeatedFramesCountAsLost) {
  test::Script script;
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    const std::uint64_t id = slot.meta.frame_id;
    slot.meta.frame_id = id == 25 ? 24 : id;
    test::fill_moving_bar(slot, format);
    slot.meta.frame_id = id;
  };
  const auto kept = published(script, {});
  const auto dropped = published(script, {.drop_repeated = true});
  EXPECT_EQ(kept.size(), dropped.size() + 1);
  const auto gap = std::find_if(dropped.begin(), dropped.end(), [](const auto& f) { return f.meta.frame_id == 26; });
  ASSERT_NE(gap, dropped.end());
  EXPECT_NE(gap->meta.flags & kFlagGap, 0U);
}

template <typename To, typename From>
std::vector<To> converted(const std::vector<From>& row, LinearScale scale) {
  const auto type_of = [](auto value) {
    return std::is_same_v<decltype(value), float> ? PixelType::kFloat32 : PixelType::kUint16;
  };
  std::vector<To> out(row.size());
  convert({.type = type_of(From{}), .scale = scale}, row.data(), type_of(To{}), out.data(), {0, row.size()});
  return out;
}

using Counts = std::vector<std::uint16_t>;
using Floats = std::vector<float>;
constexpr LinearScale kTenMk{Unit::kKelvin, 0.01, 0.0};

TEST(Convert, CountsStayCountsAndBecomeKelvinByScaleAndOffset) {
  const Counts raw{0, 1, 30'000, 65'535};
  EXPECT_EQ(converted<std::uint16_t>(raw, kTenMk), raw);
  const Floats kelvin = converted<float>(raw, {Unit::kKelvin, 0.01, -5.0});
  EXPECT_FLOAT_EQ(kelvin[0], -5.0F);
  EXPECT_FLOAT_EQ(kelvin[2], 295.0F);
  EXPECT_EQ(converted<float>(Counts{7, 16'383}, {Unit::kCount, 3.0, 1.0}), (Floats{7.0F, 16'383.0F})) << "no kelvin";
}

TEST(Convert, FloatsAreRoundedAndClampedToUint16) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const Floats raw{-3.0F, 0.4F, 0.6F, 65'534.6F, 70'000.0F, std::nanf(""), kInf, -kInf};
  EXPECT_EQ(converted<std::uint16_t>(raw, {Unit::kKelvin, 1.0, 0.0}), (Counts{0, 0, 1, 65'535, 65'535, 0, 65'535, 0}));
}

TEST(Convert, TouchesItsRangeOnly) {
  const Counts raw{1, 2, 3, 4};
  Counts out{9, 9, 9, 9};
  convert({.scale = kTenMk}, raw.data(), PixelType::kUint16, out.data(), {1, 3});
  EXPECT_EQ(out, (Counts{9, 2, 3, 9}));
}

TEST(Saturated, SeesATopValueAnywhereInTheRangeAndNowhereElse) {
  for (const std::size_t size : {1U, 63U, 64U, 65U, 200U}) {
    std::vector<std::uint16_t> raw(size, 65'534);
    EXPECT_FALSE(saturated(PixelType::kUint16, raw.data(), {0, size}));
    for (std::size_t i = 0; i < size; ++i) {
      raw[i] = 65'535;
      EXPECT_TRUE(saturated(PixelType::kUint16, raw.data(), {0, size})) << i << " of " << size;
      EXPECT_FALSE(saturated(PixelType::kUint16, raw.data(), {0, i}));
      EXPECT_FALSE(saturated(PixelType::kUint16, raw.data(), {i + 1, size}));
      raw[i] = 65'534;
    }
  }
}

}  // namespace bolo::pipeline::pipeline_bits_test
