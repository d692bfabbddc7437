// The programs as their users meet them: `bolo fakecam --fault`, and bolod against such a camera.
#include <gtest/gtest.h>
#include <sys/mman.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <set>

#include <nlohmann/json.hpp>

#include "drivers/fakecam/fault_script.hpp"
#include "drivers/shm/shm_reader.hpp"
#include "src/capture/capture.hpp"
#include "src/core/loss.hpp"
#include "tests/tools/program.hpp"
#include "tools/lab/eval/faults.hpp"

namespace bolo::tools::faults {
namespace {

using shm::ShmReader;
using test::eventually;
using test::Program;

constexpr Geometry kGeometry{64, 24};

class Programs : public test::ProgramTest {
 protected:
  Programs()
      : ProgramTest({}),
        name_(std::string("faults-") + testing::UnitTest::GetInstance()->current_test_info()->name() + "-" +
              std::to_string(getpid())) {}
  ~Programs() override {
    shm_unlink(("/bolo." + name_).c_str());  // of a daemon that was killed
  }

  std::string name_;
};

void write_capture(const std::filesystem::path& file, std::uint64_t frames) {
  capture::CaptureInfo info;
  info.format.geometry = kGeometry;
  auto writer = capture::CaptureWriter::create(file, info, {.replace = Replace::kExisting});
  ASSERT_TRUE(writer) << writer.error().message;
  for (std::uint64_t id = 0; id < frames; ++id) {
    const std::vector<std::uint16_t> plane(kGeometry.pixels(), static_cast<std::uint16_t>(30000 + id));
    ASSERT_TRUE(writer->append(static_cast<double>(id) * 0.005, id, plane.data()));
  }
  ASSERT_TRUE(writer->close());
}

TEST_F(Programs, FakecamListsEveryFault) {
  Program list = start({BOLO_PROGRAM, "fakecam", "--list-faults", "--json"}, "list");
  ASSERT_EQ(list.wait(), 0) << list.err();
  std::set<std::string> names;
  for (const auto& fault : nlohmann::json::parse(list.out())) names.insert(fault.at("name").get<std::string>());
  EXPECT_EQ(names.size(), fakecam::fault_types().size());
  EXPECT_TRUE(names.contains("resend_unanswered"));
}

TEST_F(Programs, FakecamRefusesAFaultThatIsNone) {
  Program fake = start({BOLO_PROGRAM, "fakecam", "no.h5", "--fault", "loss:rate=0.1", "--fault", "rebot"}, "fake");
  EXPECT_EQ(fake.wait(), 2);
  EXPECT_EQ(
      fake.err(),
      "bolo fakecam: --fault: there is no fault 'rebot'; did you mean 'reboot'? (bolo fakecam --list-faults shows "
      "all)\n");
}

TEST_F(Programs, TheDaemonCountsWhatTheFakeCameraSaysItTook) {
  write_capture(folder_ / "in.h5", 100);
  const std::string address = fresh_address();
  Program fake = start({BOLO_PROGRAM, "fakecam", folder_ / "in.h5", "--loop", "--interface", address, "--json",
                        "--fault", "loss:at=0.2,for=0.3,rate=0.1", "--fault", "stall:at=0.7,frames=9"},
                       "fake");
  ASSERT_TRUE(eventually([&] { return fake.out().find("serving") != std::string::npos; })) << fake.err();
  std::ofstream(folder_ / "bolod.toml") << "name = '" << name_ << "'\n[source]\naddress = '" << address
                                        << "'\nwidth = 64\nheight = 24\nrate_hz = 200.0\npacket_size = 576\n"
                                        << "[pipeline]\nlock_memory = false\n";
  Program daemon = start({BOLOD_PROGRAM, "--config", folder_ / "bolod.toml"}, "daemon");
  Result<ShmReader> reader = ShmReader::open(name_);
  ASSERT_TRUE(eventually([&] { return (reader = ShmReader::open(name_)).has_value(); })) << daemon.err();
  constexpr std::uint64_t kPastAll = 260;  // frames: 1.3 s and more
  ASSERT_TRUE(eventually([&] { return reader->header().published >= kPastAll; })) << daemon.err();
  test::expect_good_end(daemon);
  test::expect_good_end(fake);

  const std::string out = fake.out();
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

}  // namespace
}  // namespace bolo::tools::faults
