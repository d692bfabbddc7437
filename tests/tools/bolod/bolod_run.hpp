// A daemon under test with a capture to replay, a configuration and a unique name.
#pragma once

#include <sys/mman.h>

#include <nlohmann/json.hpp>

#include "drivers/shm/shm_reader.hpp"
#include "tests/tools/program.hpp"
#include "tests/tools/small_capture.hpp"

namespace bolo::daemon {

using shm::ReadFrame;
using shm::ShmReader;
using tools::test::expect_good_end;
using tools::test::logged;
using tools::test::own_address;
using tools::test::Program;
using Outcome = ShmReader::Outcome;

inline constexpr Geometry kGeometry{64, 24};
inline constexpr std::uint64_t kFirstId = 1000;
inline constexpr std::uint64_t kLostId = 1100;  // never recorded

// A still scene, so that deblurred and raw frames agree; the first pixel identifies the frame.
inline std::uint16_t scene(std::size_t pixel) { return static_cast<std::uint16_t>(30000 + pixel); }

// Writes a capture whose first pixel rises by `step` with every new frame; each is repeated `reads` times.
inline void write_capture(const std::filesystem::path& file, std::uint64_t frames, unsigned step = 1,
                          const std::string& serial = "42", std::uint64_t reads = 1) {
  capture::CaptureInfo info = tools::test::small_info(kGeometry);
  info.camera_model = "Test camera";
  info.camera_serial = serial;
  tools::test::SmallCapture capture(file, info);
  std::vector<std::uint16_t> plane(kGeometry.pixels());
  for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = scene(i);
  for (std::uint64_t id = kFirstId; id < kFirstId + frames; ++id) {
    if (id == kLostId) continue;
    plane[0] = static_cast<std::uint16_t>(kFirstId + (id - kFirstId) / reads * step);
    EXPECT_TRUE(capture->append(static_cast<double>(id) * 0.005, id, plane.data()));
  }
  capture.close();
}

inline constexpr const char* kReplay = "type = 'replay'\nfile = 'in.h5'\n";

class BolodRun : public tools::test::ProgramTest {
 protected:
  explicit BolodRun(std::vector<std::string> words = {BOLO_PROGRAM})
      : ProgramTest(std::move(words)),
        name_(std::string("test-") + testing::UnitTest::GetInstance()->current_test_info()->name() + "-" +
              std::to_string(getpid())) {
    std::ranges::replace(name_, '/', '-');                       // parametrised tests
    setenv("RUNTIME_DIRECTORY", testing::TempDir().c_str(), 1);  // for the control sockets of started daemons
  }
  ~BolodRun() override {
    for (const char* of : {"/bolo.", "/bolo-lock."}) shm_unlink((of + name_).c_str());  // of killed daemons
  }

  // Writes a configuration from the contents of [source] and the text after it; returns its path.
  std::string configure(const std::string& source, const std::string& more = "") const {
    return write("bolod.toml",
                 "name = '" + name_ + "'\n[source]\n" + source + "[pipeline]\nlock_memory = false\n" + more);
  }

  // Starts a daemon that replays `frames` frames at their own rate.
  std::unique_ptr<Program> start(std::uint64_t frames, const std::string& more = "") {
    write_capture(folder_ / "in.h5", frames);
    return start_again(more);
  }
  std::unique_ptr<Program> start_again(const std::string& more = "", const std::string& log = "daemon") {
    return start_with(configure(kReplay, more), log);
  }
  std::unique_ptr<Program> start_with(const std::string& config, const std::string& log = "daemon") const {
    return std::make_unique<Program>(std::vector<std::string>{BOLOD_PROGRAM, "--config", config}, file(log));
  }

  // Starts a fake camera at `address` that serves a capture in a loop.
  std::unique_ptr<Program> start_camera(const std::string& address, const std::vector<std::string>& more = {},
                                        const std::string& capture = "in.h5") const {
    std::vector<std::string> words{BOLO_PROGRAM, "fakecam", folder_ / capture, "--interface", address, "--loop"};
    words.insert(words.end(), more.begin(), more.end());
    auto camera = std::make_unique<Program>(words, file("camera"));
    EXPECT_TRUE(eventually([&] { return camera->out().find("serving") != std::string::npos; })) << camera->err();
    return camera;
  }
  // [source] section for that camera.
  static std::string source_at(const std::string& address, const std::string& more) {
    return "address = '" + address + "'\nwidth = 64\nheight = 24\n" + more;
  }

  // A reader of this daemon's stream, once it is published.
  Result<ShmReader> attach(const Program& daemon) const {
    Result<ShmReader> reader = failed("");
    const bool attached = eventually([&] { return (reader = ShmReader::open(name_)).has_value(); });
    if (!attached) throw std::runtime_error(reader.error().message + '\n' + daemon.err());
    return reader;
  }
  nlohmann::json stat() const {
    return nlohmann::json::parse(printed({"stat", name_, "--once", "--json", "--interval", "0.3"}));
  }

  std::string name_;
};

// Calls `take` with each frame from the newest on, except overwritten ones, until it returns true. False: no further
// frames.
template <typename Take>
bool follow(ShmReader& reader, Take take) {
  ReadFrame frame;
  for (std::uint64_t number = reader.published();; ++number) {
    const Outcome outcome = reader.read(number, frame, 60'000);
    if (outcome == Outcome::kOverwritten) continue;
    if (outcome != Outcome::kFrame) return false;
    if (take(frame)) return true;
  }
}

}  // namespace bolo::daemon
