// A daemon under test with what it needs: a capture to replay, a configuration, a name of its own.
#pragma once

#include <gtest/gtest.h>
#include <sys/mman.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "drivers/shm/shm_reader.hpp"
#include "src/capture/capture.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/program.hpp"

namespace bolo::daemon {

using shm::ReadFrame;
using shm::ShmReader;
using tools::test::eventually;
using tools::test::logged;
using tools::test::own_address;
using tools::test::Program;
using Outcome = ShmReader::Outcome;

inline constexpr Geometry kGeometry{64, 24};
inline constexpr std::uint64_t kFirstId = 1000;
inline constexpr std::uint64_t kLostId = 1100;  // never recorded

// A still scene, so that sharp and raw frames agree; the first pixel tells the frame, by `step` counts each.
inline std::uint16_t scene(std::size_t pixel) { return static_cast<std::uint16_t>(30000 + pixel); }

inline void write_capture(const std::filesystem::path& file, std::uint64_t frames, unsigned step = 1) {
  capture::CaptureInfo info;
  info.format.geometry = kGeometry;
  info.camera_model = "Test camera";
  info.camera_serial = "42";
  auto writer = capture::CaptureWriter::create(file, info, {.replace = Replace::kExisting});
  ASSERT_TRUE(writer) << writer.error().message;
  std::vector<std::uint16_t> plane(kGeometry.pixels());
  for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = scene(i);
  for (std::uint64_t id = kFirstId; id < kFirstId + frames; ++id) {
    if (id == kLostId) continue;
    plane[0] = static_cast<std::uint16_t>(kFirstId + (id - kFirstId) * step);
    ASSERT_TRUE(writer->append(static_cast<double>(id) * 0.005, id, plane.data()));
  }
  ASSERT_TRUE(writer->close());
}

class BolodRun : public testing::Test {
 protected:
  BolodRun()
      : name_(std::string("test-") + testing::UnitTest::GetInstance()->current_test_info()->name() + "-" +
              std::to_string(getpid())) {
    setenv("RUNTIME_DIRECTORY", testing::TempDir().c_str(), 1);  // for the control sockets of the daemons started here
  }
  ~BolodRun() override {
    shm_unlink(("/bolo." + name_).c_str());  // of a daemon that was killed
  }

  // A daemon that replays `frames` frames at their own rate.
  std::unique_ptr<Program> start(std::uint64_t frames, const std::string& more = "") {
    write_capture(folder_ / "in.h5", frames);
    return start_again(more);
  }
  std::unique_ptr<Program> start_again(const std::string& more = "", const std::string& log = "log") {
    const std::string file = folder_ / "bolod.toml";
    std::ofstream(file) << "name = '" << name_ << "'\n[source]\ntype = 'replay'\nfile = 'in.h5'\n"
                        << "[pipeline]\nlock_memory = false\n"
                        << more;
    return std::make_unique<Program>(std::vector<std::string>{BOLOD_PROGRAM, "--config", file}, folder_ / log);
  }

  Result<ShmReader> attach() const {
    Result<ShmReader> reader = ShmReader::open(name_);
    eventually([&] { return (reader = ShmReader::open(name_)).has_value(); });
    return reader;
  }

  std::string name_;
  Scratch folder_;
};

}  // namespace bolo::daemon
