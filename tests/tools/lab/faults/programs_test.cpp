// The programs: `bolo fakecam --fault`, and bolod with such a camera.
#include "drivers/fakecam/fault_script.hpp"
#include "src/core/loss.hpp"
#include "tests/tools/bolod/bolod_run.hpp"

namespace bolo::daemon::programs_test {

struct FaultPrograms : BolodRun {
  FaultPrograms() : BolodRun({BOLO_PROGRAM, "fakecam"}) {}
};

TEST_F(FaultPrograms, FakecamListsEveryFault) {
  std::set<std::string> names;
  for (const auto& fault : nlohmann::json::parse(printed({"--list-faults", "--json"})))
    names.insert(fault.at("name").get<std::string>());
  EXPECT_EQ(names.size(), fakecam::fault_types().size());
  EXPECT_TRUE(names.contains("resend_unanswered"));
}

TEST_F(FaultPrograms, TheDaemonCountsWhatTheFakeCameraSaysItTook) {
  write_capture(folder_ / "in.h5", 90);  // below kLostId: no gap
  const std::string address = own_address();
  const auto camera =
      start_camera(address, {"--json", "--fault", "loss:at=0.2,for=0.3,rate=0.1", "--fault", "stall:at=0.7,frames=9"});
  const auto daemon = start_with(configure(source_at(address, "rate_hz = 200.0\npacket_size = 576\n")));
  const auto reader = attach(*daemon);
  constexpr std::uint64_t kPastAll = 260;  // frames: 1.3 s and more
  ASSERT_TRUE(eventually([&] { return reader->header().published >= kPastAll; })) << daemon->err();
  expect_good_end(*daemon);
  expect_good_end(*camera);

  const std::string out = camera->out();
  const auto summary = nlohmann::json::parse(out.substr(out.find('\n') + 1));
  const auto frames = [&summary](std::size_t fault) {
    return summary.at("faults")[fault].at("frames").get<std::uint64_t>();
  };
  const auto lost = [&reader](LossCause cause) { return reader->header().lost[static_cast<std::size_t>(cause)]; };
  EXPECT_GT(frames(0), 10U);
  EXPECT_EQ(frames(1), 9U);
  EXPECT_EQ(lost(LossCause::kIncomplete), frames(0));
  EXPECT_EQ(lost(LossCause::kMissing), frames(1));
}

}  // namespace bolo::daemon::programs_test
