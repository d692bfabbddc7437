// What a cut of power leaves of a capture. All that the writer asks of the disk is logged: the functions below take the
// place of the C library's. A cut at any place of the log then leaves what was synced before, and of each later write
// any subset of its sectors; the capture must open with everything that was committed.
#include <dlfcn.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <map>
#include <random>

#include "src/capture/crash_safe_file.hpp"
#include "tests/capture/scratch.hpp"

namespace {

constexpr std::size_t kSector = 512;

struct Operation {
  enum Kind { kWrite, kResize, kSync, kCommitted } kind;
  std::string file;
  std::uint64_t offset = 0;  // of a write; new size of a resize; frames of a commit
  std::vector<char> data{};
};

std::vector<Operation>* g_log = nullptr;

std::string name_of(int descriptor) {
  char name[4096];
  const std::string link = "/proc/self/fd/" + std::to_string(descriptor);
  const ssize_t length = readlink(link.c_str(), name, sizeof name);
  return {name, length > 0 ? static_cast<std::size_t>(length) : 0U};
}

void note(Operation::Kind kind, int descriptor, std::uint64_t offset = 0, const void* data = nullptr,
          std::size_t bytes = 0) {
  if (g_log == nullptr) return;
  const char* from = static_cast<const char*>(data);
  g_log->push_back({kind, name_of(descriptor), offset, std::vector<char>(from, from + bytes)});
}

template <typename Function>
Function* next_one(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" ssize_t pwrite(int descriptor, const void* data, size_t bytes, off_t offset) {
  note(Operation::kWrite, descriptor, static_cast<std::uint64_t>(offset), data, bytes);
  return next_one<ssize_t(int, const void*, size_t, off_t)>("pwrite")(descriptor, data, bytes, offset);
}

extern "C" int ftruncate(int descriptor, off_t size) noexcept {
  note(Operation::kResize, descriptor, static_cast<std::uint64_t>(size));
  return next_one<int(int, off_t)>("ftruncate")(descriptor, size);
}

extern "C" int fdatasync(int descriptor) {
  note(Operation::kSync, descriptor);
  return 0;
}

extern "C" int fsync(int descriptor) {
  note(Operation::kSync, descriptor);
  return 0;
}

namespace bolo::capture {
namespace {

using namespace bolo::capture::testing;

constexpr Geometry kGeometry{48, 20};

std::vector<std::uint16_t> plane_at(std::size_t frame) {
  std::vector<std::uint16_t> plane(kGeometry.pixels());
  for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = static_cast<std::uint16_t>(frame * 7919 + i);
  return plane;
}

// The content of all files, and the log of how it came about.
struct Disk {
  std::map<std::string, std::vector<char>> files;

  void resize(const std::string& file, std::uint64_t size) { files[file].resize(size); }

  void write(const std::string& file, std::uint64_t offset, const char* data, std::size_t bytes) {
    std::vector<char>& content = files[file];
    if (content.size() < offset + bytes) content.resize(offset + bytes);
    std::memcpy(content.data() + offset, data, bytes);
  }

  void apply(const Operation& operation) {
    if (operation.kind == Operation::kWrite) {
      write(operation.file, operation.offset, operation.data.data(), operation.data.size());
    } else if (operation.kind == Operation::kResize) {
      resize(operation.file, operation.offset);
    }
  }

  // Each sector of a write by itself, with the probability `share`.
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
};

// Appends frames, events and attributes, and logs what of it was committed.
std::vector<Operation> record(const std::filesystem::path& file, std::size_t frames, int deflate_level) {
  std::vector<Operation> log;
  g_log = &log;
  CaptureInfo info = small_info();
  info.format.geometry = kGeometry;
  WriterOptions options;
  options.deflate_level = deflate_level;
  options.survives_power_cut = true;
  auto writer = CaptureWriter::create(file, info, options);
  EXPECT_TRUE(writer) << writer.error().message;
  const auto committed = [&](std::size_t count) {
    EXPECT_TRUE(writer->commit());
    log.push_back({Operation::kCommitted, "", count});
  };
  for (std::size_t i = 0; i < frames; ++i) {
    const double t_s = 0.005 * static_cast<double>(i);
    EXPECT_TRUE(writer->append(t_s, i, plane_at(i).data()));
    if (i == 30) {
      EXPECT_TRUE(writer->write_attribute("place", std::string("bench")));
    }
    if (i % 17 == 5) {
      EXPECT_TRUE(writer->add_event({t_s, "nuc"}));
    }
    if (i % 13 == 12) committed(i + 1);
  }
  g_log = nullptr;
  return log;
}

// What of the log reached the disk when power went after its first `cut` operations.
template <typename Random>
Disk after_cut(const std::vector<Operation>& log, std::size_t cut, Random& random) {
  std::map<std::string, std::size_t> synced;  // by file: how much of the log
  for (std::size_t i = 0; i < cut; ++i) {
    if (log[i].kind == Operation::kSync) synced[log[i].file] = i;
  }
  Disk disk;
  const double share = std::uniform_real_distribution<double>(0.0, 1.0)(random);
  for (std::size_t i = 0; i < cut; ++i) {
    const auto until = synced.find(log[i].file);
    if (until != synced.end() && i < until->second) {
      disk.apply(log[i]);
    } else {
      disk.apply_some(log[i], share, random);
    }
  }
  return disk;
}

std::size_t committed_before(const std::vector<Operation>& log, std::size_t cut) {
  std::size_t frames = 0;
  for (std::size_t i = 0; i < cut; ++i) {
    if (log[i].kind == Operation::kCommitted) frames = log[i].offset;
  }
  return frames;
}

void expect_whole(const std::filesystem::path& file, std::size_t least, const std::string& place) {
  const auto reader = CaptureReader::open(file);
  ASSERT_TRUE(reader) << place << reader.error().message;
  ASSERT_GE(reader->info().frames, least) << place;
  EXPECT_TRUE(reader->warnings().empty()) << place << reader->warnings().front();
  std::vector<std::uint16_t> plane(kGeometry.pixels());
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    ASSERT_TRUE(reader->read_frame(i, plane.data())) << place << "frame " << i;
    ASSERT_EQ(plane, plane_at(i)) << place << "frame " << i;
    ASSERT_EQ(reader->frame_id()[i], i) << place;
  }
}

class PowerCut : public ::testing::TestWithParam<int> {};

TEST_P(PowerCut, LeavesWhatWasCommitted) {
  const Scratch scratch;
  const std::vector<Operation> log = record(scratch / "a.h5", 400, GetParam());
  ASSERT_GT(log.size(), 500U) << "the functions above were not called";
  std::mt19937_64 random(static_cast<std::uint64_t>(GetParam()) + 1);
  const std::filesystem::path part = scratch / "cut.h5.part";
  int opened = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const std::size_t cut = std::uniform_int_distribution<std::size_t>(0, log.size())(random);
    const std::size_t committed = committed_before(log, cut);
    if (committed == 0) continue;  // nothing was promised yet
    for (const auto& [name, content] : after_cut(log, cut, random).files) {
      const bool journal = name.ends_with(".journal");
      std::ofstream out(journal ? journal_of(part) : part, std::ios::binary | std::ios::trunc);
      out.write(content.data(), static_cast<std::streamsize>(content.size()));
    }
    ++opened;
    expect_whole(part, committed, "trial " + std::to_string(trial) + ", cut at " + std::to_string(cut) + ": ");
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(opened, 200);
}

INSTANTIATE_TEST_SUITE_P(Compression, PowerCut, ::testing::Values(0, 1), ::testing::PrintToStringParamName());

// In a process of its own, which ends without cleaning up: HDF5 forgets to free what it read of a torn file.
bool opens_with(const std::filesystem::path& file, std::size_t least) {
  const pid_t pid = fork();
  if (pid == 0) {
    const auto reader = CaptureReader::open(file);
    _exit(reader && reader->info().frames >= least ? 0 : 1);
  }
  int status = 0;
  EXPECT_EQ(waitpid(pid, &status, 0), pid);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

// The check itself: without syncs there are cuts that leave nothing usable.
TEST(PowerCutCheck, FindsAWriterThatDoesNotSync) {
  const Scratch scratch;
  std::vector<Operation> log = record(scratch / "a.h5", 400, 0);
  std::erase_if(log, [](const Operation& operation) { return operation.kind == Operation::kSync; });
  std::mt19937_64 random(5);
  const std::filesystem::path part = scratch / "cut.h5.part";
  int broken = 0;
  for (int trial = 0; trial < 20; ++trial) {
    for (const auto& [name, content] : after_cut(log, log.size(), random).files) {
      if (name.ends_with(".journal")) continue;
      std::ofstream out(part, std::ios::binary | std::ios::trunc);
      out.write(content.data(), static_cast<std::streamsize>(content.size()));
    }
    if (!opens_with(part, committed_before(log, log.size()))) ++broken;
  }
  EXPECT_GT(broken, 10);
}

}  // namespace
}  // namespace bolo::capture
