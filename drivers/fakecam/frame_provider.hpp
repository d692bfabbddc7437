// Source of the fake camera's frames.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/plane.hpp"
#include "src/core/result.hpp"

namespace bolo::fakecam {

// A finite sequence of frames with the counters and times of the camera that took them. The description is fixed;
// read() is called by one thread at a time.
class FrameProvider {
 public:
  virtual ~FrameProvider() = default;

  virtual const StreamFormat& format() const noexcept = 0;
  virtual const std::vector<std::uint64_t>& frame_ids() const noexcept = 0;  // rising
  virtual const std::vector<double>& times_s() const noexcept = 0;           // rising, as many as frame_ids()
  virtual std::string serial() const { return {}; }                          // of the camera that took them

  // The frame in its stored type; `out` has plane_bytes(format().geometry, format().type) bytes.
  virtual Status read(std::size_t index, void* out) = 0;
};

// Frames that lie in memory one after the other.
class MemoryFrames final : public FrameProvider {
 public:
  struct Content {
    StreamFormat format;
    std::vector<std::uint64_t> frame_ids;
    std::vector<double> times_s;
    std::vector<std::byte> planes;  // frame_ids.size() planes
    std::string serial;
  };
  explicit MemoryFrames(Content content) : content_(std::move(content)) {}

  const StreamFormat& format() const noexcept override { return content_.format; }
  const std::vector<std::uint64_t>& frame_ids() const noexcept override { return content_.frame_ids; }
  const std::vector<double>& times_s() const noexcept override { return content_.times_s; }
  std::string serial() const override { return content_.serial; }
  Status read(std::size_t index, void* out) override;

 private:
  Content content_;
};

// Opens a capture. Up to `preload_bytes` it is read whole, so that no disk stands behind the stream; a bigger one is
// read frame by frame. Errors: the reader's; an empty capture. Thread: setup.
Result<std::unique_ptr<FrameProvider>> open_capture(const std::filesystem::path& file,
                                                    std::size_t preload_bytes = std::size_t{1} << 30U);

}  // namespace bolo::fakecam
