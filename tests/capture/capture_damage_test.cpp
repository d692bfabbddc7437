// Damaged files: opening and reading them ends with values or with an error of one line.
// HDF5 1.10 itself is not safe against every damage of its structures: attribute messages with a wrong length make it
// read beyond its buffers, about once in a thousand damaged files. Structural damage is therefore tried in child
// processes: none may hang, and all but a few must end well. Damaged values must always end well.
#include <sys/resource.h>

#include "src/core/input_file.hpp"
#include "tests/capture/hdf5_edit.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/child.hpp"

namespace bolo::capture::capture_damage_test {

using namespace bolo::capture::testing;

constexpr int kTrials = 100;
constexpr int kMostLibraryFaults = 4;  // of 2 * kTrials; observed: 0 to 2 in 1,500
constexpr unsigned kHang_s = 30;

void write_bytes(const std::filesystem::path& file, const std::vector<char>& bytes) {
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::vector<char> valid_bytes(const Scratch& scratch, int deflate_level) {
  auto writer = CaptureWriter::create(scratch / "valid.h5", small_info(),
                                      {.truth = true, .deflate_level = deflate_level, .replace = Replace::kExisting});
  EXPECT_TRUE(writer->write_stimulus(Chopper{293.0, {0.1}, {0.2}, {303.0}}));
  EXPECT_TRUE(writer->add_event({0.001, "nuc"}));
  for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(append(*writer, i, true));
  EXPECT_TRUE(writer->close());
  const std::string bytes = *must(read_input(scratch / "valid.h5"));
  return {bytes.begin(), bytes.end()};
}

// Reads the whole file. A damaged file may still open; each frame is then read, or refused in one line.
void read_everything(const std::filesystem::path& file) {
  const auto reader = CaptureReader::open(file);
  if (!reader) {
    EXPECT_FALSE(reader.error().message.empty());
    EXPECT_EQ(reader.error().message.find('\n'), std::string::npos) << reader.error().message;
    return;
  }
  const StreamFormat& format = reader->info().format;
  ASSERT_LE(reader->info().frames, 2000U) << "more than the file can hold";
  std::vector<char> plane(plane_bytes(format.geometry, format.type));
  std::vector<float> truth(format.geometry.pixels());
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    static_cast<void>(reader->read_frame(i, plane.data()));
    if (reader->info().has_truth) static_cast<void>(reader->read_truth(i, truth.data()));
  }
}

class CaptureDamage : public ::testing::TestWithParam<const char*> {};  // file name; a ".part" is read more leniently

// Reads the file in a child process: 0 if it was read or refused.
int end_of_reader(const std::filesystem::path& file) {
  return in_child([&] {
    static_cast<void>(std::freopen("/dev/null", "w", stderr));  // keep sanitizer reports out of the test's output
    alarm(kHang_s);
    read_everything(file);
    return ::testing::Test::HasFailure() ? 1 : 0;
  });
}

TEST_P(CaptureDamage, FlippedBytesNeverHangAndRarelyCrashTheLibrary) {
  const Scratch scratch;
  std::mt19937 random(7);
  int faults = 0;
  for (const int level : {0, 1}) {
    const std::vector<char> valid = valid_bytes(scratch, level);
    std::uniform_int_distribution<std::size_t> position(0, valid.size() - 1);
    for (int trial = 0; trial < kTrials; ++trial) {
      std::vector<char> bytes = valid;
      for (int flips = 1 + trial % 4; flips > 0; --flips) bytes[position(random)] = static_cast<char>(random());
      write_bytes(scratch / GetParam(), bytes);
      const int status = end_of_reader(scratch / GetParam());
      EXPECT_NE(status, -SIGALRM) << "hangs: level " << level << " trial " << trial;
      if (status != 0) ++faults;
    }
  }
  EXPECT_LE(faults, kMostLibraryFaults);
}

// Byte ranges of a dataset's values in the file.
std::vector<std::pair<std::size_t, std::size_t>> value_ranges(const std::filesystem::path& file, const char* path) {
  std::vector<std::pair<std::size_t, std::size_t>> ranges;
  edit(file, [&](hid_t f) {
    const hid_t dataset = H5Dopen2(f, path, H5P_DEFAULT);
    const hid_t space = H5Dget_space(dataset);
    hsize_t chunks = 0;
    H5Dget_num_chunks(dataset, space, &chunks);
    for (hsize_t i = 0; i < chunks; ++i) {
      std::array<hsize_t, 3> offset{};
      unsigned filters = 0;
      haddr_t address = 0;
      hsize_t bytes = 0;
      H5Dget_chunk_info(dataset, space, i, offset.data(), &filters, &address, &bytes);
      ranges.emplace_back(address, bytes);
    }
    H5Sclose(space);
    H5Dclose(dataset);
  });
  return ranges;
}

TEST_P(CaptureDamage, FlippedValuesNeverCrash) {
  const Scratch scratch;
  std::mt19937 random(11);
  for (const int level : {0, 1}) {
    const std::vector<char> valid = valid_bytes(scratch, level);
    for (const char* path : {"/frames", "/truth/frames", "/t", "/frame_id"}) {
      const auto ranges = value_ranges(scratch / "valid.h5", path);
      ASSERT_FALSE(ranges.empty()) << path;
      for (int trial = 0; trial < kTrials; ++trial) {
        const auto [begin, size] = ranges[random() % ranges.size()];
        std::vector<char> bytes = valid;
        bytes[begin + random() % std::min<std::size_t>(size, 64)] = static_cast<char>(random());
        write_bytes(scratch / GetParam(), bytes);
        read_everything(scratch / GetParam());
      }
    }
  }
}

TEST_P(CaptureDamage, CutOffAnywhereNeverCrashes) {
  const Scratch scratch;
  const std::vector<char> valid = valid_bytes(scratch, 0);
  for (std::size_t size = 0; size < valid.size(); size += 1 + valid.size() / kTrials) {
    write_bytes(scratch / GetParam(), {valid.begin(), valid.begin() + static_cast<std::ptrdiff_t>(size)});
    EXPECT_FALSE(CaptureReader::open(scratch / GetParam())) << size << " bytes of " << valid.size();
  }
}

INSTANTIATE_TEST_SUITE_P(Names, CaptureDamage, ::testing::Values("damaged.h5", "damaged.h5.part"),
                         [](const auto& row) { return std::string(row.param).size() > 10 ? "part" : "whole"; });

// Contiguous frames, as other programs write them, are complete, also when read by salvage().
TEST(CaptureDamageLayout, ContiguousFramesAreWhole) {
  const Scratch scratch;
  const auto file = scratch / "a.h5";
  constexpr std::size_t kFrames = 5;
  write_small(file, kFrames);
  edit(file, [&](hid_t f) {
    set_dataset(f, "/frames", H5T_NATIVE_UINT16, {kFrames, 3, 7}, H5T_NATIVE_UINT16, all_planes(kFrames).data());
  });
  std::filesystem::copy_file(file, scratch / "a.h5.part");
  Result<CaptureReader> readers[] = {CaptureReader::open(file), CaptureReader::open(scratch / "a.h5.part"),
                                     CaptureReader::salvage(file)};
  for (const auto& reader : readers) {
    ASSERT_TRUE(reader) << reader.error().message;
    expect_frames(*reader, kFrames);
    EXPECT_TRUE(reader->warnings().empty());
  }
}

rlim_t address_space() {
  rlim_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE));
}

// Raises the memory limit step by step. HDF5 on its own would end the process when it cannot allocate a file's cache.
TEST(Memory, TooLittleIsAnErrorWhereverItEnds) {
  if (address_space() > rlim_t{1} << 40) GTEST_SKIP() << "a sanitizer has taken all addresses";
  const Scratch scratch;
  const std::filesystem::path file = scratch / "scene.h5";
  {
    SceneStimulus scene{4, 4, std::vector<float>(16, 300.0F), std::vector<double>(100'000), {}, {}};
    std::iota(scene.t_s.begin(), scene.t_s.end(), 0.0);
    scene.x_px = scene.y_px = scene.t_s;
    auto writer = must(CaptureWriter::create(file, small_info()));
    ASSERT_TRUE(writer->write_stimulus(scene));
    ASSERT_TRUE(append(*writer, 0));
    ASSERT_TRUE(writer->close());
  }
  const auto use = [&] {
    const auto reader = CaptureReader::open(file);
    if (!reader || !reader->stimulus()) return false;
    auto writer = CaptureWriter::create(scratch / "other.h5", small_info());
    return writer && append(*writer, 0);
  };
  bool whole = false;
  for (rlim_t more = 0; !whole; more += 48 << 10) {
    ASSERT_LT(more, rlim_t{64} << 20);
    const int ended = in_child([&] {
      const rlimit limit{address_space() + more, RLIM_INFINITY};
      setrlimit(RLIMIT_AS, &limit);
      try {
        return use() ? 0 : 1;
      } catch (const std::bad_alloc&) {
        return 1;
      }
    });
    ASSERT_GE(ended, 0) << "with " << more << " bytes more";
    whole = ended == 0;
  }
}

// Out of memory: HDF5's own error message is misleading or missing.
TEST(Memory, AFrameThatFindsNoneIsNoDamage) {
  if (address_space() > rlim_t{1} << 40) GTEST_SKIP() << "a sanitizer has taken all addresses";
  const Scratch scratch;
  const std::filesystem::path file = scratch / "large.h5";
  const CaptureInfo info = small_info(PixelType::kUint16, {1024, 1024});
  std::vector<std::uint16_t> plane = plane_of<std::uint16_t>(0, info.format.geometry.pixels());
  {
    auto writer = must(CaptureWriter::create(file, info, {.deflate_level = 1}));
    ASSERT_TRUE(writer->append(0.0, 0, plane.data()));
    ASSERT_TRUE(writer->close());
  }
  const auto reader = must(CaptureReader::open(file));
  const int ended = in_child([&] {
    const rlimit all{address_space(), RLIM_INFINITY};
    setrlimit(RLIMIT_AS, &all);
    void* volatile taken = std::malloc(std::size_t{1} << 30);
    if (taken != nullptr) return 2;  // no limit, as under an emulator
    do {                             // also uses up memory freed earlier
      taken = std::malloc(std::size_t{1} << 16);
    } while (taken != nullptr);
    const Status read = reader->read_frame(0, plane.data());
    const bool told = !read && read.error().message.ends_with("frame 0 cannot be read: not enough memory");
    return told && read.error().kind == ErrorKind::kFailed ? 0 : 1;
  });
  EXPECT_EQ(ended, 0);
}

}  // namespace bolo::capture::capture_damage_test
