// Output of bolo stat about a daemon, and the identity of who answers at its control socket.
#include "tools/view/stat_sample.hpp"
#include "src/pipeline/source.hpp"
#include "src/rt/counters.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/drivers/shm/unprivileged.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/sockets.hpp"
#include "tools/bolo/control_client.hpp"
#include "tools/bolo/stat_history.hpp"

namespace bolo::tools::stat_sample_test {

constexpr std::int64_t kSecondNs = 1'000'000'000;

StatSnapshot first_snapshot() {
  StatSnapshot snapshot;
  snapshot.at_ns = 100 * kSecondNs;
  bolo_shm_header& h = snapshot.header;
  h.state = BOLO_SHM_RUNNING;
  h.width = 640;
  h.height = 120;
  h.frame_period_s = 0.005;
  h.start_ns = 40 * kSecondNs;
  h.heartbeat_ns = 100 * kSecondNs;
  h.received = 1000;
  h.published = 990;
  h.warm_up = 16;
  h.deblur_ns = 1'000'000;
  h.lost[static_cast<std::size_t>(LossCause::kMissing)] = 5;
  h.latency[rt::LatencyHistogram::bucket(90'000'000)] = 990;  // earlier frames were slow
  std::strcpy(h.camera_model, "Model");
  std::strcpy(h.solver, "admm");
  return snapshot;
}

// Two seconds later: 400 frames in, 390 out (40 of them warm-up), one of them slow.
StatSnapshot second_snapshot() {
  StatSnapshot snapshot = first_snapshot();
  snapshot.at_ns += 2 * kSecondNs;
  bolo_shm_header& h = snapshot.header;
  h.heartbeat_ns = static_cast<std::uint64_t>(snapshot.at_ns - kSecondNs / 2);
  h.received += 400;
  h.published += 390;
  h.warm_up += 40;
  h.deblur_ns += 350 * 2'000'000ULL;
  h.lost[static_cast<std::size_t>(LossCause::kMissing)] += 10;
  h.latency[rt::LatencyHistogram::bucket(1'000'000)] += 389;
  h.latency[rt::LatencyHistogram::bucket(50'000'000)] += 1;
  return snapshot;
}

std::string table_of(const StatSnapshot& snapshot) {
  return stat_table("cam", snapshot, compare(first_snapshot(), snapshot));
}
auto json_of(const StatSnapshot& snapshot) { return stat_json("cam", snapshot, compare(first_snapshot(), snapshot)); }

// A daemon in another time namespace has another clock.
TEST(StatTable, AHeartbeatThatGoesOnIsOfNoStoppedDaemon) {
  StatSnapshot before = first_snapshot();
  StatSnapshot after = second_snapshot();
  before.closed = after.closed = true;
  EXPECT_EQ(compare(before, after).state, std::string("running"));
  EXPECT_EQ(compare(after, after).state, std::string("stopped"));
  before.closed = false;
  EXPECT_EQ(compare(before, after).state, std::string("stopped")) << "it stood still in between";
}

TEST(StatTable, TellsHowTheHostsClockIsKept) {
  StatSnapshot snapshot = second_snapshot();
  expect_parts(table_of(snapshot), {"\nutc      host's clock runs by itself, error not known\n"});
  snapshot.header.clock_synchronised = 1;
  snapshot.header.clock_error_ns = 1'250'000;
  snapshot.header.clock_steps = 2;
  expect_parts(table_of(snapshot), {"\nutc      host's clock synchronised, to 1.25 ms; set 2 times\n"});
  const auto json = json_of(snapshot);
  EXPECT_EQ(json["clock"]["synchronised"], true);
  EXPECT_DOUBLE_EQ(json["clock"]["error_s"].get<double>(), 0.00125);
  EXPECT_EQ(json["clock"]["steps"], 2);
}

TEST(StatSample, RatesAndLatencyAreThoseOfTheInterval) {
  const StatSample s = compare(first_snapshot(), second_snapshot());
  EXPECT_DOUBLE_EQ(s.interval_s, 2.0);
  EXPECT_DOUBLE_EQ(s.received_hz, 200.0);
  EXPECT_DOUBLE_EQ(s.published_hz, 195.0);
  EXPECT_DOUBLE_EQ(s.deblur_ms, 2.0) << "warm-up frames were not solved";
  EXPECT_EQ(s.latency_frames, 390U);
  EXPECT_NEAR(s.latency_p50_ms, 1.0, 0.125);
  EXPECT_NEAR(s.latency_p99_ms, 1.0, 0.125);
  EXPECT_NEAR(s.latency_max_ms, 50.0, 6.25);
  EXPECT_EQ(s.lost_total, 15U);
  EXPECT_DOUBLE_EQ(s.lost_hz[static_cast<std::size_t>(LossCause::kMissing)], 5.0);
  EXPECT_DOUBLE_EQ(s.uptime_s, 62.0);
  EXPECT_DOUBLE_EQ(s.heartbeat_age_s, 0.5);
}

TEST(StatSample, StateTellsAnOrderlyEndFromADeath) {
  StatSnapshot snapshot = first_snapshot();
  const StatSample nothing_happened = compare(snapshot, snapshot);
  EXPECT_STREQ(nothing_happened.state, "running");
  EXPECT_EQ(nothing_happened.received_hz, 0.0);
  EXPECT_EQ(nothing_happened.deblur_ms, 0.0);
  EXPECT_EQ(nothing_happened.latency_max_ms, 0.0);
  snapshot.closed = true;
  EXPECT_STREQ(compare(snapshot, snapshot).state, "stopped");
  snapshot.header.state = BOLO_SHM_CLOSED;
  EXPECT_STREQ(compare(snapshot, snapshot).state, "closed");
}

TEST(StatSample, JsonHasEveryCauseByNameAndTheTableThoseThatTookFrames) {
  StatSnapshot snapshot = second_snapshot();
  const auto json = json_of(snapshot);
  EXPECT_EQ(json["name"], "cam");
  EXPECT_EQ(json["state"], "running");
  EXPECT_EQ(json["lost"]["missing"], 15);
  EXPECT_EQ(json["lost_hz"]["missing"], 5.0);
  EXPECT_EQ(json["lost"].size(), kLossCauses);
  EXPECT_EQ(json["published"], 1380);
  EXPECT_EQ(json["camera_model"], "Model");
  expect_parts(table_of(snapshot), {"lost     15 in all\n  missing "});
  EXPECT_EQ(table_of(snapshot).find("out_of_order"), std::string::npos);
  snapshot.header.lost[static_cast<std::size_t>(LossCause::kMissing)] = 0;
  EXPECT_TRUE(stat_table("cam", snapshot, compare(snapshot, snapshot)).ends_with("lost     0 in all\n"));
}

TEST(StatSample, TellsHowTheCameraDoes) {
  StatSnapshot snapshot = second_snapshot();
  EXPECT_FALSE(json_of(snapshot).contains("camera"));
  bolo_shm_camera& camera = snapshot.camera.emplace();
  camera.state = BOLO_CAMERA_LOST;
  camera.since_ns = snapshot.at_ns - 3 * kSecondNs;
  camera.lost[static_cast<std::size_t>(pipeline::LostCause::kNoAnswer)] = 2;
  camera.outage_frames = 84;
  const auto json = json_of(snapshot)["camera"];
  EXPECT_EQ(json["state"], "lost");
  EXPECT_EQ(json["state_age_s"], 3.0);
  EXPECT_EQ(json["lost"]["no_answer"], 2);
  EXPECT_TRUE(json["clock_drift_ppm"].is_null()) << "not known yet";
  EXPECT_TRUE(json["ptp"].is_null() && json["ptp_offset_s"].is_null());
  expect_parts(table_of(snapshot), {"lost for 3.0 s; lost 2 (2 no answer), stalled 0; 84 frames missed"});
  EXPECT_EQ(table_of(snapshot).find("\nclock "), std::string::npos);
  EXPECT_EQ(table_of(snapshot).find("\nptp "), std::string::npos);
  camera.clock_offset_ns = -5;
  camera.clock_drift_ppm = -20.5;
  camera.ptp = static_cast<std::uint64_t>(pipeline::PtpStatus::kSlave);
  camera.ptp_offset_ns = -37;
  EXPECT_EQ(json_of(snapshot)["camera"]["ptp"], "slave");
  EXPECT_DOUBLE_EQ(json_of(snapshot)["camera"]["ptp_offset_s"], -37e-9);
  expect_parts(table_of(snapshot), {"drift -20.5 ppm", "ptp      slave, -37 ns from its master\n"});
  camera.ptp = 1234;
  EXPECT_EQ(json_of(snapshot)["camera"]["ptp"], "unknown");
}

TEST(StatSample, TellsHowThePictureMoves) {
  StatSnapshot snapshot = second_snapshot();
  EXPECT_TRUE(json_of(snapshot)["motion"].is_null());
  EXPECT_EQ(table_of(snapshot).find("motion"), std::string::npos);
  snapshot.header.motion_offset = 64;
  expect_parts(table_of(snapshot), {"motion   not known"});
  snapshot.motion = {-3.0, 4.0, 0.875};
  const auto json = json_of(snapshot)["motion"];
  EXPECT_EQ(json["x_px"], -3.0);
  EXPECT_EQ(json["y_px"], 4.0);
  EXPECT_EQ(json["sure_blocks"], 0.875);
  expect_parts(table_of(snapshot), {"motion   5.00 px a frame (x -3.00, y +4.00), 88 % of the blocks sure\n"});
}

TEST(StatSample, MotionIsTheNewestFrames) {
  shm::Stream stream("stat-motion", {33, 7}, [](shm::Writer& writer) { writer.format.motion = true; });
  EXPECT_FALSE(newest_motion(*stream.reader)) << "no frame yet";
  for (std::uint64_t n = 0; n < 10; ++n) {
    stream.writer.publish();
    const auto motion = newest_motion(*stream.reader);
    ASSERT_EQ(motion.has_value(), shm::moves(n)) << n;
    if (!motion) continue;
    EXPECT_EQ(motion->x_px, static_cast<double>(n));
    EXPECT_EQ(motion->y_px, 3.0);
    EXPECT_EQ(motion->sure, 1.0);
  }
}

// A camera's model name must not control the terminal.
TEST(StatSample, TableShowsWhatIsNotPrintableAsQuestionMarks) {
  StatSnapshot snapshot = second_snapshot();
  std::strcpy(snapshot.header.camera_model, "A655\x1b[2J\xff\r\n\xc2\x9b");
  std::strcpy(snapshot.header.solver, "\xcf\x84 = 11 ms");
  const std::string table = stat_table("a\x1b]0;b\a", snapshot, compare(first_snapshot(), snapshot));
  expect_parts(table, {"A655?[2J????? ", "\xcf\x84 = 11 ms"});  // printable text stays
  EXPECT_EQ(table.find_first_of("\x1b\r\a\x7f"), std::string::npos);
}

// Like a daemon of another version, which keeps running while the package is upgraded.
TEST(StatSample, ADaemonThatSaysLessOrOtherThingsIsShown) {
  StatSnapshot snapshot = second_snapshot();
  for (const char* answer :
       {"{\"stages\": {}, \"effort\": {}}", "{\"stages\": null, \"effort\": null}",
        "{\"stages\": [1], \"effort\": \"full\"}",
        "{\"stages\": {\"deblur\": 7}, \"effort\": {\"now\": 5, \"frames\": {\"raw\": -1}}}", "[]", "7", "{"}) {
    snapshot.status = nlohmann::ordered_json::parse(answer, nullptr, false);
    EXPECT_NE(table_of(snapshot).find("lost     15 in all"), std::string::npos) << answer;
    EXPECT_EQ(json_of(snapshot)["published"], 1380) << answer;
  }
  snapshot.status = nlohmann::ordered_json::parse("{\"gap_bursts\": \"many\", \"repeats\": -1}");
  EXPECT_EQ(table_of(snapshot).find("profile"), std::string::npos);
  snapshot.status = nlohmann::ordered_json::parse(
      "{\"stages\": {\"deblur\": {\"p50_ms\": 1.5}}, \"effort\": {\"now\": \"raw\", \"frames\": {\"raw\": 3}}, "
      "\"gap_bursts\": 1}");
  expect_parts(table_of(snapshot),
               {"deblur 1.500, publish 0.000 ms", "effort   raw; 0 frames reduced, 0 inverse, 3 raw\n",
                "foretells frames to ? x noise"});
}

StatSample sample(double p50_ms, double p99_ms, double lost_hz = 0.0) {
  StatSample s;
  s.interval_s = 0.5;
  s.latency_frames = p50_ms > 0.0 ? 100 : 0;
  s.latency_p50_ms = p50_ms;
  s.latency_p99_ms = p99_ms;
  s.lost_hz[1] = lost_hz;
  return s;
}

StatHistory example() {
  StatHistory history(0.5);
  history.add(sample(2.5, 4.0));
  history.add(sample(0.0, 0.0, 40.0));
  history.add(sample(2.5, 5.0, 6.0));
  return history;
}

TEST(StatHistory, ShowsLatencyLossesAndTheirScale) {
  EXPECT_EQ(history_lines(example(), {80, 4}, false),
            (std::vector<std::string>{"history  1.5 s until now, bars from 0 to 5 ms, gap: no frame",
                                      "  p99    \u2586 \u2588", "  p50    \u2584 \u2584", "  lost    +3"}));
  StatHistory silent(1.0);
  silent.add(sample(0.0, 0.0));
  EXPECT_EQ(history_lines(silent, {80, 4}, false).at(1), "  p99     ") << "a scale nevertheless";
}

// --- Authenticity: the daemon, or another user with a socket of that name.

constexpr std::string_view kAnswer = "{\"ok\": true}\n";

void answer_one(const UniqueFd& listener) {
  const UniqueFd client(accept(listener.get(), nullptr, nullptr));
  std::array<char, 64> request{};
  static_cast<void>(recv(client.get(), request.data(), request.size(), 0));
  static_cast<void>(send(client.get(), kAnswer.data(), kAnswer.size(), MSG_NOSIGNAL));
}

TEST(ControlClientTest, ItsOwnUsersDaemonIsHeard) {
  const Scratch scratch;
  const std::string path = (scratch / "own.sock").string();
  const UniqueFd listener = tools::test::bound_at(path, SOCK_STREAM);
  std::jthread daemon([&] { answer_one(listener); });
  const auto answer = tools::ask_daemon(path, "state");
  EXPECT_EQ(*must(answer) + "\n", kAnswer);
}

TEST(ControlClientTest, AStrangersSocketIsNotADaemons) {
  if (geteuid() != 0) GTEST_SKIP() << "only root can be another user";
  const Scratch scratch;
  const std::string path = (scratch / "stranger.sock").string();
  std::filesystem::permissions(scratch.path(), std::filesystem::perms::all);
  std::array<int, 2> ready{};
  ASSERT_EQ(pipe(ready.data()), 0);
  std::jthread stranger([&] {
    shm::unprivileged({}, [&] {
      const UniqueFd listener = tools::test::bound_at(path, SOCK_STREAM);
      if (write(ready[1], "r", 1) == 1) answer_one(listener);
      return 0;
    });
  });
  char go = 0;
  ASSERT_EQ(read(ready[0], &go, 1), 1);
  const auto answer = tools::ask_daemon(path, "state");
  expect_error(answer, {"65534"});
}

}  // namespace bolo::tools::stat_sample_test
