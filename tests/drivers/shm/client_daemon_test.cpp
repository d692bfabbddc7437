// Readers and real daemons: one that is killed, its successor, and a rival.
#include <gtest/gtest.h>
#include <sys/mman.h>

#include <filesystem>

#include "src/capture/capture.hpp"
#include "tests/drivers/shm/client_rig.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/tools/program.hpp"

namespace bolo::shm {
namespace {

using tools::test::Program;

void write_capture(const std::filesystem::path& file, Geometry geometry) {
  capture::CaptureInfo info;
  info.format.geometry = geometry;
  auto writer = capture::CaptureWriter::create(file, info, {.replace = Replace::kExisting});
  ASSERT_TRUE(writer) << writer.error().message;
  const std::vector<std::uint16_t> plane(geometry.pixels(), 30'000);
  for (std::uint64_t id = 0; id < 100; ++id) {
    ASSERT_TRUE(writer->append(static_cast<double>(id) * 0.005, id, plane.data()));
  }
  ASSERT_TRUE(writer->close());
}

class ClientDaemon : public testing::Test {
 protected:
  ClientDaemon()
      : name_(unique_name(testing::UnitTest::GetInstance()->current_test_info()->name())),
        folder_(testing::TempDir() + name_) {
    std::filesystem::create_directory(folder_);
    setenv("RUNTIME_DIRECTORY", folder_.c_str(), 1);
  }
  ~ClientDaemon() override {
    std::filesystem::remove_all(folder_);
    shm_unlink(("/bolo." + name_).c_str());  // of a daemon that was killed
  }

  // The daemon with a capture of this size for a camera, again and again.
  std::unique_ptr<Program> start(Geometry geometry, const std::string& log) {
    const std::string capture = folder_ / (log + ".h5");
    write_capture(capture, geometry);
    return std::make_unique<Program>(
        std::vector<std::string>{BOLO_PROGRAM, "replay", capture, "--name", name_, "--loop"}, folder_ / log);
  }

  std::string name_;
  std::filesystem::path folder_;
};

TEST_F(ClientDaemon, AKilledDaemonsSuccessorIsFollowed) {
  const auto first = start({16, 8}, "first");
  const Client client = open_client(name_, 60'000);
  ASSERT_TRUE(client) << bolo_client_error(nullptr) << first->err();
  bolo_client_frame frame{};
  for (int i = 0; i < 5; ++i) ASSERT_EQ(bolo_client_next(client.get(), 60'000, &frame), BOLO_CLIENT_OK);
  first->signal(SIGKILL);
  first->wait();
  const std::int64_t killed_ns = monotonic_ns();
  const auto second = start({8, 4}, "second");
  int result = BOLO_CLIENT_OK;
  while (result == BOLO_CLIENT_OK) result = bolo_client_next(client.get(), 60'000, &frame);
  ASSERT_EQ(result, BOLO_CLIENT_RESTARTED) << second->err();
  EXPECT_EQ(bolo_client_get_info(client.get())->width, 8U);
  ASSERT_EQ(bolo_client_next(client.get(), 60'000, &frame), BOLO_CLIENT_OK);
  RecordProperty("ms_from_kill_to_frame", static_cast<int>((monotonic_ns() - killed_ns) / 1'000'000));
  EXPECT_EQ(frame.width, 8U);
  EXPECT_EQ(frame.raw[0], 30'000U);
  second->signal(SIGTERM);
  EXPECT_EQ(second->wait(), 0) << second->err();
  while (result != BOLO_CLIENT_ENDED) {
    result = bolo_client_next(client.get(), 1000, &frame);
    ASSERT_GE(result, 0);
  }
}

TEST_F(ClientDaemon, ARivalIsRefusedAndReadersStay) {
  const auto first = start({16, 8}, "first");
  const Client client = open_client(name_, 60'000);
  ASSERT_TRUE(client) << bolo_client_error(nullptr);
  const auto rival = start({8, 4}, "rival");
  EXPECT_EQ(rival->wait(), 2);
  EXPECT_NE(rival->err().find("is written by process " + std::to_string(first->pid())), std::string::npos)
      << rival->err();
  bolo_client_frame frame{};
  for (int i = 0; i < 5; ++i) ASSERT_EQ(bolo_client_next(client.get(), 60'000, &frame), BOLO_CLIENT_OK);
  EXPECT_EQ(bolo_client_get_info(client.get())->restarts, 0U);
  EXPECT_EQ(frame.width, 16U);
}

}  // namespace
}  // namespace bolo::shm
