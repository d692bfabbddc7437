#include "src/capture/frame_store.hpp"

#include <algorithm>
#include <cstdint>

#include "src/capture/contents.hpp"

namespace bolo::capture {
namespace {

constexpr std::size_t kMostPixels = std::size_t{1} << 26;  // 64 M: beyond any thermal camera
constexpr std::size_t kMostCache = std::size_t{128} << 20;

hid_t memory_type(PixelType type) { return type == PixelType::kUint16 ? H5T_NATIVE_UINT16 : H5T_NATIVE_FLOAT; }

bool is_uint16(hid_t type) {
  return H5Tget_class(type) == H5T_INTEGER && H5Tget_size(type) == 2 && H5Tget_sign(type) == H5T_SGN_NONE;
}

h5::Dims chunk_shape(hid_t dataset, std::size_t rank) {
  const h5::Handle properties(H5Dget_create_plist(dataset));
  if (H5Pget_layout(properties.get()) != H5D_CHUNKED) return {};
  h5::Dims chunk(rank);
  if (H5Pget_chunk(properties.get(), static_cast<int>(rank), chunk.data()) != static_cast<int>(rank)) return {};
  return chunk;
}

bool is_filtered(hid_t dataset) {
  const h5::Handle properties(H5Dget_create_plist(dataset));
  return H5Pget_nfilters(properties.get()) != 0;
}

// Bytes of all chunks that one frame touches; 0 for unchunked data.
std::size_t chunks_of_a_frame(const h5::Dims& dims, const h5::Dims& chunk, std::size_t frame_axis, std::size_t bytes) {
  if (chunk.empty()) return 0;
  h5::Dims touched{bytes};
  for (std::size_t axis = 0; axis < dims.size(); ++axis) {
    const hsize_t count = axis == frame_axis ? 1 : (dims[axis] + chunk[axis] - 1) / chunk[axis];
    touched.push_back(chunk[axis]);
    touched.push_back(count);
  }
  return h5::product(touched).value_or(kMostCache);
}

// Reopens the dataset with a chunk cache that holds whole frames: with the default of 1 MiB the same chunk would be
// decompressed again for each frame in it.
h5::Handle with_cache(hid_t file, const std::string& path, std::size_t cache_bytes) {
  const h5::Handle access(H5Pcreate(H5P_DATASET_ACCESS));
  constexpr std::size_t kSlots = 4099;          // prime, more than the chunks held
  constexpr double kDropReadChunksFirst = 1.0;  // frames are read once, in order
  H5Pset_chunk_cache(access.get(), kSlots, std::clamp(cache_bytes, std::size_t{1} << 20, kMostCache),
                     kDropReadChunksFirst);
  return h5::Handle(H5Dopen2(file, path.c_str(), access.get()));
}

template <typename T>
void pick_frame(const std::byte* block, std::size_t count, std::size_t at, std::size_t pixels, void* out) {
  const T* from = reinterpret_cast<const T*>(block);
  T* to = static_cast<T*>(out);
  for (std::size_t i = 0; i < pixels; ++i) to[i] = from[i * count + at];
}

Status check_shape(const std::string& path, const h5::Dims& dims, FrameOrder order, h5::Expect expect, hsize_t values) {
  const char* expected = order == FrameOrder::kFrameMajor ? "(n, height, width)" : "(height, width, n)";
  if (values > 0 && (dims.size() != 4 || dims[3] != values)) {
    return bad_input(path + " has the shape " + h5::text(dims) + "; expected (n, down, across, " +
                     std::to_string(values) + ")");
  }
  if (values == 0 && dims.size() != 3) {
    return bad_input(path + " has the shape " + h5::text(dims) + "; expected three dimensions " + expected);
  }
  if (expect == h5::Expect::kPart && dims[0] == 0) {
    return bad_input(path + " is empty: " + kNoFrameStored);
  }
  if (std::find(dims.begin(), dims.end(), hsize_t{0}) != dims.end()) {
    return bad_input(path + " is empty: its shape is " + h5::text(dims) + ", in the order " + expected);
  }
  const std::size_t first = order == FrameOrder::kFrameMajor ? 1 : 0;
  if (dims[first] > kMostPixels || dims[first + 1] > kMostPixels / dims[first]) {
    return bad_input(path + " has frames of more than 64 million pixels: its shape is " + h5::text(dims));
  }
  return {};
}

}  // namespace

Result<FrameStore> FrameStore::open(hid_t file, const std::string& path, FrameOrder order, h5::Expect expect,
                                    std::size_t block_bytes, hsize_t values) {
  ASSIGN_OR_RETURN(h5::Handle dataset, h5::open_dataset(file, path, expect));
  const h5::Dims dims = h5::shape(dataset.get());
  RETURN_IF_ERROR(check_shape(path, dims, order, expect, values));
  RETURN_IF_ERROR(h5::check_numbers(dataset.get(), path));

  FrameStore store;
  const h5::Handle type(H5Dget_type(dataset.get()));
  store.stored_type_ = h5::type_text(type.get());
  const bool frame_major = order == FrameOrder::kFrameMajor;
  store.path_ = path;
  store.order_ = order;
  store.type_ = is_uint16(type.get()) ? PixelType::kUint16 : PixelType::kFloat32;
  store.frames_ = dims[frame_major ? 0 : 2];
  store.geometry_ = {static_cast<int>(dims[frame_major ? 2 : 1]), static_cast<int>(dims[frame_major ? 1 : 0])};
  if (values > 0) store.geometry_.width *= static_cast<int>(values);
  store.one_frame_ = dims;
  store.one_frame_[0] = 1;

  const h5::Dims chunk = chunk_shape(dataset.get(), dims.size());
  store.contiguous_ = chunk.empty();
  if (expect == h5::Expect::kPart && !chunk.empty() && chunk != store.one_frame_) {
    return bad_input(path + " is chunked by " + h5::text(chunk) + ", not by the frame of " + h5::text(dims) +
                     "; the unfinished file is damaged");
  }
  const std::size_t frame_axis = frame_major ? 0 : 2;
  const std::size_t cache = chunks_of_a_frame(dims, chunk, frame_axis, H5Tget_size(type.get()));
  if (!chunk.empty() && is_filtered(dataset.get()) && chunk[frame_axis] > 1 && cache > kMostCache) {
    return bad_input(path +
                     " is compressed in pieces of more than 128 MiB, each of which would be unpacked for every " +
                     "frame in it; rewrite the file with smaller ones: h5repack -l CHUNK=...");
  }
  store.block_frames_ =
      std::clamp(block_bytes / plane_bytes(store.geometry_, store.type_), std::size_t{1}, store.frames_);
  store.checks_chunk_ = frame_major && chunk == store.one_frame_ && !is_filtered(dataset.get());
  store.dataset_ = with_cache(file, path, cache);
  if (!store.dataset_) return bad_input(path + " cannot be opened" + h5::because());
  return store;
}

Status FrameStore::read(std::size_t index, void* out) {
  if (index >= frames_) {
    return bad_input(path_ + " has " + std::to_string(frames_) + " frames; there is no frame " + std::to_string(index));
  }
  if (order_ == FrameOrder::kFrameMajor) return read_plane(index, out);
  if (index < block_begin_ || index >= block_begin_ + block_count_) {
    if (Status good = read_block(index); !good) return good;
  }
  const std::size_t at = index - block_begin_;
  if (type_ == PixelType::kUint16) {
    pick_frame<std::uint16_t>(block_.data(), block_count_, at, geometry_.pixels(), out);
  } else {
    pick_frame<float>(block_.data(), block_count_, at, geometry_.pixels(), out);
  }
  return {};
}

h5::Dims FrameStore::corner(std::size_t index) const {
  h5::Dims at(one_frame_.size(), 0);
  at[0] = index;
  return at;
}

// HDF5 "reads" frames missing in a torn index, and leaves the buffer unchanged: detected with two different buffers.
bool FrameStore::is_stored(std::size_t index) {
  hsize_t bytes = 0;
  if (!contiguous_ && (H5Dget_chunk_storage_size(dataset_.get(), corner(index).data(), &bytes) < 0 || bytes == 0))
    return false;
  std::vector<std::byte> plane(plane_bytes(geometry_, type_), std::byte{0x00});
  std::vector<std::byte> again(plane.size(), std::byte{0xFF});
  return read_plane(index, plane.data()) && read_plane(index, again.data()) && plane == again;
}

Status FrameStore::drop_missing_end(std::size_t most) {
  const std::size_t declared = frames_;
  while (frames_ > 0 && !is_stored(frames_ - 1)) {
    --frames_;
    if (declared - frames_ > most) {
      return bad_input(path_ + ": the recording was cut off while its index was being written; its last " +
                       std::to_string(most) + " frames cannot be found");
    }
  }
  return {};
}

// HDF5 1.10 trusts the size stated by the index, and reads beyond its buffer if that is wrong.
bool FrameStore::chunk_fits(std::size_t index) const {
  hsize_t bytes = 0;
  return H5Dget_chunk_storage_size(dataset_.get(), corner(index).data(), &bytes) >= 0 &&
         bytes == plane_bytes(geometry_, type_);
}

Status FrameStore::read_plane(std::size_t index, void* out) {
  if (checks_chunk_ && !chunk_fits(index)) {
    return bad_input(path_ + ": frame " + std::to_string(index) + " is not whole: the file is damaged");
  }
  if (h5::read_block(dataset_.get(), memory_type(type_), corner(index), one_frame_, out)) return {};
  return h5::not_read(path_ + ": frame " + std::to_string(index));
}

Status FrameStore::read_block(std::size_t index) {
  const std::size_t begin = index / block_frames_ * block_frames_;
  const std::size_t frames = std::min(block_frames_, frames_ - begin);
  const h5::Dims count{static_cast<hsize_t>(geometry_.height), static_cast<hsize_t>(geometry_.width), frames};
  block_.resize(plane_bytes(geometry_, type_) * frames);
  block_count_ = 0;  // nothing usable until the read succeeds
  if (!h5::read_block(dataset_.get(), memory_type(type_), {0, 0, begin}, count, block_.data())) {
    return h5::not_read(path_ + ": frames from " + std::to_string(begin));
  }
  block_begin_ = begin;
  block_count_ = frames;
  return {};
}

}  // namespace bolo::capture
