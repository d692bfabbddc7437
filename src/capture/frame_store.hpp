// Frames of a dataset, one at a time, from either order of storage.
#pragma once

#include <string>
#include <vector>

#include "src/capture/h5.hpp"
#include "src/core/frame.hpp"

namespace bolo::capture {

enum class FrameOrder {
  kFrameMajor,  // (n, height, width): bolo-capture
  kMatlab,      // (height, width, n): MATLAB's n x width x height, which HDF5 lists in reverse
};

// Values are returned as `type()`: uint16 stays, everything else becomes float32. Thread: any one at a time.
class FrameStore {
 public:
  static constexpr std::size_t kBlockBytes = std::size_t{64} << 20;

  // Any number type; stricter callers check stored_type(). `block_bytes`: memory for transposing MATLAB's order.
  // `values`: the dataset is (n, height, width, values), and "frames" are `values` times as wide. Errors: kBadInput
  // naming `path`.
  static Result<FrameStore> open(hid_t file, const std::string& path, FrameOrder order,
                                 h5::Expect expect = h5::Expect::kWhole, std::size_t block_bytes = kBlockBytes,
                                 hsize_t values = 0);

  // After Expect::kPart: drops frames at the end that never reached the file. More than `most` of them are an error.
  Status drop_missing_end(std::size_t most);

  std::size_t frames() const noexcept { return frames_; }
  Geometry geometry() const noexcept { return geometry_; }
  PixelType type() const noexcept { return type_; }
  const std::string& stored_type() const noexcept { return stored_type_; }

  // Frame `index`, row-major; `out` has plane_bytes(geometry(), type()) bytes.
  Status read(std::size_t index, void* out);

 private:
  Status read_plane(std::size_t index, void* out);
  bool chunk_fits(std::size_t index) const;
  Status read_block(std::size_t index);
  bool is_stored(std::size_t index);
  h5::Dims corner(std::size_t index) const;

  h5::Handle dataset_;
  std::string path_;
  std::string stored_type_;
  FrameOrder order_ = FrameOrder::kFrameMajor;
  PixelType type_ = PixelType::kUint16;
  Geometry geometry_;
  std::size_t frames_ = 0;
  h5::Dims one_frame_;  // its shape in the file, first axis 1
  bool contiguous_ = false;
  bool checks_chunk_ = false;  // one uncompressed chunk per frame: its stored size is known

  // MATLAB's order keeps a pixel's whole history together, so frames are read in blocks and transposed.
  std::size_t block_frames_ = 1;
  std::size_t block_begin_ = 0;
  std::size_t block_count_ = 0;
  std::vector<std::byte> block_;  // (height, width, block_count_)
};

}  // namespace bolo::capture
