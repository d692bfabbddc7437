// libbolo-client on hostile segments: for any header, settings and slots it answers, and reads only within the
// segment. Access rights: a reader in the stream's group, one outside it, and what neither may do.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "tests/drivers/shm/client_rig.hpp"
#include "tests/drivers/shm/foreign_object.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/drivers/shm/unprivileged.hpp"

namespace bolo::shm::client_hostile_test {

// A valid stream with 40 frames, as bytes.
std::string good_bytes() {
  const std::string name = unique_name("hostile-model");
  Writer writer(name, {16, 4});
  if (!writer.open()) return {};
  for (int i = 0; i < 40; ++i) writer.publish();
  std::ifstream file("/dev/shm/bolo." + name, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Calls every function of the client; the answers do not matter.
bool use(const std::string& name) {
  const Client client = open_client(name);
  if (!client) {
    EXPECT_STRNE(bolo_client_error(nullptr), "");
    return false;
  }
  const bolo_client_info& info = *bolo_client_get_info(client.get());
  EXPECT_LT(std::strlen(info.camera_model) + std::strlen(info.camera_serial) + std::strlen(info.solver), 200U);
  EXPECT_LT(std::strlen(info.control_socket), 112U);
  std::vector<std::uint16_t> plane(std::size_t{info.width} * info.height);
  bolo_client_frame frame{};
  const bolo_client_point points[] = {{0, 0}, {info.width - 1, info.height - 1}};
  float kelvin[2] = {};
  for (int i = 0; i < 3; ++i) {
    bolo_client_get_state(client.get());
    bolo_client_points(client.get(), 20, points, 2, kelvin);
    if (bolo_client_next(client.get(), 0, &frame) != BOLO_CLIENT_OK) continue;
    bolo_client_copy(&frame, plane.data(), plane.data());
    bolo_client_points(client.get(), frame.number, points, 2, kelvin);
    bolo_client_kelvin(client.get(), frame.raw, 2, kelvin);
    bolo_client_valid(&frame);
  }
  return true;
}

TEST(ClientHostile, RandomLiesAreAnsweredNotBelieved) {
  const std::string good = good_bytes();
  ASSERT_GT(good.size(), sizeof(bolo_shm_header));
  const ForeignObject object(unique_name("client-hostile"));
  constexpr std::size_t kHeadBytes =
      sizeof(bolo_shm_header) + sizeof(bolo_shm_settings) + sizeof(bolo_shm_camera) + sizeof(bolo_shm_slot);
  std::mt19937_64 random(11);  // NOLINT: the same damage each time
  int accepted = 0;
  for (int round = 0; round < 1500; ++round) {
    std::string bytes = good;
    for (std::uint64_t lies = 1 + random() % 3; lies > 0; --lies) {
      // Every second round hits the fields that define sizes and offsets, the others anything before the planes.
      const std::size_t at = round % 2 == 0 ? 8 + random() % 104 : 8 + random() % (kHeadBytes - 16);
      const std::uint64_t word = random() >> random() % 64;
      std::memcpy(bytes.data() + at, &word, 1 + random() % 8);
    }
    object.fill(bytes.data(), bytes.size(), bytes.size());
    accepted += use(object.name()) ? 1 : 0;
  }
  EXPECT_GT(accepted, 100) << "the lies must also leave readable headers";
}

// Well-formed but wrong values, one at a time in an otherwise valid stream.
TEST(ClientHostile, NonsenseInSettingsIsRefusedWhenPointsAreAskedFor) {
  const std::string good = good_bytes();
  const ForeignObject object(unique_name("client-nonsense"));
  struct Lie {
    const char* what;
    std::size_t at;
    std::uint64_t value;
    std::size_t bytes;
  };
  const std::uint64_t nan = 0x7ff8000000000000ULL;
  const std::size_t settings = sizeof(bolo_shm_header);
  const Lie lies[] = {
      {"tau 0", offsetof(bolo_shm_header, tau_s), 0, 8},
      {"tau nan", offsetof(bolo_shm_header, tau_s), nan, 8},
      {"window 0", offsetof(bolo_shm_header, window), 0, 4},
      {"window huge", offsetof(bolo_shm_header, window), 0x7fffffff, 4},
      {"lookahead huge", offsetof(bolo_shm_header, lookahead), 0x7fffffff, 4},
      {"method", settings + offsetof(bolo_shm_settings, method), 77, 4},
      {"levels", settings + offsetof(bolo_shm_settings, levels), 0x7fffffff, 4},
      {"iterations", settings + offsetof(bolo_shm_settings, iterations), 0x7fffffff, 4},
      {"kappa nan", settings + offsetof(bolo_shm_settings, kappa), nan, 8},
      {"lambda nan", settings + offsetof(bolo_shm_settings, lambda), nan, 8},
      {"isa", settings + offsetof(bolo_shm_settings, isa), 0x3132333435363738ULL, 8},
  };
  const bolo_client_point point{1, 1};
  for (const Lie& lie : lies) {
    std::string bytes = good;
    std::memcpy(bytes.data() + lie.at, &lie.value, lie.bytes);
    object.fill(bytes.data(), bytes.size(), bytes.size());
    const Client client = open_client(object.name());
    ASSERT_TRUE(client) << lie.what;
    float kelvin = 0.0F;
    EXPECT_EQ(bolo_client_points(client.get(), 20, &point, 1, &kelvin), BOLO_CLIENT_UNSUPPORTED) << lie.what;
    EXPECT_STRNE(bolo_client_error(client.get()), "") << lie.what;
  }
}

TEST(ClientHostile, APeriodThatIsNoneIsRefusedAtOnce) {
  const ForeignObject object(unique_name("client-period"));
  for (const double period_s : {0.0, -0.005, std::nan("")}) {
    std::string bytes = good_bytes();
    std::memcpy(bytes.data() + offsetof(bolo_shm_header, frame_period_s), &period_s, sizeof period_s);
    object.fill(bytes.data(), bytes.size(), bytes.size());
    bolo_client* client = nullptr;
    EXPECT_EQ(bolo_client_open(object.name().c_str(), 0, &client), BOLO_CLIENT_BAD_STREAM) << period_s;
    EXPECT_EQ(client, nullptr);
  }
}

// A stream's writer can truncate it at any moment.
TEST(ClientHostile, AStreamThatIsCutOffIsOneThatEnded) {
  std::string bytes = good_bytes();
  const auto now_ns = static_cast<std::uint64_t>(monotonic_ns());
  std::memcpy(bytes.data() + offsetof(bolo_shm_header, heartbeat_ns), &now_ns, sizeof now_ns);
  const ForeignObject object(unique_name("client-cut"));
  for (const std::size_t left : {std::size_t{0}, sizeof(bolo_shm_header), std::size_t{4096}}) {
    object.fill(bytes.data(), bytes.size(), bytes.size());
    const Client client = open_client(object.name());
    ASSERT_TRUE(client);
    bolo_client_frame frame{};
    ASSERT_EQ(bolo_client_next(client.get(), 0, &frame), BOLO_CLIENT_OK);
    object.cut(left);
    EXPECT_EQ(frame.raw[0] + frame.raw[63], 0) << "zeros";
    EXPECT_EQ(bolo_client_valid(&frame), 0);
    EXPECT_EQ(bolo_client_next(client.get(), 0, &frame), BOLO_CLIENT_ENDED);
    EXPECT_EQ(bolo_client_get_state(client.get())->alive, 0U);
  }
}

// Bus errors from elsewhere still end the process.
TEST(ClientHostile, OtherBusErrorsGoWhereTheyWent) {
  const ForeignObject object(unique_name("client-bus"));
  const std::string bytes = good_bytes();
  object.fill(bytes.data(), bytes.size(), bytes.size());
  const auto fault = [&] {
    const Client client = open_client(object.name());
    const int fd = memfd_create("mine", 0);
    const auto* mine = static_cast<const volatile char*>(mmap(nullptr, 4096, PROT_READ, MAP_SHARED, fd, 0));
    const char value = *mine;
    _exit(value);
  };
  EXPECT_EXIT(fault(), testing::KilledBySignal(SIGBUS), "");
  EXPECT_EXIT(
      {
        const Client client = open_client(object.name());
        raise(SIGBUS);
      },
      testing::KilledBySignal(SIGBUS), "");
}

// --- Access rights.

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

// Any user can create shared memory of any name: a reader checks the owner.
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

// The library maps read-only even for users who may write: the owner and root.
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

}  // namespace bolo::shm::client_hostile_test
