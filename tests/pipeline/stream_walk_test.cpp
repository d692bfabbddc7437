// Pieces of a stream, each deblurred by a pipeline of its own, are the whole stream deblurred by one: every bit of
// every frame, and its flags, whatever is lost, repeated, or begins anew, and wherever the cuts are.
#include "src/pipeline/stream_walk.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "src/pipeline/pipeline.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline {
namespace {

using test::MemorySink;
using test::Script;
using test::ScriptedFrame;
using test::ScriptedSource;

constexpr int kWidth = 24;
constexpr int kHeight = 11;

struct Case {
  const char* name;
  bool remembers;
  std::function<void(PipelineOptions&)> set;
};

model::PixelMaps maps() {
  model::PixelMaps maps;
  for (int i = 0; i < kWidth * kHeight; ++i) {
    maps.tau_s.push_back(0.010F + 2e-5F * static_cast<float>(i % 90));
    maps.gain.push_back(1.0F + 1e-3F * static_cast<float>(i % 7));
    maps.dead.push_back(i % 31 == 5 ? 1 : 0);
  }
  return maps;
}

std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

const std::vector<Case>& cases() {
  using deblur::Method;
  static const std::vector<Case> all{
      {"admm", false, [](PipelineOptions&) {}},
      {"look_ahead", false, [](PipelineOptions& o) { o.deblur.lookahead = 2; }},
      {"dual", false, [](PipelineOptions& o) { o.deblur.method = Method::kDual; }},
      {"exact", false, [](PipelineOptions& o) { o.deblur.method = Method::kExact; }},
      {"short_window", false, [](PipelineOptions& o) { o.deblur.window = 9; }},
      {"given_noise", false,
       [](PipelineOptions& o) {
         o.deblur.auto_lambda = true;
         o.deblur.noise_k = 0.03;
       }},
      {"auto_lambda", true, [](PipelineOptions& o) { o.deblur.auto_lambda = true; }},
      {"mmae", true, [](PipelineOptions& o) { o.deblur.method = Method::kMmae; }},
      {"mmae_look_ahead", true,
       [](PipelineOptions& o) {
         o.deblur.method = Method::kMmae;
         o.deblur.lookahead = 1;
       }},
      {"motion", true, [](PipelineOptions& o) { o.deblur.method = Method::kMotion; }},
      {"recursive_filter", true,
       [](PipelineOptions& o) {
         o.undo.filter = model::FrameFilter::kRecursive;
         o.undo.filter_weight = 0.7;
       }},
      {"box_filter", true,
       [](PipelineOptions& o) {
         o.undo.filter = model::FrameFilter::kBox;
         o.undo.filter_weight = 0.8;
       }},
      {"slow_pole", true, [](PipelineOptions& o) { o.undo.slow_share = 0.1; }},
      {"flicker_and_jumps", true,
       [](PipelineOptions& o) {
         o.undo.flicker_k = 0.04;
         o.undo.follow_jumps = true;
       }},
      {"repeated_frames", false, [](PipelineOptions& o) { o.undo.drop_repeated = true; }},
      {"maps", true, [](PipelineOptions& o) { o.maps = maps(); }},
      {"everything", true,
       [](PipelineOptions& o) {
         o.maps = maps();
         o.maps.row_delay_s = 1e-4;
         o.undo.filter = model::FrameFilter::kBox;
         o.undo.filter_weight = 0.8;
         o.undo.slow_share = 0.1;
         o.undo.flicker_k = 0.04;
         o.undo.drop_repeated = true;
         o.undo.coupling = 0.02;
         o.undo.radiance = true;
         o.deblur.method = Method::kMmae;
         o.deblur.lookahead = 1;
       }},
  };
  return all;
}

// A stream with everything that happens to streams: lost frames, single and many; jumps longer than a window; breaks;
// frames that are the one before.
Script rough_stream(std::uint32_t seed) {
  std::mt19937 random(seed);
  Script script;
  script.info = test::small_source(kWidth, kHeight);
  script.frames.clear();
  std::uint64_t id = 1000;
  for (int i = 0; i < 150; ++i) {
    const auto die = random() % 100;
    id += die < 8 ? 2 : die < 10 ? 5 : die < 11 ? 40 : 1;
    script.frames.push_back({id, die >= 98});
  }
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    const std::uint64_t own = slot.meta.frame_id;
    const bool repeats = own % 13 == 4;  // shows what the one before showed
    std::mt19937 noise(static_cast<std::uint32_t>(own - (repeats ? 1 : 0)));
    if (repeats) --slot.meta.frame_id;
    test::fill_moving_bar(slot, format);
    slot.meta.frame_id = own;
    const std::size_t pixels = format.geometry.pixels();
    const auto flicker = static_cast<std::uint16_t>(noise() % 6);
    for (std::size_t p = 0; p < pixels; ++p) slot.u16()[p] += static_cast<std::uint16_t>(noise() % 7 + flicker);
  };
  return script;
}

void expect_same(const MemorySink::Frame& one, const MemorySink::Frame& other) {
  ASSERT_EQ(one.meta.frame_id, other.meta.frame_id);
  EXPECT_EQ(one.meta.flags, other.meta.flags) << one.meta.frame_id;
  EXPECT_TRUE(one.deblurred == other.deblurred) << one.meta.frame_id;
}

// What a walk from `from` (with the state there) says of a run that begins at `mark`.
std::string walked(const Script& script, PipelineOptions options, std::size_t from, std::string state,
                   std::size_t mark) {
  options.resume = std::move(state);
  auto walk = StreamWalk::create(options, script.info.format);
  if (!walk) throw std::runtime_error(walk.error().message);
  std::vector<std::byte> plane(plane_bytes(script.info.format.geometry, script.info.format.type));
  for (std::size_t i = from; i < script.frames.size(); ++i) {
    if (i == mark) (*walk)->mark();
    const ScriptedFrame& frame = script.frames[i];
    rt::FrameSlot slot;
    slot.data = plane.data();
    slot.meta.frame_id = frame.id;
    slot.meta.camera_ns = static_cast<std::int64_t>(frame.id) * test::kPeriodNs;
    script.fill(slot, script.info.format);
    (*walk)->step(slot.meta, slot.data, frame.restart);
    if ((*walk)->marked()) break;
  }
  return (*walk)->state();
}

class Pieces : public testing::TestWithParam<Case> {
 protected:
  PipelineOptions options() const {
    PipelineOptions options;
    options.workers = 1;
    options.output = PixelType::kFloat32;
    GetParam().set(options);
    return options;
  }

  // Frames [first, end) by a pipeline of their own.
  std::vector<MemorySink::Frame> piece(const Script& script, PipelineOptions options, std::size_t begin,
                                       std::size_t first, std::size_t end) const {
    const auto behind = static_cast<std::size_t>(options.deblur.lookahead > 0 ? 3 * options.deblur.window : 0);
    Script part = script;
    const std::size_t stop = std::min(end + behind, script.frames.size());
    part.frames.assign(script.frames.begin() + static_cast<std::ptrdiff_t>(begin),
                       script.frames.begin() + static_cast<std::ptrdiff_t>(stop));
    MemorySink sink;
    play(part, sink, options);
    std::vector<MemorySink::Frame> wanted;
    for (MemorySink::Frame& frame : sink.frames) {
      if (frame.meta.frame_id >= script.frames[first].id && frame.meta.frame_id <= script.frames[end - 1].id) {
        wanted.push_back(std::move(frame));
      }
    }
    return wanted;
  }
};

TEST_P(Pieces, AreTheWhole) {
  for (std::uint32_t seed = 1; seed <= 3; ++seed) {
    const Script script = rough_stream(seed);
    const PipelineOptions options = this->options();
    MemorySink whole;
    play(script, whole, options);
    const auto halo = static_cast<std::size_t>(halo_frames(options));

    std::mt19937 random(seed);
    std::vector<MemorySink::Frame> joined;
    std::string state;
    std::size_t state_at = 0;
    for (std::size_t first = 0; first < script.frames.size();) {
      const std::size_t end = std::min(first + 1 + random() % 50, script.frames.size());
      const std::size_t begin = first > halo ? first - halo : 0;
      PipelineOptions own = options;
      if (GetParam().remembers && begin > 0) {
        state = walked(script, options, state_at, state, begin);
        state_at = begin;
        own.resume = state;
      }
      for (auto& frame : piece(script, own, begin, first, end)) joined.push_back(std::move(frame));
      first = end;
    }
    ASSERT_EQ(joined.size(), whole.frames.size()) << "seed " << seed;
    for (std::size_t i = 0; i < joined.size(); ++i) expect_same(joined[i], whole.frames[i]);
  }
}

TEST_P(Pieces, NeedAStateOnlyWhereMoreThanTheWindowIsRemembered) {
  const auto needed = remembers(options(), test::small_source(kWidth, kHeight).format);
  ASSERT_TRUE(needed);
  EXPECT_EQ(*needed, GetParam().remembers);
}

// Without the state, what is remembered is missing: the test above can tell.
TEST_P(Pieces, DifferWithoutTheStateJustWhereItIsNeeded) {
  const Script script = rough_stream(1);
  MemorySink whole;
  play(script, whole, options());
  bool differ = false;
  for (std::size_t first = 40; first + 1 < script.frames.size() && !differ; first += 5) {
    const auto begin = first - static_cast<std::size_t>(halo_frames(options()));
    for (const MemorySink::Frame& frame : piece(script, options(), begin, first, first + 1)) {
      const auto same = std::ranges::find(whole.frames, frame.meta.frame_id,
                                          [](const MemorySink::Frame& f) { return f.meta.frame_id; });
      differ = differ || same == whole.frames.end() || same->deblurred != frame.deblurred;
    }
  }
  EXPECT_EQ(differ, GetParam().remembers);
}

INSTANTIATE_TEST_SUITE_P(OfStreams, Pieces, testing::ValuesIn(cases()),
                         [](const testing::TestParamInfo<Case>& one) { return std::string(one.param.name); });

TEST(StreamWalk, AStateOfOtherOptionsIsRefused) {
  const Script script = rough_stream(1);
  PipelineOptions options;
  options.undo.slow_share = 0.1;
  const std::string state = walked(script, options, 0, {}, 30);
  options.undo.follow_jumps = true;
  options.resume = state;
  const auto walk = StreamWalk::create(options, script.info.format);
  ASSERT_FALSE(walk);
  EXPECT_EQ(walk.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(walk.error().message.find("other options"), std::string::npos) << walk.error().message;
  options.undo.follow_jumps = false;
  options.resume = state.substr(0, state.size() / 2);
  EXPECT_FALSE(StreamWalk::create(options, script.info.format));
}

}  // namespace
}  // namespace bolo::pipeline
