// libbolo-client on segments that lie: whatever their header, settings and slots say, it answers and reads inside.
#include "tests/drivers/shm/client_rig.hpp"
#include "tests/drivers/shm/foreign_object.hpp"
#include "tests/drivers/shm/shm_rig.hpp"

namespace bolo::shm::client_hostile_test {

// The bytes of a stream with 40 frames in it.
std::string good_bytes() {
  const std::string name = unique_name("hostile-model");
  Writer writer(name, {16, 4});
  if (!writer.open()) return {};
  for (int i = 0; i < 40; ++i) writer.publish();
  std::ifstream file("/dev/shm/bolo." + name, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Everything that a program may ask; what it answers is not the point.
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
      // Every second one in what decides on sizes and places, the others anywhere before the planes.
      const std::size_t at = round % 2 == 0 ? 8 + random() % 104 : 8 + random() % (kHeadBytes - 16);
      const std::uint64_t word = random() >> random() % 64;
      std::memcpy(bytes.data() + at, &word, 1 + random() % 8);
    }
    object.fill(bytes.data(), bytes.size(), bytes.size());
    accepted += use(object.name()) ? 1 : 0;
  }
  EXPECT_GT(accepted, 100) << "the lies must also leave readable headers";
}

// Values that are whole, and wrong: each by itself in an otherwise good stream.
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

// Whoever may write a stream may make it shorter under its readers, at any moment.
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

// Errors that are not ours end the process as ever.
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

}  // namespace bolo::shm::client_hostile_test
