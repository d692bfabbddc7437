// The authors' `.mat`, as MATLAB writes it: HDF5 after 512 bytes of its own, dimensions in reverse.
#include <gtest/gtest.h>

#include <fstream>
#include <numeric>

#include "src/capture/frame_store.hpp"
#include "tests/capture/hdf5_edit.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/refusal.hpp"

namespace bolo::capture::matlab_capture_test {
namespace {

using namespace bolo::capture::testing;

constexpr std::size_t kFrames = 6;
constexpr std::size_t kWidth = 7;
constexpr std::size_t kHeight = 3;
const std::vector<double> kTimes{0.0, 0.005, 0.01, 0.025, 0.03, 0.0351};

// MATLAB's frames(n, x, y), column-major, is (y, x, n) in HDF5.
std::vector<double> matlab_order() {
  std::vector<double> values(kFrames * kWidth * kHeight);
  for (std::size_t n = 0; n < kFrames; ++n) {
    for (std::size_t i = 0; i < kWidth * kHeight; ++i) values[i * kFrames + n] = value_at(n, i);
  }
  return values;
}

struct Layout {
  hid_t type;
  std::vector<hsize_t> t_dims;
  std::vector<hsize_t> chunk;
};

std::filesystem::path matlab_file(const Scratch& scratch, const std::string& name, const Layout& layout) {
  const auto file = scratch / name;
  const hid_t creation = H5Pcreate(H5P_FILE_CREATE);
  H5Pset_userblock(creation, 512);
  H5Fclose(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, creation, H5P_DEFAULT));
  H5Pclose(creation);
  edit(file, [&](hid_t f) {
    set_dataset(f, "/t", H5T_NATIVE_DOUBLE, layout.t_dims, H5T_NATIVE_DOUBLE, kTimes.data());
    set_string(f, "/t", "MATLAB_class", "double");
    const auto values = matlab_order();
    set_dataset(f, "/frames", layout.type, {kHeight, kWidth, kFrames}, H5T_NATIVE_DOUBLE, values.data(), layout.chunk,
                layout.chunk.empty() ? 0 : 3);
    set_string(f, "/frames", "MATLAB_class", "single");
  });
  std::fstream(file, std::ios::in | std::ios::out) << "MATLAB 7.3 MAT-file, Platform: GLNXA64";
  return file;
}

template <typename T>
void expect_content(const std::filesystem::path& file) {
  const auto reader = CaptureReader::open(file);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->file_format(), FileFormat::kMatlab);
  EXPECT_EQ(reader->info().format.geometry, (Geometry{7, 3}));
  EXPECT_EQ(reader->info().format.scale, (LinearScale{Unit::kKelvin, 1.0, 0.0}));
  EXPECT_NEAR(reader->info().format.frame_period_s, 0.005, 1e-12);
  EXPECT_EQ(reader->info().frames, kFrames);
  EXPECT_EQ(reader->t(), kTimes);
  EXPECT_EQ(reader->frame_id(), (std::vector<std::uint64_t>{0, 1, 2, 5, 6, 7})) << "two frames were lost before 0.025";
  ASSERT_EQ(bytes_of(reader->info().format.type), sizeof(T));
  for (const std::size_t i : {5U, 0U, 3U}) {
    std::vector<T> plane(kWidth * kHeight);
    ASSERT_TRUE(reader->read_frame(i, plane.data()));
    EXPECT_EQ(plane, plane_of<T>(i, plane.size())) << "frame " << i;
  }
}

TEST(MatlabCapture, DoubleBecomesFloat) {
  const Scratch scratch;
  expect_content<float>(matlab_file(scratch, "a.mat", {H5T_IEEE_F64LE, {kFrames, 1}, {}}));
}

TEST(MatlabCapture, SingleWithColumnOfTimes) {
  const Scratch scratch;
  expect_content<float>(matlab_file(scratch, "a.mat", {H5T_IEEE_F32LE, {1, kFrames}, {2, 4, 4}}));
}

TEST(MatlabCapture, Uint16StaysUint16) {
  const Scratch scratch;
  expect_content<std::uint16_t>(matlab_file(scratch, "a.mat", {H5T_STD_U16LE, {kFrames, 1}, {}}));
}

TEST(MatlabCapture, ContentTellsNotTheName) {
  const Scratch scratch;
  expect_content<float>(matlab_file(scratch, "a.h5", {H5T_IEEE_F64LE, {kFrames}, {1, 7, 6}}));
}

TEST(MatlabCapture, FramesInTheWrongOrderAreRefused) {
  const Scratch scratch;
  const auto file = matlab_file(scratch, "a.mat", {H5T_IEEE_F64LE, {kFrames, 1}, {}});
  edit(file, with_dataset("/frames", H5T_NATIVE_DOUBLE, {kFrames, kHeight, kWidth}, matlab_order()));
  expect_refused(CaptureReader::open(file), {"t has 6 values but frames"});
}

TEST(MatlabCapture, FallingTimesAreRefused) {
  const Scratch scratch;
  const auto file = matlab_file(scratch, "a.mat", {H5T_IEEE_F64LE, {kFrames, 1}, {}});
  edit(file, with_doubles("/t", {0, 0.005, 0.01, 0.009, 0.03, 0.04}));
  expect_refused(CaptureReader::open(file), {"value 3"});
}

// Blocks of two frames out of six: forwards, backwards and across the edges.
TEST(FrameStore, MatlabOrderByTheBlock) {
  const Scratch scratch;
  const auto file = matlab_file(scratch, "a.mat", {H5T_IEEE_F64LE, {kFrames, 1}, {}});
  const h5::Handle handle(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  const std::size_t two_frames = 2 * kWidth * kHeight * sizeof(float);
  auto store =
      FrameStore::open(handle.get(), "/frames", FrameOrder::kMatlab, h5::Expect::kWhole, two_frames + sizeof(float));
  ASSERT_TRUE(store) << store.error().message;
  for (const std::size_t i : {0U, 1U, 2U, 5U, 4U, 3U, 0U}) {
    std::vector<float> plane(kWidth * kHeight);
    ASSERT_TRUE(store->read(i, plane.data()));
    EXPECT_EQ(plane, plane_of<float>(i, plane.size())) << "frame " << i;
  }
  std::vector<float> plane(kWidth * kHeight);
  EXPECT_FALSE(store->read(kFrames, plane.data()));
}

}  // namespace
}  // namespace bolo::capture::matlab_capture_test
