#include "src/diagnose/fit.hpp"
#include "src/diagnose/stages.hpp"
#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::registration_test {

using testing::noisy_camera;
using testing::odd_chopper;
using testing::record;
using testing::slanted_bars;

constexpr double kFloorK = 0.03;
constexpr double kPeriodPx = 20.0;

// Distance between two phases of the periodic target.
double apart(double a, double b) { return std::abs(a - b - kPeriodPx * std::round((a - b) / kPeriodPx)); }

// Removes frame `lost`; the time stamps go on without a gap.
Recording without_frame(Recording r, int lost) {
  const Series values = r.values;
  const int left = r.frames() - 1;
  r.values.resize(left, values.cols());
  r.values << values.topRows(lost), values.bottomRows(left - lost);
  r.t.pop_back();
  r.used.pop_back();
  return r;
}

struct Registered {
  State state;
  std::vector<double> matched;
};

Registered registered(const Session& session) {
  Registered out{nominal_state(session, {}), {}};
  out.matched = register_stimuli(session, out.state, session.grid.all());
  return out;
}

// Judges the only recording of a session; `state` receives its frame times.
Transport judged(Recording recording, State& state) {
  const Session session = testing::session_of({std::move(recording)});
  state = registered(session).state;
  return judge_transport(session, state, kFloorK, session.grid.all());
}

TEST(RegisterStimuli, FindsThePhaseOfMovingBars) {
  const sim::StimulusError error{.velocity = 0.008, .phase = 0.37};
  for (const double velocity : {70.0, -320.0}) {
    const Session session = testing::session_of({record(noisy_camera(), slanted_bars(velocity), 120, error)});
    const Registered r = registered(session);
    EXPECT_GT(r.matched[0], 0.99);
    for (std::size_t k = 0; k < 120; k += 17) {
      const double truth = 0.37 * kPeriodPx + velocity * 1.008 * session.recordings[0].t[k];
      EXPECT_LT(apart(r.state.stimuli[0].shift_px[k], truth), 0.03) << velocity << " px/s, frame " << k;
      EXPECT_NEAR(r.state.stimuli[0].speed_px_s[k] / velocity, 1.008, 0.006);
    }
  }
}

// Fitting a straight line to a recording's last frames would give the speed at their middle, not at the end.
TEST(RegisterStimuli, FollowsASpeedThatChangesUpToTheEnds) {
  const sim::StimulusError error{.uneven = 0.03, .uneven_phase = 0.4};
  const Session session = testing::session_of({record(noisy_camera(), slanted_bars(-320.0), 120, error)});
  const State state = registered(session).state;
  for (const std::size_t k : {0U, 60U, 119U}) {
    const double truth = 1.0 + 0.03 * std::sin(2.0 * std::numbers::pi * (session.recordings[0].t[k] + 0.4));
    EXPECT_NEAR(state.stimuli[0].speed_px_s[k] / -320.0, truth, 0.005) << "frame " << k;
  }
}

TEST(RegisterStimuli, FindsThePhaseOfAStillTarget) {
  const Session session = testing::session_of({record(noisy_camera(), slanted_bars(0.0), 60, {.phase = 0.81})});
  const Registered r = registered(session);
  EXPECT_GT(r.matched[0], 0.99);
  EXPECT_LT(apart(r.state.stimuli[0].phase_px, 0.81 * kPeriodPx), 0.01);
}

TEST(RegisterStimuli, FindsTheDelayOfAChopper) {
  for (const double start_s : {-0.0043, 0.0, 0.0049}) {
    const Session session = testing::session_of({record(noisy_camera(), odd_chopper(), 240, {.start_s = start_s})});
    const Registered r = registered(session);
    EXPECT_GT(r.matched[0], 0.99);
    EXPECT_NEAR(r.state.stimuli[0].delay_s, start_s, 0.0006);
  }
}

TEST(RegisterStimuli, SaysWhenTheRecordingShowsSomethingElse) {
  Recording wrong = record(noisy_camera(), capture::Uniform{300.0}, 120);
  wrong.stimulus = odd_chopper();
  wrong.kind = Kind::kChopper;
  Recording bars = record(noisy_camera(), capture::Uniform{300.0}, 120);
  bars.stimulus = slanted_bars(70.0);
  bars.kind = Kind::kMovingBars;
  const Registered r = registered(testing::session_of({std::move(wrong), std::move(bars)}));
  EXPECT_LT(r.matched[0], 0.6);
  EXPECT_LT(r.matched[1], 0.6);
}

TEST(JudgeTransport, FindsNothingInRegularRecordings) {
  const Session session = testing::session_of({record(noisy_camera(1), slanted_bars(70.0), 160),
                                               record(noisy_camera(2), slanted_bars(-320.0), 160),
                                               record(noisy_camera(3), odd_chopper(), 240)});
  Registered r = registered(session);
  const Transport t = judge_transport(session, r.state, kFloorK, session.grid.all());
  EXPECT_EQ(t.lost, 0);
  EXPECT_EQ(t.inserted, 0);
  EXPECT_LT(t.jitter_s, 4e-5);
}

TEST(JudgeTransport, FindsALostFrameOfMovingBars) {
  const Session session = testing::session_of({without_frame(record(noisy_camera(), slanted_bars(-320.0), 160), 83)});
  State state;
  const Transport t = judged(session.recordings[0], state);
  EXPECT_EQ(t.lost, 1);
  EXPECT_EQ(t.inserted, 0);
  EXPECT_EQ(state.stimuli[0].late_s[82], 0.0);
  EXPECT_NEAR(state.stimuli[0].late_s[83], 0.005, 1e-9);
  EXPECT_NEAR(state.stimuli[0].late_s[158], 0.005, 1e-9);
  const State plain = without_transport(session, state);
  EXPECT_EQ(plain.stimuli[0].late_s[158], 0.0);
}

// A loss is judged over 60 ms: a slower camera has few frames there, so that one period is a large part of them.
TEST(JudgeTransport, FindsALostFrameOfASlowerCamera) {
  const Recording slow = testing::every(2, record(noisy_camera(), slanted_bars(-320.0), 320));
  Session session = testing::session_of({without_frame(slow, 83)});
  session.period_s *= 2.0;
  State state = registered(session).state;
  EXPECT_EQ(judge_transport(session, state, kFloorK, session.grid.all()).lost, 1);
  EXPECT_NEAR(state.stimuli[0].late_s[158], 0.01, 1e-9);
}

// Up to five losses within a second.
TEST(JudgeTransport, FindsLostFramesOfAChopper) {
  for (const std::vector<int>& lost : {std::vector<int>{100}, {190, 160, 130, 100, 70}}) {
    Recording r = record(noisy_camera(), odd_chopper(), 260);
    for (const int frame : lost) r = without_frame(std::move(r), frame);
    State state;
    const Transport t = judged(std::move(r), state);
    EXPECT_EQ(t.lost, static_cast<int>(lost.size()));
    EXPECT_EQ(t.inserted, 0);
    EXPECT_NEAR(state.stimuli[0].late_s[238], 0.005 * static_cast<double>(lost.size()), 1e-9);
  }
}

// With strong jitter two frames may be a whole period too far apart without a loss.
TEST(JudgeTransport, MeasuresJitter) {
  for (const double rms_s : {5e-4, 8e-4}) {
    sim::CameraSettings camera = noisy_camera();
    camera.effects.push_back(*sim::parse_effect("jitter:rms_s=" + std::to_string(rms_s)));
    for (const double velocity : {70.0, -320.0}) {
      State state;
      const Transport t = judged(record(camera, slanted_bars(velocity), 480), state);
      EXPECT_NEAR(t.jitter_s, rms_s, 0.2 * rms_s);
      EXPECT_GT(t.jitter_error_s, 0.0);
      EXPECT_EQ(t.lost + t.inserted, 0) << rms_s << " s, " << velocity << " px/s";
    }
  }
}

// Frozen frames do not count; the speed next to them is uncertain.
TEST(JudgeTransport, JitterAroundAFreezeIsNoLoss) {
  int steps = 0;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    sim::CameraSettings camera = noisy_camera(seed);
    camera.effects.push_back(*sim::parse_effect("jitter:rms_s=0.0007"));
    Recording r = record(camera, slanted_bars(-320.0), 220);
    std::fill(r.used.begin() + 100, r.used.begin() + 160, char{0});
    State state;
    const Transport t = judged(std::move(r), state);
    steps += t.lost + t.inserted;
  }
  EXPECT_EQ(steps, 0);
}

// The first unknown's bound pushes the second beyond its own until the first is held at it.
TEST(SolveWithin, LetsGoOfWhatWasHeldBesideAnother) {
  const MatrixXd normal{{1.0, 0.6}, {0.6, 1.0}};
  const VectorXd solved = solve_within(normal, VectorXd{{-3.8, -1.0}}, VectorXd{{0.0, -3.0}}, VectorXd{{8.0, 0.0}});
  EXPECT_NEAR(solved[0], 0.0, 1e-9);
  EXPECT_NEAR(solved[1], -1.0, 1e-6);
}

TEST(Nuisances, BelongToTheStimuliThatHaveThem) {
  const Session session =
      testing::session_of({record(noisy_camera(), capture::Uniform{300.0}, 20),
                           record(noisy_camera(), odd_chopper(), 20), record(noisy_camera(), slanted_bars(0.0), 20)});
  State state = nominal_state(session, {});
  const auto all = nuisances(session, state);
  const auto levels = std::ranges::count_if(all, &Nuisance::is_level);
  EXPECT_EQ(levels, 1 + 3 + 2);
  const auto named = [&](const std::string& name) {
    return std::ranges::count_if(all, [&](const Nuisance& n) { return n.parameter.name == name; });
  };
  EXPECT_EQ(named("sweep"), 1);
  EXPECT_EQ(named("delay"), 1);
  for (const Nuisance& n : all) {
    const double before = n.parameter.get(state);
    n.parameter.set(state, before + n.parameter.step);
    EXPECT_NEAR(n.parameter.get(state), before + n.parameter.step, 1e-9) << n.parameter.name;
    n.parameter.set(state, before);
  }
}

TEST(Nuisances, LevelsThatAgreeWithTheFilesSayThatTheBenchIsGood) {
  const Session session = testing::session_of(
      {record(noisy_camera(), capture::Uniform{300.0}, 20), record(noisy_camera(), odd_chopper(), 20)});
  State state = nominal_state(session, {});
  const auto all = nuisances(session, state);
  const double good = level_spread(all, state);
  const double evidence = level_evidence(all, state);
  for (const Nuisance& n : all) {
    if (n.is_level) n.parameter.set(state, n.nominal + 0.5);
  }
  EXPECT_LT(good, 0.02);
  EXPECT_GT(level_spread(all, state), 0.4);
  EXPECT_LT(level_evidence(all, state), evidence);
  EXPECT_NEAR(level_excess(all, state), 1.0, 0.01);  // a bench without a statement may be off by 0.5 K
}

// The same black body has the same error in every capture: five captures carry no more information than one.
TEST(Nuisances, LevelsOfOneSetPointThatAgreeCountOnce) {
  std::vector<Recording> flats;
  for (int i = 0; i < 5; ++i) {
    flats.push_back(record(noisy_camera(), capture::Uniform{300.0}, 20));
    flats.push_back(record(noisy_camera(), capture::Uniform{320.0}, 20));
  }
  const Session session = testing::session_of(std::move(flats));
  State state = nominal_state(session, {});
  const auto all = nuisances(session, state);
  const double none = level_evidence(all, state);
  const auto evidence = [&](bool common) {
    int nth = 0;
    for (const Nuisance& n : all) {
      if (n.is_level) n.parameter.set(state, n.nominal + ((common ? n.nominal < 310.0 : nth++ % 4 < 2) ? 0.3 : -0.3));
    }
    return none - level_evidence(all, state);
  };
  const double each = evidence(false);
  EXPECT_GT(independent_levels(all, state), 8.0);
  const double common = evidence(true);
  EXPECT_NEAR(independent_levels(all, state), 2.0, 0.01);
  EXPECT_LT(common, 0.4 * each);
  EXPECT_GT(common, 0.1 * each);
}

}  // namespace bolo::diagnose::registration_test
