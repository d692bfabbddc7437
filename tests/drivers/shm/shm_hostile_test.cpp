// Foreign or corrupted objects: the reader refuses them and never reads outside.
#include <sys/stat.h>

#include "tests/drivers/shm/foreign_object.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/refusal.hpp"

namespace bolo::shm::shm_hostile_test {

// A valid header for an object of kBytes.
constexpr std::size_t kSlot = sizeof(bolo_shm_slot) + 2 * 64;
constexpr std::size_t kBytes = sizeof(bolo_shm_header) + 4 * kSlot;
bolo_shm_header good_header() {
  bolo_shm_header h{};
  h.magic = BOLO_SHM_MAGIC;
  h.version = BOLO_SHM_VERSION;
  h.header_bytes = sizeof(h);
  h.width = 5;
  h.height = 5;
  h.slot_count = 4;
  h.scale = 0.01;
  h.frame_period_s = 0.005;
  h.slots_offset = sizeof(h);
  h.slot_stride = kSlot;
  h.raw_offset = sizeof(bolo_shm_slot);
  h.deblurred_offset = sizeof(bolo_shm_slot) + 64;
  h.motion_across = h.motion_down = 1;  // ignored without motion_offset
  h.state = BOLO_SHM_RUNNING;
  h.published = 3;
  h.heartbeat_ns = static_cast<std::uint64_t>(monotonic_ns());
  return h;
}

TEST(ShmHostile, EachImpossibleFieldIsRefused) {
  const ForeignObject object(unique_name("fields"));
  constexpr std::uint64_t kHuge = ~std::uint64_t{0} - 7;
  const bolo_shm_header good = good_header();
  object.fill(&good, sizeof good, kBytes);
  ASSERT_TRUE(ShmReader::open(object.name()));
  const std::vector<std::pair<const char*, std::function<void(bolo_shm_header&)>>> cases{
      {"magic", [](auto& h) { h.magic += 1; }},
      {"starting", [](auto& h) { h.magic = 0; }},
      {"a later version", [](auto& h) { h.version = BOLO_SHM_VERSION + 1; }},
      {"the version before", [](auto& h) { h.version = BOLO_SHM_VERSION - 1; }},
      {"a row delay that is no number", [](auto& h) { h.row_delay_s = std::numeric_limits<double>::quiet_NaN(); }},
      {"an earlier version", [](auto& h) { h.version = 1; }},
      {"header_bytes", [](auto& h) { h.header_bytes = 64; }},
      {"header_bytes past slots", [](auto& h) { h.header_bytes = sizeof(h) + 64; }},
      {"width 0", [](auto& h) { h.width = 0; }},
      {"height 0", [](auto& h) { h.height = 0; }},
      {"width huge", [](auto& h) { h.width = 0xffffffff; }},
      {"height huge", [](auto& h) { h.height = 0x80000001; }},
      {"plane too large", [](auto& h) { h.width = 7; }},
      {"slot_count 0", [](auto& h) { h.slot_count = 0; }},
      {"slot_count + 1", [](auto& h) { h.slot_count = 5; }},
      {"slot_count huge", [](auto& h) { h.slot_count = 0xffffffff; }},
      {"unit", [](auto& h) { h.unit = 7; }},
      {"scale", [](auto& h) { h.scale = std::nan(""); }},
      {"offset", [](auto& h) { h.offset = HUGE_VAL; }},
      {"period 0", [](auto& h) { h.frame_period_s = 0.0; }},
      {"period", [](auto& h) { h.frame_period_s = std::nan(""); }},
      {"period of next to nothing", [](auto& h) { h.frame_period_s = 1e-300; }},
      {"slots_offset in header", [](auto& h) { h.slots_offset = 64; }},
      {"slots_offset odd", [](auto& h) { h.slots_offset += 1; }},
      {"slots_offset past end", [](auto& h) { h.slots_offset += 8; }},
      {"slots_offset huge", [](auto& h) { h.slots_offset = kHuge; }},
      {"stride 0", [](auto& h) { h.slot_stride = 0; }},
      {"stride odd", [](auto& h) { h.slot_stride -= 1; }},
      {"stride huge", [](auto& h) { h.slot_stride = kHuge; }},
      {"raw in head", [](auto& h) { h.raw_offset = 8; }},
      {"raw odd", [](auto& h) { h.raw_offset += 1; }},
      {"raw past end", [](auto& h) { h.raw_offset = kSlot - 48; }},
      {"raw huge", [](auto& h) { h.raw_offset = kHuge; }},
      {"deblurred past end", [](auto& h) { h.deblurred_offset = kSlot - 48; }},
      {"deblurred huge", [](auto& h) { h.deblurred_offset = kHuge; }},
      {"motion in head", [](auto& h) { h.motion_offset = 8; }},
      {"motion odd", [](auto& h) { h.motion_offset = sizeof(bolo_shm_slot) + 1; }},
      {"motion past end", [](auto& h) { h.motion_offset = kSlot - 72; }},
      {"motion huge", [](auto& h) { h.motion_offset = kHuge; }},
      {"motion of no block", [](auto& h) { h.motion_offset = sizeof(bolo_shm_slot), h.motion_across = 0; }},
      {"motion of too many", [](auto& h) { h.motion_offset = sizeof(bolo_shm_slot), h.motion_down = 2; }},
      {"motion of very many",
       [](auto& h) { h.motion_offset = sizeof(bolo_shm_slot), h.motion_across = h.motion_down = 0x80000001; }},
  };
  for (const auto& [what, damage] : cases) {
    bolo_shm_header header = good_header();
    damage(header);
    object.fill(&header, sizeof(header), kBytes);
    SCOPED_TRACE(what);
    expect_refused(ShmReader::open(object.name()), {object.name()});
  }
}

// With today's size, and with that before motion was added.
TEST(ShmHostile, AnotherVersionSaysWhatToDo) {
  const ForeignObject object(unique_name("version"));
  for (const std::size_t bytes : {sizeof(bolo_shm_header), std::size_t{2048}}) {
    bolo_shm_header header = good_header();
    header.version = 1;
    header.header_bytes = static_cast<std::uint32_t>(bytes);
    object.fill(&header, bytes, bytes + 4 * (64 + 2 * 64));
    Refusal refusal = Refusal::kNone;
    expect_error(ShmReader::open(object.name(), &refusal), {"another layout version: use the same release"});
    EXPECT_EQ(refusal, Refusal::kBadLayout);
  }
}

// A writer older than the camera's PTP state: the other camera fields are read, and nothing beyond.
TEST(ShmHostile, AShorterCameraIsReadAsFarAsItGoes) {
  constexpr std::size_t kSettingsAt = sizeof(bolo_shm_header);
  constexpr std::size_t kCameraAt = kSettingsAt + sizeof(bolo_shm_settings);
  const auto camera_of = [&](std::uint64_t bytes, std::size_t slots_at) {
    std::vector<char> memory(slots_at + 4 * kSlot, '\x07');
    bolo_shm_header header = good_header();
    header.settings_offset = kSettingsAt;
    header.slots_offset = slots_at;
    bolo_shm_settings settings{};
    settings.bytes = sizeof(settings);
    settings.camera_offset = kCameraAt;
    bolo_shm_camera camera{};
    camera.bytes = bytes;
    camera.reopened = 5;
    camera.ptp = 9;
    camera.ptp_offset_ns = -37;
    std::memcpy(memory.data(), &header, sizeof(header));
    std::memcpy(memory.data() + kSettingsAt, &settings, sizeof(settings));
    std::memcpy(memory.data() + kCameraAt, &camera, std::min(sizeof(camera), slots_at - kCameraAt));
    const ForeignObject object(unique_name("camera"));
    object.fill(memory.data(), memory.size(), memory.size());
    return must(ShmReader::open(object.name()))->camera();
  };
  constexpr std::size_t kLong = kCameraAt + sizeof(bolo_shm_camera);
  const auto whole = camera_of(sizeof(bolo_shm_camera), kLong);
  ASSERT_TRUE(whole);
  EXPECT_EQ(whole->ptp, 9U);
  for (const std::size_t slots_at : {kCameraAt + BOLO_SHM_CAMERA_BYTES_FIRST, kLong}) {
    const auto first = camera_of(BOLO_SHM_CAMERA_BYTES_FIRST, slots_at);
    ASSERT_TRUE(first);
    EXPECT_EQ(first->reopened, 5U);
    EXPECT_EQ(first->ptp, 0U);
    EXPECT_EQ(first->ptp_offset_ns, 0);
  }
  const auto lying = camera_of(sizeof(bolo_shm_camera), kCameraAt + BOLO_SHM_CAMERA_BYTES_FIRST);
  ASSERT_TRUE(lying);
  EXPECT_EQ(lying->ptp, 0U);
  EXPECT_FALSE(camera_of(BOLO_SHM_CAMERA_BYTES_FIRST - 8, kLong));
}

// A slot whose number of blocks differs from the stream's carries no motion.
TEST(ShmHostile, OnlyTheStreamsOwnNumberOfBlocksIsMotion) {
  const SlotLayout layout = slot_layout(50, 1);
  for (const std::uint32_t claimed : {0U, 1U, 2U, 0xffffffffU}) {
    bolo_shm_slot head{};
    head.motion_blocks = claimed;
    EXPECT_EQ(has_motion(layout, head), claimed == 1) << claimed;
    EXPECT_FALSE(has_motion(slot_layout(50), head)) << claimed;
  }
}

TEST(ShmHostile, ShortObjectsAreRefused) {
  const ForeignObject object(unique_name("short"));
  const bolo_shm_header header = good_header();
  for (std::size_t total = 0; total < kBytes; total += total < 16 ? 1 : 61) {
    object.fill(&header, sizeof(header), total);
    EXPECT_FALSE(ShmReader::open(object.name())) << total << " bytes";
  }
}

// Opening a pipe for reading would block, and any user can create one.
TEST(ShmHostile, APipeOfTheNameKeepsNobodyWaiting) {
  const std::string name = unique_name("pipe");
  const std::string place = "/dev/shm/bolo." + name;
  ASSERT_EQ(mkfifo(place.c_str(), 0600), 0);
  EXPECT_FALSE(ShmReader::open(name));
  ::unlink(place.c_str());
}

// Corrupted headers are refused or read within their object; sanitizers and the page after the mapping watch.
TEST(ShmHostile, RandomDamageNeverReadsOutside) {
  const ForeignObject object(unique_name("random"));
  std::mt19937_64 random(7);  // NOLINT: the same damage each time
  ReadFrame frame;
  int accepted = 0;
  for (int round = 0; round < 3000; ++round) {
    bolo_shm_header header = good_header();
    auto* bytes = reinterpret_cast<unsigned char*>(&header);
    const int flips = 1 + static_cast<int>(random() % 3);
    for (int i = 0; i < flips; ++i) bytes[8 + random() % 100] ^= static_cast<unsigned char>(1U << random() % 8);
    if (round % 4 == 0) {
      header.heartbeat_ns = random();
      header.published = random();
      header.state = static_cast<std::uint32_t>(random());
    }
    object.fill(&header, sizeof(header), kBytes);
    auto reader = ShmReader::open(object.name());
    if (!reader) continue;
    ++accepted;
    EXPECT_LE(std::size_t{2} * reader->header().width * reader->header().height, kBytes);
    for (const std::uint64_t n : {std::uint64_t{0}, std::uint64_t{2}, header.published - 1, ~std::uint64_t{0}}) {
      EXPECT_NE(reader->read(n, frame, 0), ShmReader::Outcome::kFrame) << "no slot was ever written";
    }
  }
  EXPECT_GT(accepted, 100) << "the damage must also leave readable headers";
}

}  // namespace bolo::shm::shm_hostile_test
