#include "drivers/shm/shm_reader.hpp"

#include <fcntl.h>
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <thread>
#include <utility>

#include "drivers/shm/shm_object.hpp"
#include "src/core/clock.hpp"
#include "src/core/scene_motion.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::shm {

// Read-only, so that a reader cannot affect the writer.
class Mapping {
 public:
  Mapping(std::string name, void* data, const struct stat& object)
      : name_(std::move(name)),
        memory_(data, static_cast<std::size_t>(object.st_size), PROT_READ),
        inode_(object.st_ino) {}

  const std::string& name() const noexcept { return name_; }
  ino_t inode() const noexcept { return inode_; }  // unique while the object is mapped
  const std::byte* data() const noexcept { return memory_.data(); }
  std::size_t bytes() const noexcept { return memory_.bytes(); }
  const bolo_shm_header& header() const noexcept { return *reinterpret_cast<const bolo_shm_header*>(data()); }

 private:
  std::string name_;
  GuardedMapping memory_;
  ino_t inode_;
};

namespace {

constexpr std::uint32_t kMaxSide = 1U << 15;
constexpr std::uint32_t kMaxSlots = 1U << 20;
constexpr double kMinPeriod_s = 1e-6;
constexpr double kMaxPeriod_s = 3600.0;
constexpr double kShortestSleepNs = 1e6;
constexpr double kLongestSleepNs = 1e8;  // maximum delay until a stopped heartbeat is noticed
constexpr auto kPollPeriod = std::chrono::milliseconds(1);

struct Refused {
  Refusal refusal = Refusal::kFailed;
  Error error;
};
template <typename T>
using Opened = tl::expected<T, Refused>;

tl::unexpected<Refused> refuse(Refusal refusal, std::string message) {
  return tl::unexpected<Refused>({refusal, {ErrorKind::kBadInput, std::move(message)}});
}

std::string existing_names() {
  std::string list;
  for (const std::string& name : object_names()) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "none exists: is bolod running?" : "there is: " + list;
}

tl::unexpected<Refused> cannot_open(const std::string& name, int error) {
  if (error == ENOENT) return refuse(Refusal::kAbsent, "no shared memory named '" + name + "'; " + existing_names());
  if (error == EACCES) {
    return refuse(Refusal::kDenied, "no permission to read shared memory '" + name +
                                        "'; join the group that it belongs to, or see shm.mode and shm.group");
  }
  return tl::unexpected<Refused>(
      {Refusal::kFailed, {ErrorKind::kFailed, "cannot open shared memory '" + name + "': " + std::strerror(error)}});
}

tl::unexpected<Refused> not_trusted(const std::string& name, uid_t owner) {
  return refuse(Refusal::kForeign,
                "shared memory '" + name + "' belongs to " + describe_user(owner) +
                    ", not to bolo, root or this user; if it is your daemon's, set BOLO_USER to that "
                    "user's name or number");
}

Opened<std::shared_ptr<const Mapping>> map_object(const std::string& name) {
  const Result<std::string> path = object_path(name);
  if (!path) return refuse(Refusal::kBadName, path.error().message);
  const UniqueFd fd(shm_open(path->c_str(), O_RDONLY | O_NONBLOCK, 0));  // anybody can put a pipe there
  if (!fd) return cannot_open(name, errno);
  struct stat status {};
  if (fstat(fd.get(), &status) != 0) return cannot_open(name, errno);
  if (!is_trusted(status.st_uid)) return not_trusted(name, status.st_uid);
  const auto bytes = static_cast<std::size_t>(status.st_size);
  void* memory = MAP_FAILED;
  if (bytes >= sizeof(bolo_shm_header)) memory = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, fd.get(), 0);
  if (memory != MAP_FAILED) return std::make_shared<Mapping>(name, memory, status);
  return refuse(Refusal::kNotReady, "shared memory '" + name + "' has no header yet; try again, or restart its daemon");
}

// Copies the header by atomic words, because its counters change concurrently.
bolo_shm_header snapshot(const Mapping& mapping) noexcept {
  bolo_shm_header header{};
  copy_out(&header, mapping.data(), sizeof(header));
  return header;
}

bool is_period(double s) noexcept { return s >= kMinPeriod_s && s <= kMaxPeriod_s; }

// The first fault of a header, or nullptr. Everything is checked before use, because the object may come from another
// program; sums are arranged so that they cannot wrap.
const char* first_fault(const bolo_shm_header& h, std::size_t bytes) {
  if (h.magic != BOLO_SHM_MAGIC) return "no magic number: it is being set up, or not Bolo's";
  if (h.version != BOLO_SHM_VERSION) return "another layout version: use the same release on both sides";
  if (h.header_bytes < sizeof(bolo_shm_header)) return "its header is too short";
  if (h.width == 0 || h.width > kMaxSide || h.height == 0 || h.height > kMaxSide) return "impossible frame size";
  if (h.slot_count == 0 || h.slot_count > kMaxSlots) return "impossible number of slots";
  if (h.unit != BOLO_UNIT_KELVIN && h.unit != BOLO_UNIT_COUNT) return "unknown unit";
  if (!std::isfinite(h.scale) || !std::isfinite(h.offset)) return "impossible scale";
  if (!std::isfinite(h.row_delay_s)) return "impossible row delay";
  if (!is_period(h.frame_period_s)) return "impossible frame period";
  const std::uint64_t plane = round_up(std::size_t{2} * h.width * h.height, kWord);  // below 2^32
  const auto aligned = [](std::uint64_t offset) { return offset % kWord == 0; };
  const auto plane_fits = [&](std::uint64_t offset) {
    return aligned(offset) && offset >= sizeof(bolo_shm_slot) && offset <= h.slot_stride &&
           h.slot_stride - offset >= plane;
  };
  if (!aligned(h.slot_stride) || h.slot_stride > bytes) return "impossible slot size";
  if (!plane_fits(h.raw_offset) || !plane_fits(h.deblurred_offset)) return "a plane does not fit in its slot";
  if (h.motion_offset != 0) {
    const std::uint64_t blocks = std::uint64_t{h.motion_across} * h.motion_down;
    const Geometry expected = motion_blocks({static_cast<int>(h.width), static_cast<int>(h.height)});
    if (blocks != expected.pixels() || h.motion_across != static_cast<std::uint32_t>(expected.width)) {
      return "impossible number of motion's blocks";
    }
    const std::uint64_t room = round_up(motion_bytes(blocks), kWord);
    const bool fits = aligned(h.motion_offset) && h.motion_offset >= sizeof(bolo_shm_slot) &&
                      h.motion_offset <= h.slot_stride && h.slot_stride - h.motion_offset >= room;
    if (!fits) return "the motion does not fit in its slot";
  }
  if (!aligned(h.slots_offset) || h.slots_offset < h.header_bytes || h.slots_offset > bytes) {
    return "impossible place of the slots";
  }
  if ((bytes - h.slots_offset) / h.slot_stride < h.slot_count) return "its slots reach past its end";
  return nullptr;
}

template <std::size_t N>
void end_text(char (&text)[N]) {
  text[N - 1] = '\0';
}

// The valid header of an object.
Opened<bolo_shm_header> checked_header(const Mapping& mapping) {
  load_acquire(mapping.header().magic);  // partner: the last store of ShmSink::open; publishes the complete header
  bolo_shm_header header = snapshot(mapping);
  if (const char* fault = first_fault(header, mapping.bytes())) {
    return refuse(header.magic == 0 ? Refusal::kNotReady : Refusal::kBadLayout,
                  "shared memory '" + mapping.name() + "' can't be read: " + fault);
  }
  end_text(header.camera_model);
  end_text(header.camera_serial);
  end_text(header.solver);
  return header;
}

}  // namespace

ShmReader::ShmReader(std::shared_ptr<const Mapping> mapping, const bolo_shm_header& checked)
    : mapping_(std::move(mapping)),
      checked_(checked),
      layout_{checked.raw_offset, checked.deblurred_offset, std::size_t{2} * checked.width * checked.height,
              checked.slot_stride} {
  if (checked.motion_offset == 0) return;
  layout_.motion_offset = checked.motion_offset;
  layout_.motion_blocks = std::size_t{checked.motion_across} * checked.motion_down;
}

const bolo_shm_header& ShmReader::live() const noexcept { return mapping_->header(); }

const std::byte* ShmReader::slot(std::uint64_t number) const noexcept {
  return mapping_->data() + checked_.slots_offset + number % checked_.slot_count * checked_.slot_stride;
}

// Sleeps until the wake word changes or `ns` have passed, but not much longer than a frame period: any reader can move
// others to a futex that nobody wakes (FUTEX_REQUEUE), and then only the timeout does. A spurious wake-up only costs
// one more check.
void ShmReader::sleep(std::uint32_t wake_seen, std::int64_t ns) noexcept {
  constexpr double kPeriods = 1.25;  // a punctual frame comes earlier
  const double most_ns =
      std::clamp(kPeriods * checked_.frame_period_s * kNsPerSecond, kShortestSleepNs, kLongestSleepNs);
  ns = std::min(ns, static_cast<std::int64_t>(most_ns));
  if (!futex_works_) {
    std::this_thread::sleep_for(std::min<std::chrono::nanoseconds>(kPollPeriod, std::chrono::nanoseconds(ns)));
    return;
  }
  const timespec timeout{ns / 1'000'000'000, ns % 1'000'000'000};
  const long result = syscall(SYS_futex, &live().wake, FUTEX_WAIT, wake_seen, &timeout, nullptr, 0);
  if (result == 0 || errno == EAGAIN || errno == EINTR || errno == ETIMEDOUT) return;
  futex_works_ = false;  // refused by a sandbox: poll from now on
}

StreamFormat format_of(const bolo_shm_header& header) {
  StreamFormat format;
  format.geometry = {static_cast<int>(header.width), static_cast<int>(header.height)};
  format.type = PixelType::kUint16;
  format.scale = {header.unit == BOLO_UNIT_KELVIN ? Unit::kKelvin : Unit::kCount, header.scale, header.offset};
  format.frame_period_s = header.frame_period_s;
  format.row_step = static_cast<int>(header.row_step);
  return format;
}

FrameMeta meta_of(const bolo_shm_slot& head) noexcept {
  return {head.frame_id, head.camera_ns, head.receive_ns,        head.flags,
          head.host_ns,  head.utc_ns,    head.utc_uncertainty_ns};
}

Result<ShmReader> ShmReader::open(const std::string& name, Refusal* refusal) {
  auto mapping = map_object(name);
  const auto header = mapping.and_then([](const auto& mapped) { return checked_header(*mapped); });
  if (refusal != nullptr) *refusal = header ? Refusal::kNone : header.error().refusal;
  if (!header) return tl::unexpected<Error>(header.error().error);
  return ShmReader(std::move(*mapping), *header);
}

const std::string& ShmReader::name() const noexcept { return mapping_->name(); }

bolo_shm_header ShmReader::header() const noexcept {
  const std::uint64_t newest = published();  // first: counters are stored before it, so none is older
  bolo_shm_header header = snapshot(*mapping_);
  std::memcpy(&header, &checked_, offsetof(bolo_shm_header, published));
  header.frame_period_s = frame_period_s();
  header.published = newest;
  header.motion_offset = checked_.motion_offset;
  header.motion_across = checked_.motion_across;
  header.motion_down = checked_.motion_down;
  header.row_delay_s = checked_.row_delay_s;
  return header;
}

double ShmReader::frame_period_s() const noexcept {
  double now_s = 0.0;
  copy_out(&now_s, mapping_->data() + offsetof(bolo_shm_header, frame_period_s), sizeof(now_s));
  return is_period(now_s) ? now_s : checked_.frame_period_s;
}

bool ShmReader::read_samples(std::uint64_t number, std::span<const std::uint32_t> pixels, bolo_shm_slot& head,
                             std::uint16_t* out) const noexcept {
  if (number >= published()) return false;
  return shm::read_samples(slot(number), layout_, number, head, pixels, out);
}

std::optional<bolo_shm_settings> ShmReader::settings() const noexcept {
  const bolo_shm_header& h = checked_;
  const bool fits = h.settings_offset % kWord == 0 && h.settings_offset >= sizeof(bolo_shm_header) &&
                    h.settings_offset <= h.slots_offset &&
                    h.slots_offset - h.settings_offset >= sizeof(bolo_shm_settings);
  if (!fits) return std::nullopt;
  bolo_shm_settings settings{};
  copy_out(&settings, mapping_->data() + h.settings_offset, sizeof(settings));
  if (settings.bytes < sizeof(settings)) return std::nullopt;
  end_text(settings.isa);
  return settings;
}

std::optional<bolo_shm_camera> ShmReader::camera() const noexcept {
  const std::optional<bolo_shm_settings> shared = settings();
  if (!shared || shared->camera_offset % kWord != 0) return std::nullopt;
  const std::uint64_t begin = shared->camera_offset;
  const bolo_shm_header& h = checked_;
  if (begin < h.settings_offset + sizeof(bolo_shm_settings) || begin + BOLO_SHM_CAMERA_BYTES_FIRST > h.slots_offset) {
    return std::nullopt;
  }
  const std::byte* const from = mapping_->data() + begin;
  bolo_shm_camera camera{};
  copy_out(&camera.bytes, from, sizeof(camera.bytes));
  // Fields unknown to an older writer stay 0.
  const auto shared_bytes = std::min<std::uint64_t>({sizeof(camera), camera.bytes, h.slots_offset - begin});
  if (shared_bytes < BOLO_SHM_CAMERA_BYTES_FIRST) return std::nullopt;
  copy_out(&camera, from, shared_bytes);
  end_text(camera.control_socket);
  return camera;
}

std::uint64_t ShmReader::published() const noexcept {
  return load_acquire(live().published);  // partner: W4 of ShmSink::publish
}

bool ShmReader::closed() const noexcept {
  const std::uint32_t state = load_acquire(live().state);  // partner: ShmSink::close
  return state == BOLO_SHM_CLOSED || heartbeat_stale(load_relaxed(live().heartbeat_ns));
}

bool ShmReader::replaced() const noexcept {
  const Result<std::string> path = object_path(name());
  struct stat status {};
  return path && stat(("/dev/shm" + *path).c_str(), &status) == 0 && status.st_ino != mapping_->inode();
}

ShmReader::Outcome ShmReader::wait(std::uint64_t number, int timeout_ms) noexcept {
  const std::int64_t deadline_ns =
      timeout_ms < 0 ? std::numeric_limits<std::int64_t>::max() : monotonic_ns() + std::int64_t{timeout_ms} * 1'000'000;
  while (true) {
    const bool ended = closed();  // before `published`: a writer publishes its last frame, then closes
    const std::uint32_t wake_seen = load_acquire(live().wake);  // partner: W5; also before `published`
    const std::uint64_t newest = published();
    if (number < newest) return newest - number > checked_.slot_count ? Outcome::kOverwritten : Outcome::kFrame;
    if (ended) return Outcome::kClosed;
    const std::int64_t left_ns = deadline_ns - monotonic_ns();
    if (left_ns <= 0) return Outcome::kTimeout;
    sleep(wake_seen, left_ns);
  }
}

std::optional<BorrowedFrame> ShmReader::borrow(std::uint64_t number) const noexcept {
  if (number >= published()) return std::nullopt;
  BorrowedFrame frame{number, {}, slot(number), layout_};
  if (!read_slot(frame.slot, frame.layout, number, frame.head, nullptr, nullptr)) return std::nullopt;
  return frame;
}

ShmReader::Outcome ShmReader::read(std::uint64_t number, ReadFrame& frame, int timeout_ms) noexcept {
  if (const Outcome outcome = wait(number, timeout_ms); outcome != Outcome::kFrame) return outcome;
  const std::size_t pixels = layout_.plane_bytes / sizeof(std::uint16_t);
  frame.raw.resize(pixels);
  frame.deblurred.resize(pixels);
  frame.motion.resize(layout_.motion_blocks);
  bolo_shm_slot head{};
  bolo_shm_motion whole{};
  if (!read_slot(slot(number), layout_, number, head, frame.raw.data(), frame.deblurred.data(), frame.motion.data(),
                 &whole)) {
    return Outcome::kOverwritten;
  }
  if (!has_motion(layout_, head)) frame.motion.clear();
  std::copy(std::begin(whole.affine), std::end(whole.affine), frame.affine.begin());
  frame.number = number;
  frame.meta = meta_of(head);
  frame.publish_ns = head.publish_ns;
  return Outcome::kFrame;
}

}  // namespace bolo::shm
