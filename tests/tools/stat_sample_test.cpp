#include "tools/view/stat_sample.hpp"

#include <gtest/gtest.h>

#include <cstring>

#include "src/pipeline/source_status.hpp"
#include "src/rt/counters.hpp"
#include "tests/drivers/shm/shm_rig.hpp"

namespace bolo::tools::stat_sample_test {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

StatLook first_look() {
  StatLook look;
  look.at_ns = 100 * kSecondNs;
  bolo_shm_header& h = look.header;
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
  h.latency[rt::LatencyHistogram::bucket(90'000'000)] = 990;  // old frames were slow
  std::strcpy(h.camera_model, "Model");
  std::strcpy(h.solver, "admm");
  return look;
}

// Two seconds later: 400 frames in, 390 out (40 of them warm-up), one slow among them.
StatLook second_look() {
  StatLook look = first_look();
  look.at_ns += 2 * kSecondNs;
  bolo_shm_header& h = look.header;
  h.heartbeat_ns = static_cast<std::uint64_t>(look.at_ns - kSecondNs / 2);
  h.received += 400;
  h.published += 390;
  h.warm_up += 40;
  h.deblur_ns += 350 * 2'000'000ULL;
  h.lost[static_cast<std::size_t>(LossCause::kMissing)] += 10;
  h.latency[rt::LatencyHistogram::bucket(1'000'000)] += 389;
  h.latency[rt::LatencyHistogram::bucket(50'000'000)] += 1;
  return look;
}

TEST(StatTable, TellsHowTheHostsClockIsKept) {
  StatLook look = second_look();
  const auto table = [&look] { return stat_table("front", look, compare(first_look(), look)); };
  EXPECT_NE(table().find("\nutc      host's clock runs by itself, error not known\n"), std::string::npos) << table();
  look.header.clock_synchronised = 1;
  look.header.clock_error_ns = 1'250'000;
  look.header.clock_steps = 2;
  EXPECT_NE(table().find("\nutc      host's clock synchronised, to 1.25 ms; set 2 times\n"), std::string::npos)
      << table();
  const auto json = stat_json("front", look, compare(first_look(), look));
  EXPECT_EQ(json["clock"]["synchronised"], true);
  EXPECT_DOUBLE_EQ(json["clock"]["error_s"].get<double>(), 0.00125);
  EXPECT_EQ(json["clock"]["steps"], 2);
}

TEST(StatSample, RatesAndLatencyAreThoseOfTheInterval) {
  const StatSample s = compare(first_look(), second_look());
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

TEST(StatSample, NothingHappenedIsAllZero) {
  const StatSample s = compare(first_look(), first_look());
  EXPECT_EQ(s.received_hz, 0.0);
  EXPECT_EQ(s.deblur_ms, 0.0);
  EXPECT_EQ(s.latency_max_ms, 0.0);
  EXPECT_EQ(s.lost_total, 5U);
}

TEST(StatSample, StateTellsAnOrderlyEndFromADeath) {
  StatLook look = first_look();
  EXPECT_STREQ(compare(look, look).state, "running");
  look.closed = true;
  EXPECT_STREQ(compare(look, look).state, "stopped");
  look.header.state = BOLO_SHM_CLOSED;
  EXPECT_STREQ(compare(look, look).state, "closed");
}

TEST(StatSample, JsonHasEveryCauseByName) {
  const StatLook after = second_look();
  const auto json = stat_json("cam", after, compare(first_look(), after));
  EXPECT_EQ(json["name"], "cam");
  EXPECT_EQ(json["state"], "running");
  EXPECT_EQ(json["lost"]["missing"], 15);
  EXPECT_EQ(json["lost_hz"]["missing"], 5.0);
  EXPECT_EQ(json["lost"].size(), kLossCauses);
  EXPECT_EQ(json["published"], 1380);
  EXPECT_EQ(json["camera_model"], "Model");
}

TEST(StatSample, TellsHowTheCameraDoes) {
  StatLook look = second_look();
  EXPECT_FALSE(stat_json("cam", look, compare(first_look(), look)).contains("camera"));
  bolo_shm_camera& camera = look.camera.emplace();
  camera.state = BOLO_CAMERA_LOST;
  camera.since_ns = look.at_ns - 3 * kSecondNs;
  camera.lost[static_cast<std::size_t>(pipeline::LostCause::kNoAnswer)] = 2;
  camera.outage_frames = 84;
  const auto json = stat_json("cam", look, compare(first_look(), look))["camera"];
  EXPECT_EQ(json["state"], "lost");
  EXPECT_EQ(json["state_age_s"], 3.0);
  EXPECT_EQ(json["lost"]["no_answer"], 2);
  EXPECT_TRUE(json["clock_drift_ppm"].is_null()) << "not known yet";
  const std::string table = stat_table("cam", look, compare(first_look(), look));
  EXPECT_NE(table.find("lost for 3.0 s; lost 2 (2 no answer), stalled 0; 84 frames missed"), std::string::npos)
      << table;
  EXPECT_EQ(table.find("\nclock "), std::string::npos) << table;
  camera.clock_offset_ns = -5;
  camera.clock_drift_ppm = -20.5;
  EXPECT_NE(stat_table("cam", look, compare(first_look(), look)).find("drift -20.5 ppm"), std::string::npos);
}

TEST(StatSample, TellsWhetherPtpKeepsTheCamerasClock) {
  StatLook look = second_look();
  bolo_shm_camera& camera = look.camera.emplace();
  const auto json = [&] { return stat_json("cam", look, compare(first_look(), look))["camera"]; };
  camera.state = BOLO_CAMERA_STREAMING;
  EXPECT_TRUE(json()["ptp"].is_null() && json()["ptp_offset_s"].is_null());
  EXPECT_EQ(stat_table("cam", look, compare(first_look(), look)).find("\nptp "), std::string::npos);
  camera.ptp = static_cast<std::uint64_t>(pipeline::PtpStatus::kSlave);
  camera.ptp_offset_ns = -37;
  EXPECT_EQ(json()["ptp"], "slave");
  EXPECT_DOUBLE_EQ(json()["ptp_offset_s"], -37e-9);
  const std::string table = stat_table("cam", look, compare(first_look(), look));
  EXPECT_NE(table.find("ptp      slave, -37 ns from its master\n"), std::string::npos) << table;
  camera.ptp = 1234;
  EXPECT_EQ(json()["ptp"], "unknown");
}

TEST(StatSample, TellsHowThePictureMoves) {
  StatLook look = second_look();
  EXPECT_TRUE(stat_json("cam", look, compare(first_look(), look))["motion"].is_null());
  EXPECT_EQ(stat_table("cam", look, compare(first_look(), look)).find("motion"), std::string::npos);
  look.header.motion_offset = 64;
  EXPECT_NE(stat_table("cam", look, compare(first_look(), look)).find("motion   not known"), std::string::npos);
  look.motion = {-3.0, 4.0, 0.875};
  const auto json = stat_json("cam", look, compare(first_look(), look))["motion"];
  EXPECT_EQ(json["x_px"], -3.0);
  EXPECT_EQ(json["y_px"], 4.0);
  EXPECT_EQ(json["sure_blocks"], 0.875);
  const std::string table = stat_table("cam", look, compare(first_look(), look));
  EXPECT_NE(table.find("motion   5.00 px a frame (x -3.00, y +4.00), 88 % of the blocks sure\n"), std::string::npos)
      << table;
}

TEST(StatSample, MotionIsTheNewestFrames) {
  const std::string name = shm::unique_name("stat-motion");
  shm::Writer writer(name);
  writer.format.motion = true;
  ASSERT_TRUE(writer.open());
  const auto reader = shm::ShmReader::open(name);
  ASSERT_TRUE(reader);
  EXPECT_FALSE(newest_motion(*reader)) << "no frame yet";
  for (std::uint64_t n = 0; n < 10; ++n) {
    writer.publish();
    const auto motion = newest_motion(*reader);
    ASSERT_EQ(motion.has_value(), shm::moves(n)) << n;
    if (!motion) continue;
    EXPECT_EQ(motion->x_px, static_cast<double>(n));
    EXPECT_EQ(motion->y_px, 3.0);
    EXPECT_EQ(motion->sure, 1.0);
  }
}

// What a camera calls itself is no order to the terminal.
TEST(StatSample, TableShowsWhatIsNotPrintableAsQuestionMarks) {
  StatLook look = second_look();
  std::strcpy(look.header.camera_model, "A655\x1b[2J\xff\r\n\xc2\x9b");
  std::strcpy(look.header.solver, "\xcf\x84 = 11 ms");
  const std::string table = stat_table("a\x1b]0;b\a", look, compare(first_look(), look));
  EXPECT_NE(table.find("A655?[2J????? "), std::string::npos) << table;
  EXPECT_NE(table.find("\xcf\x84 = 11 ms"), std::string::npos) << "what is text stays: " << table;
  EXPECT_EQ(table.find_first_of("\x1b\r\a\x7f"), std::string::npos);
}

// Who cuts them knows how wide it is: pipes get all.
TEST(StatSample, TableHasWholeLines) {
  StatLook look = second_look();
  std::memset(look.header.solver, 's', sizeof(look.header.solver) - 1);
  for (const auto& stage : pipeline::kStages) look.told["stages"][std::string(stage.name)]["p50_ms"] = 123.456;
  const std::string table = stat_table("cam", look, compare(first_look(), look));
  EXPECT_NE(table.find(std::string(look.header.solver) + "\n"), std::string::npos) << table;
  EXPECT_NE(table.find("publish 123.456 ms (p50 of all)\n"), std::string::npos) << table;
}

TEST(StatSample, TableHasOnlyTheCausesThatTookFrames) {
  StatLook look = second_look();
  const std::string table = stat_table("cam", look, compare(first_look(), look));
  EXPECT_NE(table.find("lost     15 in all\n  missing "), std::string::npos) << table;
  EXPECT_EQ(table.find("out_of_order"), std::string::npos) << table;
  look.header.lost[static_cast<std::size_t>(LossCause::kMissing)] = 0;
  EXPECT_TRUE(stat_table("cam", look, compare(look, look)).ends_with("lost     0 in all\n"));
}

}  // namespace
}  // namespace bolo::tools::stat_sample_test
