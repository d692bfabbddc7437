// `bolo replay` as its users meet it: another process reads the capture's frames from shared memory.
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"

namespace bolo::tools::replay_verb_test {

using test::Outcome;
using test::Program;

constexpr std::uint64_t kFrames = 40;

class ReplayVerb : public test::ProgramTest {
 protected:
  ReplayVerb() : ProgramTest({BOLO_PROGRAM, "replay"}) {}

  void SetUp() override {
    test::SmallCapture capture(in_, test::small_info({24, 10}));
    for (std::uint64_t i = 0; i < kFrames; ++i) {
      capture.append(static_cast<double>(i) * 0.005, 100 + i, [i](std::size_t p) { return shm::pattern(i, 0, p); });
    }
    capture.close();
  }

  Result<shm::ShmReader> attach() const {
    Result<shm::ShmReader> reader = failed("");
    test::eventually([&] { return (reader = shm::ShmReader::open(name_)).has_value(); });
    return reader;
  }

  const std::string in_ = file("in.h5");  // frame i is shm_rig's raw pattern of i
  const std::string name_ = shm::unique_name(testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(ReplayVerb, LoopedCaptureIsPublishedFrameByFrameUntilInterrupted) {
  Program program = start({in_, "--name", name_, "--loop"});
  auto reader = must(attach());
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
  write("replay.toml", "[pipeline]\nlock_memory = false\n");  // a file that it could read again, as bolod would
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

TEST_F(ReplayVerb, EndsWithTheCapture) {
  const Outcome outcome = run({in_, "--name", name_, "--pace", "fast"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  expect_parts(outcome.err, {"40 frames in"});
}

TEST_F(ReplayVerb, BadInputIsOneLine) {
  refused({}, "which capture?");
  refused({file("none.h5")}, "none.h5");
  refused({in_, "--pace", "slow"}, "neither realtime nor fast");
  refused({in_, "--name", "a/b"}, "--name");
}

}  // namespace bolo::tools::replay_verb_test
