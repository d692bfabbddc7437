// Points on demand: a reader's own solver against the planes that a live writer publishes from another process.
#include "drivers/shm/point_reader.hpp"

#include <sys/wait.h>

#include <random>

#include "drivers/shm/shm_reader.hpp"
#include "drivers/shm/shm_sink.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/pipeline/fakes.hpp"
#include "tests/refusal.hpp"

namespace bolo::shm::point_reader_test {

Result<PointReader> open_points(const std::string& name, const std::vector<std::uint32_t>& pixels,
                                const model::PixelMaps& maps = {}) {
  Result<ShmReader> reader = ShmReader::open(name);
  if (!reader) return tl::unexpected<Error>(reader.error());
  return PointReader::over(std::move(*reader), pixels, maps);
}

using deblur::Method;
constexpr auto kPace = std::chrono::milliseconds(1);

struct Case {
  const char* name;
  Method method = Method::kAdmm;
  int lookahead = 0;
  bool auto_lambda = false;
  bool maps = false;
};

model::PixelMaps maps_of(Geometry geometry) {
  model::PixelMaps maps;
  for (std::size_t i = 0; i < geometry.pixels(); ++i) {
    maps.tau_s.push_back(0.010F + 1e-5F * static_cast<float>(i % 200));
    maps.dead.push_back(i % 13 == 6 ? 1 : 0);
  }
  maps.row_delay_s = 5e-5;
  return maps;
}

// About 500 frames at 1000 a second, with losses and a restart.
void write_stream(const std::string& name, const Case& c) {
  pipeline::test::Script script{.frames = pipeline::test::run_of(0, 500)};
  script.frames[150].restart = true;
  for (const std::ptrdiff_t lost : {480, 300, 299, 200, 60}) script.frames.erase(script.frames.begin() + lost);
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    std::this_thread::sleep_for(kPace);
    pipeline::test::fill_moving_bar(slot, format);
    std::minstd_rand random(static_cast<unsigned>(slot.meta.frame_id));
    for (std::size_t i = 0; i < format.geometry.pixels(); ++i) {  // the measured noise changes from frame to frame
      slot.u16()[i] = static_cast<std::uint16_t>(slot.u16()[i] + random() % 16);
    }
  };
  pipeline::PipelineOptions options{
      .deblur = {.method = c.method, .auto_lambda = c.auto_lambda, .lookahead = c.lookahead}, .workers = 1};
  if (c.maps) options.maps = maps_of(script.info.format.geometry);
  ShmSink sink({name, 0, 0644, ""});
  auto pipeline = pipeline::test::create(std::move(script), {&sink}, options);
  _exit(pipeline && (*pipeline)->run(pipeline::test::kNever) ? 0 : 1);
}

class PointReaders : public ::testing::TestWithParam<Case> {
 protected:
  void SetUp() override {
    child_ = fork();
    ASSERT_GE(child_, 0);
    if (child_ == 0) write_stream(name_, GetParam());
  }
  void TearDown() override {
    int status = 0;
    if (child_ > 0) waitpid(child_, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }

  ShmReader wait_for_writer() const {
    for (int attempt = 0; attempt < 60'000; ++attempt) {
      if (auto reader = ShmReader::open(name_)) return std::move(*reader);
      std::this_thread::sleep_for(kPace);
    }
    throw std::runtime_error("no writer");
  }

  std::string name_ = unique_name(std::string("points-") + GetParam().name);
  pid_t child_ = -1;
};

TEST_P(PointReaders, GiveThePublishedPlanesBits) {
  ShmReader frames = wait_for_writer();
  const Geometry geometry{static_cast<int>(frames.header().width), static_cast<int>(frames.header().height)};
  const std::vector<std::uint32_t> pixels{0, 100, 6, 167, 7, 24, 100};
  if (GetParam().maps) {
    expect_error(open_points(name_, pixels), {"give the writer's maps"});
  }
  auto points = must(open_points(name_, pixels, GetParam().maps ? maps_of(geometry) : model::PixelMaps{}));
  std::vector<std::uint16_t> out(pixels.size());
  ReadFrame frame;
  int solved = 0;
  int gaps = 0;
  std::uint64_t number = 0;
  while (true) {
    const auto outcome = points->solve(number, out);
    if (outcome == PointReader::Outcome::kNotYet) {
      if (frames.closed()) break;
      std::this_thread::sleep_for(kPace);
      continue;
    }
    if (frames.read(number, frame, 0) != ShmReader::Outcome::kFrame) {
      number = std::max(number + 1, frames.published() - std::min<std::uint64_t>(frames.published(), 8));  // too slow
      continue;
    }
    if (outcome == PointReader::Outcome::kSolved) {
      ++solved;
      gaps += (frame.meta.flags & kFlagGap) != 0 ? 1 : 0;
      EXPECT_EQ(frame.meta.flags & kFlagWarmUp, 0U);
      const int apart = GetParam().maps ? 1 : 0;  // counts; the writer's correction includes older frames
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        ASSERT_NEAR(out[i], frame.deblurred[pixels[i]], apart) << "frame " << number << " point " << i;
      }
    } else if (outcome == PointReader::Outcome::kWarmUp) {
      EXPECT_NE(frame.meta.flags & kFlagWarmUp, 0U) << number;
    }
    ++number;
  }
  // However slow this process is, the last frames stay in the ring, and one of them was lost.
  EXPECT_GT(solved, 0);
  EXPECT_GT(gaps, 0);
}

INSTANTIATE_TEST_SUITE_P(All, PointReaders,
                         ::testing::Values(Case{"admm"}, Case{"dual", Method::kDual, 1},
                                           Case{"exact", Method::kExact, 1}, Case{"inverse", Method::kInverse, 2},
                                           Case{"mmae", Method::kMmae, 1}, Case{"automatic", Method::kAdmm, 1, true},
                                           Case{"maps", Method::kAdmm, 1, false, true}),
                         [](const auto& each) { return std::string(each.param.name); });

TEST(PointReader, WrongPointsNamesAndFramesAreRefused) {
  Stream stream("points-wrong");
  expect_error(open_points(stream.name, {0, 33 * 7}), {"not inside the frame of 33x7"});
  EXPECT_FALSE(open_points(stream.name, {}));
  EXPECT_FALSE(open_points(unique_name("points-none"), {0}));
  // The raw planes in the ring differ from the solver's input.
  Stream undone("points-undone", {33, 7}, [](Writer& writer) { writer.format.undone = true; });
  expect_error(open_points(undone.name, {0}), {"read the deblurred planes"});
}

}  // namespace bolo::shm::point_reader_test
