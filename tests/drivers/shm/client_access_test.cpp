// Who may read: a reader in the stream's group, one outside it, and what neither can do.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "tests/drivers/shm/client_rig.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/drivers/shm/unprivileged.hpp"

namespace bolo::shm::client_access_test {

constexpr uid_t kStranger = 4321;
constexpr const char* kGroup = "video";

class ClientAccess : public testing::Test {
 protected:
  void SetUp() override {
    const group* found = getgrnam(kGroup);
    if (geteuid() != 0 || found == nullptr) GTEST_SKIP() << "needs root, to become other users, and a group " << kGroup;
    group_ = found->gr_gid;
    ASSERT_TRUE(sink_.open(format_.format));
  }

  std::string name_ = unique_name("access");
  std::string path_ = "/bolo." + name_;
  Writer format_{name_ + "-unused"};
  ShmSink sink_{{name_, 0, 0640, kGroup}};
  gid_t group_ = 0;
};

TEST_F(ClientAccess, AMemberOfTheGroupReads) {
  const std::vector<std::uint16_t> plane(33 * 7, 1234);
  sink_.publish({FrameMeta{}, 0, plane.data(), plane.data()}, format_.stats);
  const int result = unprivileged({group_}, [&] {
    const Client client = open_client(name_);
    bolo_client_frame frame{};
    if (!client || bolo_client_next(client.get(), 0, &frame) != BOLO_CLIENT_OK) return 1;
    return frame.raw[5] == 1234 && bolo_client_valid(&frame) == 1 ? 0 : 2;
  });
  EXPECT_EQ(result, 0);
}

TEST_F(ClientAccess, OthersAreRefusedInOneLine) {
  const int result = unprivileged({}, [&] {
    bolo_client* client = nullptr;
    if (bolo_client_open(name_.c_str(), 0, &client) != BOLO_CLIENT_DENIED || client != nullptr) return 1;
    const std::string text = bolo_client_error(nullptr);
    const bool clear = text.find("no permission to read shared memory '" + name_ + "'") != std::string::npos &&
                       text.find("shm.group") != std::string::npos && text.find('\n') == std::string::npos;
    return clear ? 0 : 2;
  });
  EXPECT_EQ(result, 0);
}

TEST_F(ClientAccess, AMemberGetsNoWriteAccess) {
  const int result = unprivileged({group_}, [&] {
    if (shm_open(path_.c_str(), O_RDWR, 0) >= 0 || errno != EACCES) return 1;
    const int fd = shm_open(path_.c_str(), O_RDONLY, 0);
    if (fd < 0) return 2;
    if (mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0) != MAP_FAILED) return 3;
    void* memory = mmap(nullptr, 4096, PROT_READ, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED) return 4;
    if (mprotect(memory, 4096, PROT_READ | PROT_WRITE) == 0 || errno != EACCES) return 5;
    if (ftruncate(fd, 0) == 0) return 6;
    if (shm_unlink(path_.c_str()) == 0) return 7;
    return open(("/proc/self/fd/" + std::to_string(fd)).c_str(), O_RDWR) < 0 ? 0 : 8;
  });
  EXPECT_EQ(result, 0) << "the number of the first thing that should have been refused";
}

// Anybody may make shared memory of any name: a reader checks its owner.
TEST_F(ClientAccess, AStrangersObjectIsNotBelieved) {
  ASSERT_EQ(chown(("/dev/shm" + path_).c_str(), kStranger, group_), 0);
  ASSERT_EQ(chmod(("/dev/shm" + path_).c_str(), 0644), 0);
  const auto open_as = [&](const char* trusted) {
    setenv("BOLO_USER", trusted, 1);
    bolo_client* client = nullptr;
    const int result = bolo_client_open(name_.c_str(), 0, &client);
    bolo_client_close(client);
    return result;
  };
  const int as_nobody = unprivileged({}, [&] {
    if (open_as("") != BOLO_CLIENT_DENIED || open_as("65534") != BOLO_CLIENT_DENIED) return 1;
    const std::string text = bolo_client_error(nullptr);
    if (text.find("belongs to user 4321, not to bolo") == std::string::npos) return 2;
    if (open_as("no such user") != BOLO_CLIENT_DENIED || open_as("4321x") != BOLO_CLIENT_DENIED) return 3;
    return open_as("4321") == BOLO_CLIENT_OK ? 0 : 4;
  });
  EXPECT_EQ(as_nobody, 0) << "the number of the first thing that was wrong";
  const auto stranger_gets = [&](const char* trusted) {
    return unprivileged(
        {}, [&] { return open_as(trusted); }, kStranger);
  };
  EXPECT_EQ(stranger_gets(""), BOLO_CLIENT_OK) << "his own";
  EXPECT_EQ(open_as(""), BOLO_CLIENT_DENIED) << "by root";
  ASSERT_EQ(chown(("/dev/shm" + path_).c_str(), kNobody, group_), 0);
  EXPECT_EQ(stranger_gets("nobody"), BOLO_CLIENT_OK) << "named";
  ASSERT_EQ(chown(("/dev/shm" + path_).c_str(), 0, group_), 0);
  EXPECT_EQ(unprivileged({}, [&] { return open_as(""); }), BOLO_CLIENT_OK) << "root's";
  unsetenv("BOLO_USER");
}

// The library's mapping is read-only even for those who may write: the owner itself, and root.
TEST_F(ClientAccess, TheLibraryMapsReadOnly) {
  const std::vector<std::uint16_t> plane(33 * 7, 1234);
  sink_.publish({FrameMeta{}, 0, plane.data(), plane.data()}, format_.stats);
  const Client client = open_client(name_);
  ASSERT_TRUE(client);
  bolo_client_frame frame{};
  ASSERT_EQ(bolo_client_next(client.get(), 0, &frame), BOLO_CLIENT_OK);
  const auto page = reinterpret_cast<std::uintptr_t>(frame.raw) & ~std::uintptr_t{4095};
  EXPECT_NE(mprotect(reinterpret_cast<void*>(page), 4096, PROT_READ | PROT_WRITE), 0);  // NOLINT
  EXPECT_EQ(errno, EACCES);
}

}  // namespace bolo::shm::client_access_test
