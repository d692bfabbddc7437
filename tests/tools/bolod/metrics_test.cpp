#include "src/core/clock.hpp"
#include "tests/tools/bolod/bolod_run.hpp"
#include "tests/tools/sockets.hpp"

namespace bolo::daemon::metrics_test {

constexpr std::uint16_t kPort = 9464;

UniqueFd connected(const std::string& address) {
  // Below the time after which servers with few places drop an idle client.
  UniqueFd fd = tools::test::patient_socket(AF_INET, 20);
  return tools::test::connect_to(fd, address, kPort) ? std::move(fd) : UniqueFd();
}

// Complete answer to a request line; empty without one.
std::string ask(const std::string& address, const std::string& line) {
  const UniqueFd fd = connected(address);
  const std::string request = line + "\r\nHost: bolo\r\nConnection: close\r\n\r\n";
  if (!fd || send(fd.get(), request.data(), request.size(), MSG_NOSIGNAL) < 0) return {};
  return tools::test::receive_all(fd);
}

// Body of http://ADDRESS:9464/metrics; empty without an answer.
std::string scrape(const std::string& address) {
  const std::string answer = ask(address, "GET /metrics HTTP/1.1");
  const std::size_t body = answer.find("\r\n\r\n");
  return body == std::string::npos ? "" : answer.substr(body + 4);
}

// Value of "NAME{LABELS}"; -1 if missing.
double value(const std::string& text, const std::string& series) {
  const std::size_t at = text.find("\n" + series + " ");
  return at == std::string::npos ? -1.0 : std::strtod(text.c_str() + at + series.size() + 2, nullptr);
}

class Metrics : public BolodRun {
 protected:
  Metrics() { address_ = own_address(); }
  std::string section() const { return "[metrics]\nenable = true\nlisten = '" + address_ + ":9464'\n"; }

  std::string address_;
};

TEST_F(Metrics, TellWhatBecameOfTheFrames) {
  write_capture(folder_ / "in.h5", 20'000, 1, "42\xff\x1b");  // cameras need not send UTF-8, labels must be
  const auto daemon = start_again(section());
  std::string text;
  ASSERT_TRUE(eventually([&] {
    text = scrape(address_);
    return value(text, "bolo_frames_published_total") > 150.0;
  })) << daemon->err()
      << text;
  const double published = value(text, "bolo_frames_published_total");
  EXPECT_GE(value(text, "bolo_frames_received_total"), published);
  EXPECT_EQ(value(text, "bolo_frames_lost_total{cause=\"missing\"}"), 1.0);
  EXPECT_EQ(value(text, "bolo_frames_lost_total{cause=\"queue_full\"}"), 0.0);
  EXPECT_GE(value(text, "bolo_latency_seconds_count"), published);
  EXPECT_GE(value(text, "bolo_latency_seconds_bucket{le=\"+Inf\"}"), published);
  EXPECT_GT(value(text, "bolo_latency_seconds_sum"), 0.0);
  for (const char* stage : {"arrival", "queue", "deblur", "publish"}) {
    const std::string labels = std::string("{stage=\"") + stage + "\"}";
    EXPECT_GE(value(text, "bolo_stage_latency_seconds_count" + labels), 150.0) << stage;
  }
  EXPECT_GT(value(text, "bolo_stage_latency_seconds_sum{stage=\"deblur\"}"), 0.0);
  EXPECT_EQ(value(text, "bolo_flowing"), 1.0);
  EXPECT_NEAR(value(text, "bolo_frame_period_seconds"), 0.005, 1e-6);
  const ClockState clock = read_clock_state();
  EXPECT_EQ(value(text, "bolo_clock_synchronised"), clock.synchronised ? 1.0 : 0.0);
  EXPECT_GT(value(text, "bolo_clock_error_seconds"), 0.0);
  EXPECT_LE(value(text, "bolo_clock_error_seconds"), 16.0);
  EXPECT_EQ(value(text, "bolo_clock_steps_total"), 0.0);
  EXPECT_NE(text.find("camera_serial=\"42??\""), std::string::npos);
  EXPECT_EQ(text.find("bolo_camera_state"), std::string::npos) << "a replay has no camera";

  expect_good_end(*daemon);
  if (std::system("command -v promtool > /dev/null") != 0) GTEST_SKIP() << "promtool (package prometheus) is missing";
  Program lint({"/bin/sh", "-c", "promtool check metrics < \"$0\" 2>&1", write("metrics.txt", text)}, file("lint"));
  EXPECT_EQ(lint.wait(), 0) << lint.out();
}

TEST_F(Metrics, TellOfTheCamera) {
  write_capture(folder_ / "in.h5", 90);
  const auto camera = start_camera(address_);
  const auto daemon = start_with(configure(source_at(address_, "reconnect_after_ms = 500\nptp = true\n"), section()));
  const auto has_value = [&](const std::string& series, double wanted) {
    return eventually([&] { return value(scrape(address_), series) == wanted; });
  };
  EXPECT_TRUE(has_value("bolo_camera_state{state=\"streaming\"}", 1.0)) << daemon->err();
  EXPECT_TRUE(has_value("bolo_camera_ptp_state{state=\"slave\"}", 1.0));
  const std::string text = scrape(address_);
  EXPECT_EQ(value(text, "bolo_camera_ptp_offset_seconds"), -37e-9);
  EXPECT_EQ(value(text, "bolo_camera_state{state=\"lost\"}"), 0.0) << text;
  EXPECT_EQ(value(text, "bolo_camera_lost_total{cause=\"no_answer\"}"), 0.0);
  EXPECT_EQ(value(text, "bolo_camera_reconnects_total"), 0.0);
  EXPECT_TRUE(eventually([&] { return value(scrape(address_), "bolo_camera_packets_received_total") > 0.0; }));
  expect_good_end(*daemon);
}

TEST_F(Metrics, NothingElseIsAnswered) {
  const auto daemon = start(20'000, section());
  ASSERT_TRUE(eventually([&] { return !scrape(address_).empty(); })) << daemon->err();
  EXPECT_TRUE(ask(address_, "GET /metrics?name=x HTTP/1.1").starts_with("HTTP/1.1 200 "));
  EXPECT_TRUE(ask(address_, "GET / HTTP/1.1").starts_with("HTTP/1.1 404 "));
  EXPECT_TRUE(ask(address_, "GET /metricsx HTTP/1.1").starts_with("HTTP/1.1 404 "));
  EXPECT_TRUE(ask(address_, "POST /metrics HTTP/1.1").starts_with("HTTP/1.1 405 "));
  EXPECT_EQ(ask(address_, "GET /" + std::string(10'000, 'a') + " HTTP/1.1"), "");
  std::vector<UniqueFd> idle;
  for (int i = 0; i < 40; ++i) {
    idle.push_back(connected(address_));
    if (i % 2 == 0) send(idle.back().get(), "GET /met", 8, MSG_NOSIGNAL);
  }
  EXPECT_FALSE(scrape(address_).empty()) << "idle connections starve nobody";
}

// Any program may hold the port, and frames do not need it.
TEST_F(Metrics, ATakenPortOnlyWarnsAndIsTriedAgain) {
  const auto first = start(20'000, section());
  ASSERT_TRUE(eventually([&] { return !scrape(address_).empty(); })) << first->err();
  name_ += "-second";
  const auto second = start_again(section(), "second");
  attach(*second);
  EXPECT_TRUE(logged(*second, "cannot listen at " + address_ + ":9464 (Address already in use)")) << second->err();
  expect_good_end(*first);
  EXPECT_TRUE(eventually([&] { return scrape(address_).find(name_) != std::string::npos; })) << second->err();
  expect_good_end(*second);
}

}  // namespace bolo::daemon::metrics_test
