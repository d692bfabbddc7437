// The program `bolo replay`: another process reads the capture's frames from shared memory.
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"

namespace bolo::tools::test::replay_verb_test {

constexpr std::uint64_t kFrames = 40;

class ReplayVerb : public ProgramTest {
 protected:
  ReplayVerb() : ProgramTest({BOLO_PROGRAM, "replay"}) {}

  void SetUp() override {
    SmallCapture capture(in_, small_info({24, 10}));
    for (std::uint64_t i = 0; i < kFrames; ++i) {
      capture.append(static_cast<double>(i) * 0.005, 100 + i, [i](std::size_t p) { return shm::pattern(i, 0, p); });
    }
    capture.close();
  }

  Result<shm::ShmReader> attach() const {
    Result<shm::ShmReader> reader = failed("");
    eventually([&] { return (reader = shm::ShmReader::open(name_)).has_value(); });
    return reader;
  }

  const std::string in_ = file("in.h5");  // frame i: shm_rig's raw pattern of i
  const std::string name_ = shm::unique_name(testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(ReplayVerb, EndsWhenItsTerminalIsClosed) {
  write("replay.toml", "[pipeline]\nlock_memory = false\n");  // a file that SIGHUP would reload, as in bolod
  Program program = start({in_, "--name", name_, "--config", file("replay.toml"), "--loop"});
  auto reader = must(attach());
  shm::ReadFrame frame;
  ASSERT_EQ(reader->read(0, frame, 60'000), shm::ShmReader::Outcome::kFrame);
  program.signal(SIGHUP);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  expect_parts(outcome.err, {"SIGHUP: stopping"});
  EXPECT_TRUE(reader->closed());
}

TEST_F(ReplayVerb, EndsWithTheCapture) { ended(0, {in_, "--name", name_, "--pace", "fast"}, {"40 frames in"}); }

// Like the authors' .mat and the output of `bolo deblur`.
TEST_F(ReplayVerb, Float32IsPublishedInStepsOf10mK) {
  auto info = small_info({24, 10});
  info.format.type = PixelType::kFloat32;
  info.format.scale = {.unit = Unit::kKelvin, .scale = 2.0, .offset = 1.0};
  const auto floats = file("floats.h5");
  auto writer = must(capture::CaptureWriter::create(floats, info));
  const std::vector<float> plane(240, 149.12F);  // 299.24 K
  for (int i = 0; i < 40; ++i) EXPECT_TRUE(writer->append(i * 0.005, static_cast<std::uint64_t>(i), plane.data()));
  EXPECT_TRUE(writer->close());
  Program program = start({floats, "--name", name_, "--loop"});
  auto reader = must(attach());
  shm::ReadFrame frame;
  ASSERT_EQ(reader->read(0, frame, 60'000), shm::ShmReader::Outcome::kFrame);
  program.signal(SIGTERM);
  EXPECT_EQ(program.outcome().exit_code, 0);
  EXPECT_EQ(frame.raw, std::vector<std::uint16_t>(240, 29924));
  EXPECT_EQ(reader->header().scale, 0.01);
}

TEST_F(ReplayVerb, BadInputIsOneLine) {
  refused({}, "which capture?");
  refused({file("none.h5")}, "none.h5");
  refused({in_, "--pace", "slow"}, "neither realtime nor fast");
  refused({in_, "--name", "a/b"}, "--name");
}

}  // namespace bolo::tools::test::replay_verb_test
