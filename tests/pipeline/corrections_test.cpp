// Corrections within the pipeline.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <vector>

#include "src/pipeline/pipeline.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline::corrections_test {
namespace {

std::vector<test::MemorySink::Frame> published(test::Script script, const model::Undo& undo) {
  PipelineOptions options;
  options.undo = undo;
  test::MemorySink sink;
  auto pipeline = Pipeline::create(std::make_unique<test::ScriptedSource>(std::move(script)), {&sink}, options);
  EXPECT_TRUE(pipeline) << pipeline.error().message;
  const std::atomic<bool> never{false};
  EXPECT_TRUE((*pipeline)->run(never));
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

// A filter that is undone leaves what the solver makes of the frames before the filter, but for rounding to counts.
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

}  // namespace
}  // namespace bolo::pipeline::corrections_test
