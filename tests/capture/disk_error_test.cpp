// A failing disk read is reported as an error, not as a missing item.
#include <dlfcn.h>
#include <unistd.h>

#include "src/capture/pixel_maps_io.hpp"
#include "tests/capture/small_captures.hpp"

// From the leak sanitizer; null without it.
extern "C" {
__attribute__((weak)) void __lsan_disable();  // NOLINT(bugprone-reserved-identifier)
__attribute__((weak)) void __lsan_enable();   // NOLINT(bugprone-reserved-identifier)
}

namespace bolo::capture::disk_error_test {

int g_reads_until_error = 0;  // 0: none

}  // namespace bolo::capture::disk_error_test

extern "C" ssize_t pread(int descriptor, void* out, size_t bytes, off_t offset) {
  int& left = bolo::capture::disk_error_test::g_reads_until_error;
  if (left > 0 && --left == 0) {
    errno = EIO;
    return -1;
  }
  using Function = ssize_t(int, void*, size_t, off_t);
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, "pread"))(descriptor, out, bytes, offset);
}

namespace bolo::capture::disk_error_test {
namespace {

using namespace bolo::capture::testing;

// Calls look() with an error at the first, second, ... read until none fails; returns how many calls gave no result.
// HDF5 itself leaks memory at such errors.
template <typename Look>
int fail_each_read(Look look) {
  int refused = 0;
  for (int read = 1;; ++read) {
    g_reads_until_error = read;
    if (__lsan_disable != nullptr) __lsan_disable();
    refused += look() ? 0 : 1;
    if (__lsan_enable != nullptr) __lsan_enable();
    const bool came = g_reads_until_error == 0;
    g_reads_until_error = 0;
    if (!came) return refused;
  }
}

TEST(DiskError, LeavesNothingOutOfACapture) {
  const Scratch scratch;
  {
    auto writer = must(CaptureWriter::create(scratch / "a.h5", small_info(), {.truth = true}));
    for (std::size_t i = 0; i < 8; ++i) ASSERT_TRUE(append(*writer, i, true));
    ASSERT_TRUE(writer->write_stimulus(Uniform{.temperature_k = 300.0}));
    ASSERT_TRUE(writer->add_event({0.01, "nuc"}));
    ASSERT_TRUE(writer->write_attribute("plane", "deblurred"));
    ASSERT_TRUE(writer->close());
  }
  const int refused = fail_each_read([&] {
    const auto reader = CaptureReader::open(scratch / "a.h5");
    if (!reader) return false;
    EXPECT_TRUE(reader->info().has_truth);
    EXPECT_EQ(reader->events().size(), 1U);
    const auto stimulus = reader->stimulus();
    EXPECT_TRUE(stimulus && std::holds_alternative<Uniform>(*stimulus));
    const auto attributes = reader->attributes();
    if (!attributes) return false;
    EXPECT_EQ(attributes->size(), 1U);
    return true;
  });
  EXPECT_GT(refused, 3);
}

TEST(DiskError, LeavesOutNoMapOfPixels) {
  const Scratch scratch;
  model::PixelMaps maps;
  maps.geometry = {3, 2};
  maps.gain.assign(6, 1.5F);
  maps.dead.assign(6, 0);
  ASSERT_TRUE(write_pixel_maps(scratch / "maps.h5", maps));
  const int refused = fail_each_read([&] {
    const auto read = read_pixel_maps(scratch / "maps.h5");
    if (!read) return false;
    EXPECT_EQ(read->gain, maps.gain);
    EXPECT_EQ(read->dead, maps.dead);
    return true;
  });
  EXPECT_GT(refused, 3);
}

}  // namespace
}  // namespace bolo::capture::disk_error_test
