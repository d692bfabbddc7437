// Captures after a kill or a power cut. The functions below replace the C library's: they log the writer's disk
// operations and slow the disk down, so that the writer goes on during syncs. The log is then cut off at any place:
// - a power cut keeps all writes made before a finished sync began, and any subset of the sectors of each other write;
//   then another kernel runs;
// - a kill keeps all writes, the last one perhaps in part.
// Either must open with exactly the frames of a commit, and not of too old a one.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "src/capture/capture.hpp"
#include "src/capture/commit_records.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/child.hpp"

namespace {

constexpr std::size_t kSector = 512;
constexpr auto kSync = std::chrono::milliseconds(3);

struct Operation {
  enum Kind { kWrite, kResize, kSyncBegins, kSyncEnds, kCommitted } kind;
  std::string file;
  std::uint64_t offset = 0;  // of a write; for a resize: the new size; for a commit: frames
  std::vector<char> data{};
};
using Log = std::vector<Operation>;

// Thread: any.
class Logger {
 public:
  void begin() {
    const std::lock_guard lock(mutex_);
    log_.emplace();
  }
  void add(Operation operation) {
    const std::lock_guard lock(mutex_);
    if (log_) log_->push_back(std::move(operation));
  }
  bool active() {
    const std::lock_guard lock(mutex_);
    return log_.has_value();
  }
  Log end() {
    const std::lock_guard lock(mutex_);
    Log log = std::move(*log_);
    log_.reset();
    return log;
  }

 private:
  std::mutex mutex_;
  std::optional<Log> log_;
};

Logger g_logger;

std::string name_of(int descriptor) {
  char name[4096];
  const std::string link = "/proc/self/fd/" + std::to_string(descriptor);
  const ssize_t length = readlink(link.c_str(), name, sizeof name);
  return {name, length > 0 ? static_cast<std::size_t>(length) : 0U};
}

template <typename Function>
Function* next_one(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

int slow_sync(int descriptor) {
  if (!g_logger.active()) return 0;
  g_logger.add({Operation::kSyncBegins, name_of(descriptor)});
  std::this_thread::sleep_for(kSync);
  g_logger.add({Operation::kSyncEnds, name_of(descriptor)});
  return 0;
}

}  // namespace

extern "C" ssize_t pwrite(int descriptor, const void* data, size_t bytes, off_t offset) {
  const char* from = static_cast<const char*>(data);
  if (g_logger.active()) {
    g_logger.add({Operation::kWrite, name_of(descriptor), static_cast<std::uint64_t>(offset),
                  std::vector<char>(from, from + bytes)});
  }
  return next_one<ssize_t(int, const void*, size_t, off_t)>("pwrite")(descriptor, data, bytes, offset);
}

extern "C" int ftruncate(int descriptor, off_t size) noexcept {
  if (g_logger.active()) g_logger.add({Operation::kResize, name_of(descriptor), static_cast<std::uint64_t>(size)});
  return next_one<int(int, off_t)>("ftruncate")(descriptor, size);
}

extern "C" int fdatasync(int descriptor) { return slow_sync(descriptor); }
extern "C" int fsync(int descriptor) { return slow_sync(descriptor); }

namespace bolo::capture {
namespace {

using namespace bolo::capture::testing;

constexpr Geometry kGeometry{48, 20};

std::vector<std::uint16_t> plane_at(std::size_t frame) {
  std::vector<std::uint16_t> plane(kGeometry.pixels());
  for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = static_cast<std::uint16_t>(frame * 7919 + i);
  return plane;
}

constexpr std::size_t kFramesPerCommit = 13;

// Contents of all files after replaying logged operations.
struct Disk {
  std::map<std::string, std::vector<char>> files;

  void resize(const std::string& file, std::uint64_t size) { files[file].resize(size); }

  void write(const std::string& file, std::uint64_t offset, const char* data, std::size_t bytes) {
    std::vector<char>& content = files[file];
    if (content.size() < offset + bytes) content.resize(offset + bytes);
    std::memcpy(content.data() + offset, data, bytes);
  }

  void apply(const Operation& operation) { apply_first(operation, operation.data.size()); }

  // Only the first `bytes` of a write; any other operation as a whole.
  void apply_first(const Operation& operation, std::size_t bytes) {
    if (operation.kind == Operation::kWrite) {
      write(operation.file, operation.offset, operation.data.data(), bytes);
    } else if (operation.kind == Operation::kResize) {
      resize(operation.file, operation.offset);
    }
  }

  // Keeps each sector of a write independently with probability `share`.
  template <typename Random>
  void apply_some(const Operation& operation, double share, Random& random) {
    std::bernoulli_distribution reached(share);
    if (operation.kind == Operation::kResize && reached(random)) resize(operation.file, operation.offset);
    if (operation.kind != Operation::kWrite) return;
    for (std::size_t at = 0; at < operation.data.size();) {
      const std::size_t count = std::min(operation.data.size() - at, kSector - (operation.offset + at) % kSector);
      if (reached(random)) write(operation.file, operation.offset + at, operation.data.data() + at, count);
      at += count;
    }
  }

  // Another kernel runs after a power cut: the live record of the old one is void.
  void start_another_kernel() {
    for (auto& [name, content] : files) {
      if (!name.ends_with(".live")) continue;
      for (const std::uint64_t at : {std::uint64_t{0}, kLivePointerStep}) {
        const std::size_t place = at + offsetof(LivePointer, cache);
        if (content.size() > place) content[place] ^= 1;
      }
    }
  }
};

// Records frames, events and attributes; the log marks each commit.
Log record(const std::filesystem::path& file, std::size_t frames, int deflate_level) {
  g_logger.begin();
  {
    CaptureInfo info = small_info();
    info.format.geometry = kGeometry;
    WriterOptions options;
    options.deflate_level = deflate_level;
    options.survives_power_cut = true;
    auto writer = must(CaptureWriter::create(file, info, options));
    for (std::size_t i = 0; i < frames; ++i) {
      const double t_s = 0.005 * static_cast<double>(i);
      EXPECT_TRUE(writer->append(t_s, i, plane_at(i).data()));
      if (i == 30) {
        EXPECT_TRUE(writer->write_attribute("place", std::string("bench")));
      }
      if (i % 17 == 5) {
        EXPECT_TRUE(writer->add_event({t_s, "nuc"}));
      }
      if (i % kFramesPerCommit == kFramesPerCommit - 1) {
        EXPECT_TRUE(writer->commit());
        g_logger.add({Operation::kCommitted, "", i + 1});
        std::this_thread::sleep_for(std::chrono::milliseconds(1));  // several commits during one sync
      }
    }
  }
  return g_logger.end();
}

// The disk after a power cut that follows the first `cut` operations.
template <typename Random>
Disk after_cut(const Log& log, std::size_t cut, Random& random, Disk disk = {}) {
  std::map<std::string, std::size_t> began;   // log index of each file's newest sync
  std::map<std::string, std::size_t> synced;  // length of the log that is durable
  for (std::size_t i = 0; i < cut; ++i) {
    if (log[i].kind == Operation::kSyncBegins) began[log[i].file] = i;
    if (log[i].kind == Operation::kSyncEnds) synced[log[i].file] = began[log[i].file];
  }
  const double share = std::uniform_real_distribution<double>(0.0, 1.0)(random);
  for (std::size_t i = 0; i < cut; ++i) {
    const auto until = synced.find(log[i].file);
    if (until != synced.end() && i < until->second) {
      disk.apply(log[i]);
    } else {
      disk.apply_some(log[i], share, random);
    }
  }
  disk.start_another_kernel();
  return disk;
}

// The disk after a kill during operation `cut`.
template <typename Random>
Disk after_kill(const Log& log, std::size_t cut, Random& random) {
  Disk disk;
  for (std::size_t i = 0; i < cut; ++i) disk.apply(log[i]);
  if (cut < log.size()) {
    disk.apply_first(log[cut], std::uniform_int_distribution<std::size_t>(0, log[cut].data.size())(random));
  }
  return disk;
}

std::size_t committed_before(const Log& log, std::size_t cut) {
  std::size_t frames = 0;
  for (std::size_t i = 0; i < cut; ++i) {
    if (log[i].kind == Operation::kCommitted) frames = log[i].offset;
  }
  return frames;
}

// Least number of frames after a power cut. The journal's newest durable sync refers to data whose sync began after the
// previous journal sync had ended, so it covers all frames committed by then.
std::size_t durable_before(const Log& log, std::size_t cut) {
  std::size_t before = 0;
  std::size_t newest = 0;
  for (std::size_t i = 0; i < cut; ++i) {
    if (log[i].kind == Operation::kSyncEnds && log[i].file.ends_with(".journal")) before = std::exchange(newest, i);
  }
  return committed_before(log, before);
}

void store(const Disk& disk, const std::filesystem::path& part) {
  remove_records(part);
  for (const auto& [name, content] : disk.files) {
    std::filesystem::path to = part;
    if (name.ends_with(".journal")) to = journal_of(part);
    if (name.ends_with(".live")) to = live_of(part);
    std::ofstream out(to, std::ios::binary | std::ios::trunc);
    out.write(content.data(), static_cast<std::streamsize>(content.size()));
  }
}

void expect_commit(const std::filesystem::path& file, std::size_t least, const std::string& place) {
  const auto reader = CaptureReader::open(file);
  ASSERT_TRUE(reader) << place << reader.error().message;
  ASSERT_GE(reader->info().frames, least) << place;
  EXPECT_EQ(reader->info().frames % kFramesPerCommit, 0U) << place;
  EXPECT_TRUE(reader->warnings().empty()) << place << reader->warnings().front();
  std::vector<std::uint16_t> plane(kGeometry.pixels());
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    ASSERT_TRUE(reader->read_frame(i, plane.data())) << place << "frame " << i;
    ASSERT_EQ(plane, plane_at(i)) << place << "frame " << i;
    ASSERT_EQ(reader->frame_id()[i], i) << place;
  }
}

std::string place_of(const char* what, int trial, std::size_t cut) {
  return std::string(what) + " " + std::to_string(trial) + " at " + std::to_string(cut) + ": ";
}

constexpr std::size_t kFrames = 30 * kFramesPerCommit;

class Ending : public ::testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    log_ = record(scratch_ / "recorded.h5", kFrames, GetParam());
    ASSERT_GT(log_.size(), 300U) << "the functions above were not called";
  }

  std::size_t any_place() { return std::uniform_int_distribution<std::size_t>(0, log_.size())(random_); }

  const Scratch scratch_;
  const std::filesystem::path recorded_ = scratch_ / "recorded.h5.part";
  const std::filesystem::path part_ = scratch_ / "ended.h5.part";
  Log log_;
  std::mt19937_64 random_{static_cast<std::uint64_t>(GetParam()) + 1};
};

TEST_P(Ending, ByACutOfPowerLeavesADurableCommit) {
  int opened = 0;
  for (int trial = 0; trial < 300 && !HasFatalFailure(); ++trial) {
    const std::size_t cut = any_place();
    const std::size_t durable = durable_before(log_, cut);
    if (durable == 0) continue;  // nothing durable yet
    ++opened;
    store(after_cut(log_, cut, random_), part_);
    expect_commit(part_, durable, place_of("cut", trial, cut));
  }
  EXPECT_GT(opened, 100);
}

// Half of the kills hit a write of the live record.
TEST_P(Ending, ByAKillLeavesTheLastCommit) {
  std::vector<std::size_t> live;
  for (std::size_t i = 0; i < log_.size(); ++i) {
    if (log_[i].kind == Operation::kWrite && log_[i].file.ends_with(".live")) live.push_back(i);
  }
  ASSERT_GT(live.size(), 2 * kFrames / kFramesPerCommit - 2);
  std::uniform_int_distribution<std::size_t> any_live(0, live.size() - 1);
  int opened = 0;
  for (int trial = 0; trial < 300 && !HasFatalFailure(); ++trial) {
    const std::size_t cut = trial % 2 == 0 ? any_place() : live[any_live(random_)];
    const std::size_t committed = committed_before(log_, cut);
    if (committed == 0) continue;
    ++opened;
    store(after_kill(log_, cut, random_), part_);
    expect_commit(part_, committed, place_of("kill", trial, cut));
  }
  EXPECT_GT(opened, 100);
}

// Recovery in place after a kill, itself interrupted by a power cut.
TEST_P(Ending, ByACutWhileItIsFinishedLeavesADurableCommit) {
  int cuts = 0;
  for (int trial = 0; trial < 30 && !HasFatalFailure(); ++trial) {
    const std::size_t kill = any_place();
    const std::size_t durable = durable_before(log_, kill);
    if (durable == 0) continue;
    Log whole(log_.begin(), log_.begin() + static_cast<std::ptrdiff_t>(kill));
    store(after_kill(whole, kill, random_), part_);
    g_logger.begin();
    EXPECT_TRUE(recover_in_place(part_, {scratch_ / "done.h5", Replace::kExisting}));
    for (Operation& operation : g_logger.end()) {
      const std::string extension = std::filesystem::path(operation.file).extension().string();
      operation.file = recorded_.string() + (extension == ".part" ? "" : extension);
      whole.push_back(std::move(operation));
    }
    expect_commit(scratch_ / "done.h5", committed_before(log_, kill), place_of("kill", trial, kill));
    for (std::size_t cut = kill; cut <= whole.size() && !HasFatalFailure(); cut += 1 + (whole.size() - kill) / 8) {
      ++cuts;
      store(after_cut(whole, cut, random_), part_);
      expect_commit(part_, durable, place_of("cut", trial, cut));
    }
  }
  EXPECT_GT(cuts, 50);
}

INSTANTIATE_TEST_SUITE_P(Compression, Ending, ::testing::Values(0, 1), ::testing::PrintToStringParamName());

// In a child process that exits without clean-up: HDF5 leaks memory after a torn file.
bool opens_with(const std::filesystem::path& file, std::size_t least) {
  return in_child([&] {
           const auto reader = CaptureReader::open(file);
           return reader && reader->info().frames >= least ? 0 : 1;
         }) == 0;
}

// Checks the check: without syncs some cuts leave nothing usable.
TEST(EndingCheck, FindsAWriterThatDoesNotSync) {
  const Scratch scratch;
  Log log = record(scratch / "a.h5", kFrames, 0);
  std::erase_if(log, [](const Operation& operation) { return operation.kind == Operation::kSyncEnds; });
  std::mt19937_64 random(5);
  const std::filesystem::path part = scratch / "cut.h5.part";
  int broken = 0;
  for (int trial = 0; trial < 20; ++trial) {
    Disk disk = after_cut(log, log.size(), random);
    std::erase_if(disk.files, [](const auto& file) { return file.first.ends_with(".journal"); });
    store(disk, part);
    if (!opens_with(part, committed_before(log, log.size()))) ++broken;
  }
  EXPECT_GT(broken, 10);
}

}  // namespace
}  // namespace bolo::capture
