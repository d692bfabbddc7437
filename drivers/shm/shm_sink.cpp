#include "drivers/shm/shm_sink.hpp"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <climits>
#include <cstddef>
#include <cstring>
#include <mutex>
#include <optional>
#include <system_error>
#include <utility>

#include "bolo/shm_layout.h"
#include "drivers/shm/shared_words.hpp"
#include "drivers/shm/shm_object.hpp"
#include "src/core/clock.hpp"
#include "src/rt/thread.hpp"

namespace bolo::shm {
namespace {

constexpr int kAtOnce = 4;

// Wakes at most `most` waiters; returns their number.
long wake_waiting(const std::uint32_t& word, int most) noexcept {
  return syscall(SYS_futex, &word, FUTEX_WAKE, most, nullptr, nullptr, 0);
}

static_assert(std::endian::native == std::endian::little, "the layout is little-endian");
static_assert(rt::LatencyHistogram::kBuckets == BOLO_SHM_LATENCY_BUCKETS);
static_assert(kLossCauses <= BOLO_SHM_LOSS_CAUSES);
static_assert(std::uint32_t{kFlagGap} == std::uint32_t{BOLO_FLAG_GAP});
static_assert(std::uint32_t{kFlagWarmUp} == std::uint32_t{BOLO_FLAG_WARM_UP});
static_assert(std::uint32_t{kFlagNuc} == std::uint32_t{BOLO_FLAG_NUC});
static_assert(std::uint32_t{kFlagSaturated} == std::uint32_t{BOLO_FLAG_SATURATED});
static_assert(std::uint32_t{kFlagJitter} == std::uint32_t{BOLO_FLAG_JITTER});
static_assert(flag_of(pipeline::QualityLevel::kFull) == 0);
static_assert(flag_of(pipeline::QualityLevel::kReduced) == std::uint32_t{BOLO_FLAG_REDUCED});
static_assert(flag_of(pipeline::QualityLevel::kInverse) == std::uint32_t{BOLO_FLAG_INVERSE});
static_assert(flag_of(pipeline::QualityLevel::kRaw) == std::uint32_t{BOLO_FLAG_RAW});
static_assert(sizeof(BlockMotion) == sizeof(bolo_shm_block_motion));

// Readers convert these numbers back to methods (point_reader.cpp).
constexpr bool is_numbered(deblur::Method method, bolo_shm_method number) {
  return static_cast<int>(method) == static_cast<int>(number);
}
static_assert(is_numbered(deblur::Method::kAdmm, BOLO_METHOD_ADMM));
static_assert(is_numbered(deblur::Method::kDual, BOLO_METHOD_DUAL));
static_assert(is_numbered(deblur::Method::kExact, BOLO_METHOD_EXACT));
static_assert(is_numbered(deblur::Method::kInverse, BOLO_METHOD_INVERSE));
static_assert(is_numbered(deblur::Method::kMmae, BOLO_METHOD_MMAE));
static_assert(is_numbered(deblur::Method::kMotion, BOLO_METHOD_MOTION));

constexpr int kMinSlots = 64;        // a third of a second at 200 Hz to fetch a frame
constexpr int kMostSlots = 1 << 16;  // limits the arithmetic; memory runs out long before
constexpr int kReadingMargin = 16;   // reading time, in frames, for a whole window
constexpr std::size_t kSettingsOffset = sizeof(bolo_shm_header);
constexpr std::size_t kCameraOffset = kSettingsOffset + sizeof(bolo_shm_settings);
constexpr std::size_t kSlotsOffset = round_up(kCameraOffset + sizeof(bolo_shm_camera), rt::kCacheLine);
constexpr std::int64_t kNamePeriodNs = 1'000'000'000;  // between checks of the name
constexpr unsigned kModeBits = 0777;
constexpr unsigned kOwnerBits = 0600;    // required by the writer
constexpr unsigned kOthersWrite = 0022;  // readers must not disturb the writer or each other

template <std::size_t N>
void put_text(char (&to)[N], const std::string& text) {
  std::memcpy(to, text.data(), std::min(text.size(), N - 1));  // the rest is already zero
}

Result<int> choose_slots(int asked, const deblur::Settings& settings) {
  const int needed = settings.window + settings.lookahead;
  if (asked == 0) {
    return std::max(kMinSlots, static_cast<int>(std::bit_ceil(static_cast<unsigned>(needed + kReadingMargin))));
  }
  if (asked >= needed && asked <= kMostSlots) return asked;
  return bad_input("shm.slots = " + std::to_string(asked) + " is out of range: " + std::to_string(needed) +
                   " (window and look-ahead) to " + std::to_string(kMostSlots) + ", or 0 for enough");
}

Status check(const ShmOptions& options, const pipeline::SinkFormat& format) {
  const StreamFormat& stream = format.source.format;
  if (stream.type != PixelType::kUint16 || format.deblurred_type != PixelType::kUint16) {
    return bad_input(
        "shared memory carries 16-bit planes, but the source or the output is float32; use a 16-bit source");
  }
  if (stream.geometry.width <= 0 || stream.geometry.height <= 0)
    return failed("shared memory: the frame has no pixels");
  if (format.region || !format.points.empty()) {
    return bad_input("shared memory carries whole frames, not a region or points of them");
  }
  return check_mode(options);
}

SlotLayout layout_of(Geometry frame, bool motion) {
  return slot_layout(plane_bytes(frame, PixelType::kUint16), motion ? motion_blocks(frame).pixels() : 0);
}

void describe(bolo_shm_header& header, const pipeline::SinkFormat& format, int slots, const SlotLayout& layout) {
  const StreamFormat& stream = format.source.format;
  header.version = BOLO_SHM_VERSION;
  header.header_bytes = sizeof(header);
  header.width = static_cast<std::uint32_t>(stream.geometry.width);
  header.height = static_cast<std::uint32_t>(stream.geometry.height);
  header.slot_count = static_cast<std::uint32_t>(slots);
  header.unit = stream.scale.unit == Unit::kKelvin ? BOLO_UNIT_KELVIN : BOLO_UNIT_COUNT;
  header.settings_offset = kSettingsOffset;
  header.slots_offset = kSlotsOffset;
  header.slot_stride = layout.stride;
  header.raw_offset = layout.raw_offset;
  header.deblurred_offset = layout.deblurred_offset;
  if (format.motion) {
    const Geometry blocks = motion_blocks(stream.geometry);
    header.motion_offset = layout.motion_offset;
    header.motion_across = static_cast<std::uint32_t>(blocks.width);
    header.motion_down = static_cast<std::uint32_t>(blocks.height);
  }
  header.row_delay_s = format.row_delay_s;
  header.scale = stream.scale.scale;
  header.offset = stream.scale.offset;
  header.frame_period_s = stream.frame_period_s;
  header.tau_s = format.deblur.tau_s;
  header.window = static_cast<std::uint32_t>(format.deblur.window);
  header.lookahead = static_cast<std::uint32_t>(format.deblur.lookahead);
  header.row_step = static_cast<std::uint32_t>(stream.row_step);
  header.writer_pid = static_cast<std::uint32_t>(getpid());
  put_text(header.camera_model, format.source.camera_model);
  put_text(header.camera_serial, format.source.camera_serial);
  put_text(header.solver, format.solver_text);
  header.start_ns = monotonic_ns();
  header.clock_error_ns = kUnboundedClockErrorNs;
  header.heartbeat_ns = static_cast<std::uint64_t>(header.start_ns);
}

void describe(bolo_shm_settings& settings, const pipeline::SinkFormat& format) {
  settings.bytes = sizeof(settings);
  settings.method = static_cast<std::uint32_t>(format.deblur.method);
  if (format.deblur.auto_lambda) settings.flags |= BOLO_SETTINGS_AUTO_LAMBDA;
  if (format.maps) settings.flags |= BOLO_SETTINGS_MAPS;
  if (format.undone) settings.flags |= BOLO_SETTINGS_UNDONE;
  settings.camera_offset = kCameraOffset;
  settings.levels = static_cast<std::uint32_t>(format.deblur.levels);
  settings.iterations = static_cast<std::uint32_t>(format.iterations_asked);
  settings.kappa = format.deblur.kappa;
  settings.lambda = format.deblur.lambda;
  settings.noise_k = format.deblur.noise_k;
  put_text(settings.isa, format.isa);
}

// Relaxed: each counter is independent and publishes no other data.
template <typename Rows, typename Source>
void store_words(void* to, const Rows& rows, const Source& source) noexcept {
  each_shared_word(rows, source,
                   [words = static_cast<std::uint64_t*>(to)](std::size_t at, std::uint64_t word) noexcept {
                     store_relaxed(words[at], word);
                   });
}

void store_stats(bolo_shm_header& header, const pipeline::PipelineStats& stats) noexcept {
  store_relaxed(header.heartbeat_ns, static_cast<std::uint64_t>(monotonic_ns()));
  std::atomic_ref(header.frame_period_s).store(stats.period_s.value(), std::memory_order_relaxed);
  store_words(&header, pipeline::kFrameCounters, stats);
  for (std::size_t b = 0; b < BOLO_SHM_LATENCY_BUCKETS; ++b) store_relaxed(header.latency[b], stats.latency.count(b));
}

// Only this thread writes `wake`, so a load and a store suffice.
void change_wake(bolo_shm_header& header) noexcept {
  store_release(header.wake, load_relaxed(header.wake) + 1);  // W5; partner: ShmReader's load of wake
}

}  // namespace

Waker::Waker(std::uint32_t& word) : word_(word) {
  try {
    thread_ = std::thread([this] { run(); });
  } catch (const std::system_error&) {
    // No thread available: wake() wakes all waiters itself.
  }
}

Waker::~Waker() {
  if (thread_.joinable()) end();
  wake_waiting(word_, INT_MAX);
}

void Waker::end() noexcept {
  ends_.store(true, std::memory_order_relaxed);    // published by the increment below
  asked_.fetch_add(1, std::memory_order_release);  // partner: run()'s load
  asked_.notify_one();
  thread_.join();
}

void Waker::wake() noexcept {
  const int at_once = thread_.joinable() ? kAtOnce : INT_MAX;
  if (wake_waiting(word_, at_once) < at_once) return;
  asked_.fetch_add(1, std::memory_order_release);  // partner: run()'s load
  asked_.notify_one();
}

void Waker::run() noexcept {
  (void)rt::apply_to_this_thread({"bolo-wake", 0});
  std::uint32_t done = 0;
  while (true) {
    asked_.wait(done, std::memory_order_acquire);
    done = asked_.load(std::memory_order_acquire);  // partner: wake(), end()
    if (ends_.load(std::memory_order_relaxed)) return;
    wake_waiting(word_, INT_MAX);
  }
}

Status check_mode(const ShmOptions& options) {
  if ((options.mode & ~kModeBits) != 0 || (options.mode & kOwnerBits) != kOwnerBits) {
    return bad_input("shm.mode must be permission bits with 0600 among them, at most 0777");
  }
  if ((options.mode & kOthersWrite) != 0) {
    return bad_input("shm.mode lets others write into the frames; use 0640 for a group's readers, 0644 for everyone");
  }
  return {};
}

// The object seen by readers, and its number of frames.
struct ShmSink::Ring {
  OwnedObject object;
  std::optional<Waker> waker;  // of the object's futex word
  std::uint64_t published = 0;

  bolo_shm_header& header() const noexcept { return *reinterpret_cast<bolo_shm_header*>(object.data()); }
  ~Ring() {
    store_release(header().state, static_cast<std::uint32_t>(BOLO_SHM_CLOSED));  // partner: ShmReader's load of state
    change_wake(header());
    waker.reset();  // finally wakes all waiters
  }
};

struct ShmSink::Impl {
  ShmOptions options;
  pipeline::SinkFormat format;
  SlotLayout layout;
  std::uint64_t slot_count = 0;
  std::unique_ptr<Ring> ring;         // used by the pipeline thread only, once open
  std::atomic<Ring*> fresh{nullptr};  // owned; next value of `ring`, which changes only while this is not null
  std::mutex name_check;              // close() waits for a check of the name; frames do not
  std::int64_t next_check_ns = 0;
  pipeline::Notices notices;

  // Initializes an empty ring in the zeroed object, and grants access to readers.
  Result<std::unique_ptr<Ring>> fill(OwnedObject object) const {
    describe(*reinterpret_cast<bolo_shm_header*>(object.data()), format, static_cast<int>(slot_count), layout);
    describe(*reinterpret_cast<bolo_shm_settings*>(object.data() + kSettingsOffset), format);
    auto& camera = *reinterpret_cast<bolo_shm_camera*>(object.data() + kCameraOffset);
    camera.bytes = sizeof(camera);
    put_text(camera.control_socket, options.control_socket);
    RETURN_IF_ERROR(object.publish_to(options.mode, options.group));
    auto made = std::make_unique<Ring>();
    made->object = std::move(object);
    bolo_shm_header& header = made->header();
    made->waker.emplace(header.wake);
    store_release(header.state, static_cast<std::uint32_t>(BOLO_SHM_RUNNING));
    store_release(header.magic, static_cast<std::uint64_t>(BOLO_SHM_MAGIC));  // partner: ShmReader::open
    return made;
  }

  void check_name() {
    const std::lock_guard lock(name_check);
    // partner: the store in take_fresh()
    if (fresh.load(std::memory_order_acquire) != nullptr || ring == nullptr || monotonic_ns() < next_check_ns) return;
    next_check_ns = monotonic_ns() + kNamePeriodNs;
    // An object that was truncated and grown again has the same size, but is empty.
    if (ring->object.is_there() && load_relaxed(ring->header().magic) == BOLO_SHM_MAGIC) return;
    const std::string what = "shared memory /bolo." + options.name + " was taken away or cut off";
    auto object = ring->object.create_again();
    auto made = object ? fill(std::move(*object)) : tl::unexpected<Error>(object.error());
    if (made) {
      fresh.store(made->release(), std::memory_order_release);  // partner: the load in take_fresh()
      notices.forget_last();
      notices.report(true, what + "; it is there again");
    } else {
      notices.report(true, what + ": " + made.error().message + "; it is tried again all the time");
    }
  }

  void take_fresh() noexcept {
    Ring* const made = fresh.load(std::memory_order_acquire);  // partner: the store in check_name()
    if (made == nullptr) return;
    ring.reset(made);
    fresh.store(nullptr, std::memory_order_release);  // partner: the load in check_name()
  }

  void store(const pipeline::PipelineStats& stats) const noexcept {
    store_stats(ring->header(), stats);
    if (stats.source == nullptr) return;
    store_words(ring->object.data() + kCameraOffset, pipeline::kCameraCounters, *stats.source);
  }
  std::byte* slot(std::uint64_t number) const noexcept {
    return ring->object.data() + kSlotsOffset + number % slot_count * layout.stride;
  }
};

std::uint64_t bytes_needed(const ShmOptions& options, const deblur::Settings& settings, Geometry frame) {
  const int slots = choose_slots(options.slots, settings).value_or(settings.window + settings.lookahead);
  const bool motion = settings.method == deblur::Method::kMotion;
  return kSlotsOffset + static_cast<std::uint64_t>(slots) * layout_of(frame, motion).stride;
}

ShmSink::ShmSink(ShmOptions options) : impl_(std::make_unique<Impl>()) { impl_->options = std::move(options); }

ShmSink::~ShmSink() { close(); }

Status ShmSink::open(const pipeline::SinkFormat& format) {
  Impl& self = *impl_;
  if (Status status = check(self.options, format); !status) return status;
  ASSIGN_OR_RETURN(const int slots, choose_slots(self.options.slots, format.deblur));
  self.slot_count = static_cast<std::uint64_t>(slots);
  self.layout = layout_of(format.source.format.geometry, format.motion);
  self.format = format;
  ASSIGN_OR_RETURN(OwnedObject object,
                   OwnedObject::create(self.options.name, kSlotsOffset + self.slot_count * self.layout.stride));
  ASSIGN_OR_RETURN(self.ring, self.fill(std::move(object)));
  return {};
}

void ShmSink::publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept {
  Impl& self = *impl_;
  self.take_fresh();
  Ring& ring = *self.ring;
  bolo_shm_slot head{};
  head.frame_id = frame.meta.frame_id;
  head.camera_ns = frame.meta.camera_ns;
  head.receive_ns = frame.meta.receive_ns;
  head.publish_ns = frame.publish_ns;
  head.flags = frame.meta.flags;
  head.noise_k = frame.noise_k;
  head.host_ns = frame.meta.host_ns;
  head.utc_ns = frame.meta.utc_ns;
  head.utc_uncertainty_ns = frame.meta.utc_uncertainty_ns;
  bolo_shm_motion whole{};
  MotionPart motion;
  if (frame.motion != nullptr && self.layout.motion_blocks != 0) {
    std::copy(frame.motion->affine.begin(), frame.motion->affine.end(), whole.affine);
    head.motion_blocks = static_cast<std::uint32_t>(self.layout.motion_blocks);
    motion = {&whole, frame.motion->blocks.data()};
  }
  write_slot(self.slot(ring.published), self.layout, ring.published, head, frame.raw, frame.deblurred, motion);
  self.store(stats);
  store_release(ring.header().published, ++ring.published);  // W4; partner: ShmReader's load of published
  change_wake(ring.header());
  ring.waker->wake();
}

void ShmSink::idle(const pipeline::PipelineStats& stats) noexcept {
  impl_->take_fresh();
  impl_->store(stats);
}

void ShmSink::close() noexcept {
  const std::lock_guard lock(impl_->name_check);
  impl_->take_fresh();
  impl_->ring.reset();
}

std::vector<pipeline::Notice> ShmSink::take_notices() {
  impl_->check_name();
  return impl_->notices.take();
}

void ShmSection::declare(model::KeyTable& keys) {
  keys.section("shm", "frames for other programs: shared memory /bolo.NAME");
  keys.boolean("enable", enabled_, "Publish into shared memory.");
  keys.integer("slots", options_.slots, {0, 65536, "frames"},
               "Frames in the ring, at least window + lookahead; 0: 64, or more if the window needs more.");
  keys.octal("mode", options_.mode, {0600, 0777, ""},
             "Permission bits; readers need read permission only: 0o640 for the group's members, 0o644 for everybody.");
  keys.text("group", options_.group,
            "Owning group, of which the daemon's user must be a member; empty: the daemon's own.");
}

Status ShmSection::check(const model::KeyTable& keys, const pipeline::SinkContext& context,
                         std::span<const std::shared_ptr<SinkSection>> /*before*/) const {
  if (const Status mode = check_mode(options_); enabled_ && !mode) {
    return bad_input(keys.where("shm.mode") + mode.error().message);
  }
  const int needed = context.deblur.window + context.deblur.lookahead;
  if (options_.slots == 0 || options_.slots >= needed) return {};
  return bad_input(keys.where("shm.slots") + "shm.slots = " + std::to_string(options_.slots) +
                   " is less than window + lookahead = " + std::to_string(needed) + "; give that or more, or 0");
}

std::string ShmSection::describe(const pipeline::SinkContext& context) const {
  return enabled_ ? "shared memory /bolo." + context.name : "";
}

std::uint64_t ShmSection::shared_bytes(const pipeline::SinkContext& context) const {
  return enabled_ ? bytes_needed(options_, context.deblur, context.frame) : 0;
}

std::unique_ptr<pipeline::FrameSink> ShmSection::make(const pipeline::SinkContext& context) const {
  if (!enabled_) return nullptr;
  ShmOptions options = options_;
  options.name = context.name;
  options.control_socket = context.control_socket;
  return std::make_unique<ShmSink>(std::move(options));
}

}  // namespace bolo::shm
