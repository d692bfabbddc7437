// `bolo replay` as its users meet it: another process reads the capture's frames from shared memory.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <optional>
#include <thread>

#include "src/capture/capture.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools {
namespace {

using test::Outcome;
using test::Program;

constexpr auto kHangGuard = std::chrono::seconds(60);
constexpr std::uint64_t kFrames = 40;
constexpr Geometry kGeometry{24, 10};

class ReplayVerb : public test::ProgramTest {
 protected:
  ReplayVerb() : ProgramTest({BOLO_PROGRAM, "replay"}) {}
  void SetUp() override { name_ = shm::unique_name(testing::UnitTest::GetInstance()->current_test_info()->name()); }

  // Frame i is shm_rig's raw pattern of i.
  std::string write_capture() const {
    capture::CaptureInfo info;
    info.format.geometry = kGeometry;
    info.format.scale = {Unit::kKelvin, 0.01, 0.0};
    info.format.frame_period_s = 0.005;
    info.camera_model = "Model";
    const std::string file = folder_ / "in.h5";
    auto writer = capture::CaptureWriter::create(file, info, {.replace = Replace::kExisting});
    EXPECT_TRUE(writer) << writer.error().message;
    std::vector<std::uint16_t> plane(kGeometry.pixels());
    for (std::uint64_t i = 0; i < kFrames; ++i) {
      shm::fill(plane, i, 0);
      EXPECT_TRUE(writer->append(static_cast<double>(i) * 0.005, 100 + i, plane.data()));
    }
    EXPECT_TRUE(writer->close());
    return file;
  }

  std::optional<shm::ShmReader> attach() const {
    const auto begin = std::chrono::steady_clock::now();
    while (std::chrono::steady_clock::now() - begin < kHangGuard) {
      if (auto reader = shm::ShmReader::open(name_)) return std::move(*reader);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return std::nullopt;
  }

  std::string name_;
};

TEST_F(ReplayVerb, LoopedCaptureIsPublishedFrameByFrameUntilInterrupted) {
  Program program = start({write_capture(), "--name", name_, "--loop"});
  auto reader = attach();
  ASSERT_TRUE(reader);
  EXPECT_STREQ(reader->header().camera_model, "Model");
  shm::ReadFrame frame;
  std::uint64_t read = 0;
  std::uint64_t last_id = 0;
  for (std::uint64_t number = 0; read < 2 * kFrames; ++number) {
    const auto outcome = reader->read(number, frame, 60'000);
    if (outcome == shm::ShmReader::Outcome::kOverwritten) continue;  // this process was held up
    ASSERT_EQ(outcome, shm::ShmReader::Outcome::kFrame) << "frame " << number;
    ASSERT_TRUE(read == 0 || frame.meta.frame_id > last_id) << "numbers rise from lap to lap";
    last_id = frame.meta.frame_id;
    const std::uint64_t place = (last_id - 100) % kFrames;
    for (std::size_t p = 0; p < frame.raw.size(); ++p) ASSERT_EQ(frame.raw[p], shm::pattern(place, 0, p));
    ++read;
  }
  program.signal(SIGINT);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
}

TEST_F(ReplayVerb, EndsWhenItsTerminalIsClosed) {
  const std::string config =
      write("replay.toml", "[pipeline]\nlock_memory = false\n");  // a file that it could read again, as bolod would
  Program program = start({write_capture(), "--name", name_, "--config", config, "--loop"});
  auto reader = attach();
  ASSERT_TRUE(reader);
  shm::ReadFrame frame;
  ASSERT_EQ(reader->read(0, frame, 60'000), shm::ShmReader::Outcome::kFrame);
  program.signal(SIGHUP);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.err.find("SIGHUP: stopping"), std::string::npos) << outcome.err;
  EXPECT_TRUE(reader->closed());
}

TEST_F(ReplayVerb, EndsWithTheCapture) {
  const Outcome outcome = run({write_capture(), "--name", name_, "--pace", "fast"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.err.find("40 frames in"), std::string::npos) << outcome.err;
}

TEST_F(ReplayVerb, BadInputIsOneLine) {
  refused({}, "which capture?");
  refused({file("none.h5")}, "none.h5");
  refused({write_capture(), "--pace", "slow"}, "neither realtime nor fast");
  refused({write_capture(), "--name", "a/b"}, "--name");
}

}  // namespace
}  // namespace bolo::tools
