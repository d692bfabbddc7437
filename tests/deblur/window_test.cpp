#include "src/deblur/window.hpp"
#include "tests/test.hpp"

namespace bolo::deblur::window_test {

constexpr std::int64_t kPeriodNs = 5'000'000;

struct Shown {
  std::uint64_t id = 0;
  bool full = false;
  std::uint32_t flags = 0;
  std::vector<std::int64_t> window;  // frame ids, oldest first; -1 where a frame was lost
};

// Plays the pipeline's part; checks that each buffer is returned exactly once and never before its frame was shown.
class Player {
 public:
  explicit Player(int window = 5, int lookahead = 0) : window_(settings(window, lookahead)), planes_(4096) {}

  // Adds frame `id` at its nominal time. True when the window was emptied.
  bool frame(std::uint64_t id, bool restart = false) { return frame_at(id, static_cast<double>(id), restart); }

  void frames(std::initializer_list<std::uint64_t> ids) {
    for (const std::uint64_t id : ids) frame(id);
  }
  void run(std::uint64_t begin, std::uint64_t end) {
    for (std::uint64_t id = begin; id < end; ++id) frame(id);
  }

  bool frame_at(std::uint64_t id, double periods, bool restart = false) {
    WindowFrame f;
    f.meta.frame_id = id;
    f.meta.camera_ns = static_cast<std::int64_t>(periods * static_cast<double>(kPeriodNs));
    f.token = next_token_++;
    f.plane = &planes_[f.token];
    ids_.push_back(static_cast<std::int64_t>(id));
    held_.insert(f.token);
    EXPECT_LE(held_.size(), static_cast<std::size_t>(window_.slots()));
    const bool emptied = window_.push(f, restart);
    collect();
    return emptied;
  }

  void finish() {
    window_.finish();
    collect();
  }
  void set_period(double periods) { window_.set_period(periods * static_cast<double>(kPeriodNs) * 1e-9); }

  void expect_last(const std::vector<std::int64_t>& window, std::uint32_t flags) const {
    EXPECT_EQ(shown_.back().window, window);
    EXPECT_EQ(shown_.back().flags, flags);
  }

  const std::vector<Shown>& shown() const { return shown_; }
  const std::set<std::uint32_t>& held() const { return held_; }
  std::vector<std::uint64_t> ids() const {
    std::vector<std::uint64_t> ids;
    for (const Shown& s : shown_) ids.push_back(s.id);
    return ids;
  }

 private:
  static Settings settings(int window, int lookahead) {
    return {.period_s = static_cast<double>(kPeriodNs) * 1e-9, .window = window, .lookahead = lookahead};
  }

  void collect() {
    Window::Ready ready;
    while (window_.next(ready)) {
      EXPECT_TRUE(held_.contains(ready.frame.token)) << "shown after its memory was given back";
      Shown s{ready.frame.meta.frame_id, ready.full, ready.frame.meta.flags, {}};
      for (const void* plane : ready.view.planes) {
        s.window.push_back(
            plane == nullptr ? -1 : ids_[static_cast<std::size_t>(static_cast<const char*>(plane) - planes_.data())]);
      }
      EXPECT_EQ(ready.view.planes[static_cast<std::size_t>(ready.view.target)], ready.frame.plane);
      shown_.push_back(s);
    }
    for (const std::uint32_t token : window_.released()) {
      EXPECT_EQ(held_.erase(token), 1U) << "given back twice";
    }
  }

  Window window_;
  std::vector<char> planes_;
  std::vector<std::int64_t> ids_;
  std::set<std::uint32_t> held_;
  std::vector<Shown> shown_;
  std::uint32_t next_token_ = 0;
};

TEST(Window, ALostFrameLeavesItsPlaceEmptyAndShiftsNothing) {
  Player player(5);
  player.frames({0, 1, 2, 3, 4, 6, 7, 8, 9, 10});
  EXPECT_EQ(player.ids(), (std::vector<std::uint64_t>{0, 1, 2, 3, 4, 6, 7, 8, 9, 10}));
  const Shown& after_gap = player.shown()[5];
  EXPECT_TRUE(after_gap.full);
  EXPECT_EQ(after_gap.flags, kFlagGap);
  EXPECT_EQ(after_gap.window, (std::vector<std::int64_t>{2, 3, 4, -1, 6}));
  EXPECT_EQ(player.shown()[8].window, (std::vector<std::int64_t>{-1, 6, 7, 8, 9}));
  EXPECT_EQ(player.shown()[9].flags, kFlagNone);
}

TEST(Window, GapsCountTowardsTheSpanOfTheWindow) {
  Player player(5);
  player.frames({0, 1, 4});
  ASSERT_EQ(player.shown().size(), 3U);
  EXPECT_TRUE(player.shown()[2].full);
  EXPECT_EQ(player.shown()[2].window, (std::vector<std::int64_t>{0, 1, -1, -1, 4}));
}

TEST(Window, EmptiesAfterAJumpAsLongAsItself) {
  Player player(5);
  player.run(0, 6);
  EXPECT_FALSE(player.frame(9));
  EXPECT_TRUE(player.frame(14));
  EXPECT_FALSE(player.shown().back().full);
  EXPECT_EQ(player.held().size(), 1U);
}

TEST(Window, EmptiesWhenTimeGoesBack) {
  Player player(5);
  player.run(100, 106);
  EXPECT_TRUE(player.frame(3));
  EXPECT_FALSE(player.frame(4));
  EXPECT_FALSE(player.shown().back().full);
}

TEST(Window, EmptiesOnRequest) {
  Player player(5);
  EXPECT_FALSE(player.frame(0, true)) << "there is nothing to empty";
  player.run(1, 6);
  EXPECT_TRUE(player.frame(6, true));
  for (std::uint64_t id = 7; id < 11; ++id) EXPECT_FALSE(player.frame(id));
  EXPECT_EQ(player.shown().back().window, (std::vector<std::int64_t>{6, 7, 8, 9, 10}));
  EXPECT_TRUE(player.shown().back().full);
}

TEST(Window, TheClockIsTrustedWhenItFitsTheGrid) {
  Player player(5);
  player.run(0, 5);
  player.frame_at(5, 6.0);  // lost frame without a jump in the counter
  player.expect_last({2, 3, 4, -1, 5}, kFlagGap);
  player.frame_at(9, 7.0);  // the counter jumps, the clock does not
  EXPECT_EQ(player.shown().back().window, (std::vector<std::int64_t>{3, 4, -1, 5, 9}));
}

TEST(Window, TheCounterIsTrustedWhenTheClockIsOffTheGrid) {
  Player player(5);
  player.run(0, 5);
  player.frame_at(5, 5.4);
  player.expect_last({1, 2, 3, 4, 5}, kFlagJitter);
  player.frame_at(7, 6.95);  // 1.55 periods later by the clock, 2 by the counter
  player.expect_last({3, 4, 5, -1, 7}, kFlagGap | kFlagJitter);
}

// After a shutter or a reconnect the counter goes on without a jump, and the next frame is off the old time grid.
TEST(Window, APauseLongerThanTheWindowEmptiesItWhateverTheCounterSays) {
  for (const double pause : {40.4, 240.4, 7.6}) {
    Player player(5);
    player.run(0, 6);
    EXPECT_TRUE(player.frame_at(6, 5.0 + pause)) << pause;
    EXPECT_FALSE(player.shown().back().full);
    EXPECT_EQ(player.shown().back().flags, kFlagWarmUp);
    EXPECT_FALSE(player.frame_at(7, 6.0 + pause)) << "the grid goes on from there";
    EXPECT_EQ(player.shown().back().flags, kFlagWarmUp);
  }
}

TEST(Window, AShorterPauseIsAGapAtTheNearestPlace) {
  Player player(5);
  player.run(0, 5);
  EXPECT_FALSE(player.frame_at(5, 4.0 + 2.4));
  player.expect_last({2, 3, 4, -1, 5}, kFlagGap | kFlagJitter);
  player.frame_at(6, 5.0 + 2.4);
  player.expect_last({3, 4, -1, 5, 6}, kFlagGap);
}

// Without a clock, or with one that stands still, only the counter is used.
TEST(Window, AClockThatStandsStillIsNoWitness) {
  Player player(5);
  for (const std::uint64_t id : std::initializer_list<std::uint64_t>{0, 1, 2, 3, 4, 7}) player.frame_at(id, 0.0);
  EXPECT_EQ(player.shown().back().window, (std::vector<std::int64_t>{3, 4, -1, -1, 7}));
}

// Timestamps of a busy host: one in ten would suggest a gap or a step back that never was.
TEST(Window, AClockThatScattersInventsNoGaps) {
  Player player(5);
  std::mt19937 random(1);
  std::normal_distribution<double> late(0.0, 0.4);
  for (std::uint64_t id = 0; id < 400; ++id) {
    EXPECT_FALSE(player.frame_at(id, 100.0 + static_cast<double>(id) + late(random))) << id;
  }
  const auto gap = [](const Shown& s) { return s.id >= 10 && (s.flags & kFlagGap) != 0; };  // scatter known by then
  EXPECT_TRUE(std::ranges::none_of(player.shown(), gap));
  player.frame_at(402, 502.0);
  EXPECT_EQ(player.shown().back().window, (std::vector<std::int64_t>{398, 399, -1, -1, 402}));
  EXPECT_TRUE(player.frame_at(403, 540.0)) << "a pause is beyond scatter";
}

TEST(Window, AClockOfTwoPeriodsATickInventsNoGaps) {
  Player player(5);
  for (std::uint64_t id = 0; id < 100; ++id) player.frame_at(id, 100.0 + static_cast<double>(id / 2 * 2));
  EXPECT_EQ(player.shown().back().window, (std::vector<std::int64_t>{95, 96, 97, 98, 99}));
}

TEST(Window, SmallJitterIsNotFlagged) {
  Player player(5);
  for (std::uint64_t id = 0; id < 12; ++id) player.frame_at(id, static_cast<double>(id) + (id % 2 == 0 ? 0.0 : 0.09));
  for (const Shown& s : player.shown()) EXPECT_EQ(s.flags & kFlagJitter, 0U) << s.id;
}

// 198 frames a second on a grid of 200: each step is off only a little, but always in the same direction.
TEST(Window, AWrongPeriodIsFlaggedFromTheFirstFullWindowUntilItIsMended) {
  for (const double step : {1.0 / 0.99, 1.0 / 1.09, 1.05, 1.004, 1.0}) {
    Player player(17);
    for (std::uint64_t id = 0; id < 60; ++id) player.frame_at(id, 7.3 + step * static_cast<double>(id));
    const bool wrong = std::abs(step - 1.0) > 0.008;
    for (const Shown& s : player.shown()) {
      if (!s.full) continue;
      EXPECT_EQ(s.flags, wrong ? kFlagJitter : kFlagNone) << step << ' ' << s.id;
    }
    player.set_period(step);
    for (std::uint64_t id = 60; id < 100; ++id) player.frame_at(id, 7.3 + step * static_cast<double>(id), id == 60);
    EXPECT_EQ(player.shown().back().flags, kFlagNone) << step;
    EXPECT_EQ(player.shown()[76].flags, kFlagNone) << step;
  }
}

// bolod corrects a period that is wrong by 0.5 % or more.
TEST(Window, APeriodThatIsWrongByWhatIsJustMendedIsFlagged) {
  for (const double step : {1.0055, 1.0 / 1.0055, 1.0048}) {
    Player player(17);
    for (std::uint64_t id = 0; id < 80; ++id) player.frame_at(id, 7.3 + step * static_cast<double>(id));
    EXPECT_EQ(player.shown().back().flags, step == 1.0048 ? kFlagNone : kFlagJitter) << step;
  }
}

TEST(Window, StampsThatJitterAroundARightPeriodAreNoWrongOne) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> late(-0.04, 0.04);
  Player player(17);
  for (std::uint64_t id = 0, lost = 0; id < 4000; ++id) {
    lost += id % 37 == 0 ? 1 : 0;
    player.frame_at(id + lost, static_cast<double>(id + lost) + late(random));
  }
  for (const Shown& s : player.shown()) EXPECT_EQ(s.flags & kFlagJitter, 0U) << s.id;
}

TEST(Window, LookAheadShowsEachFrameLaterWithWhatCameAfterIt) {
  Player player(5, 2);
  player.run(0, 8);
  EXPECT_EQ(player.ids(), (std::vector<std::uint64_t>{0, 1, 2, 3, 4, 5}));
  EXPECT_FALSE(player.shown()[1].full);
  EXPECT_TRUE(player.shown()[2].full);
  EXPECT_EQ(player.shown()[2].window, (std::vector<std::int64_t>{0, 1, 2, 3, 4}));
  EXPECT_EQ(player.shown()[5].window, (std::vector<std::int64_t>{3, 4, 5, 6, 7}));
}

TEST(Window, LookAheadOverAGapShowsEveryWaitingFrameOnce) {
  Player player(5, 2);
  player.frames({0, 1, 2, 3, 4, 5, 8});
  EXPECT_EQ(player.ids(), (std::vector<std::uint64_t>{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(player.shown()[4].window, (std::vector<std::int64_t>{2, 3, 4, 5, -1}));
  EXPECT_EQ(player.shown()[5].window, (std::vector<std::int64_t>{3, 4, 5, -1, -1}));
  player.frame(9);
  player.frame(10);
  EXPECT_EQ(player.shown().back().id, 8U);
  EXPECT_EQ(player.shown().back().window, (std::vector<std::int64_t>{-1, -1, 8, 9, 10}));
}

TEST(Window, ARestartShowsTheFramesThatWaitedFirst) {
  Player player(5, 2);
  player.run(0, 7);
  EXPECT_TRUE(player.frame(7, true));
  EXPECT_EQ(player.ids(), (std::vector<std::uint64_t>{0, 1, 2, 3, 4, 5, 6}));
  EXPECT_FALSE(player.shown()[5].full);
  EXPECT_FALSE(player.shown()[6].full);
  EXPECT_EQ(player.held().size(), 1U);
}

TEST(Window, ShowsEveryFrameOnceWhateverIsLost) {
  for (int lookahead = 0; lookahead <= 3; ++lookahead) {
    Player player(5, lookahead);
    std::uint32_t random = 12345U + static_cast<std::uint32_t>(lookahead);
    std::vector<std::uint64_t> sent;
    std::uint64_t id = 0;
    for (int i = 0; i < 2000; ++i) {
      random = random * 1664525U + 1013904223U;
      const std::uint32_t dice = (random >> 16) % 100;
      id += dice < 80 ? 1 : dice < 95 ? dice - 78 : 1000;
      player.frame(id, dice == 99);
      sent.push_back(id);
    }
    player.finish();
    player.finish();  // finish() is idempotent
    EXPECT_EQ(player.ids(), sent);
    EXPECT_TRUE(player.held().empty());
  }
}

}  // namespace bolo::deblur::window_test
