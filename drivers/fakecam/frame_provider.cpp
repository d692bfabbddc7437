#include "drivers/fakecam/frame_provider.hpp"

#include <cstring>

namespace bolo::fakecam {
namespace {

class CaptureFrames final : public FrameProvider {
 public:
  explicit CaptureFrames(capture::CaptureReader reader) : reader_(std::move(reader)) {}

  const StreamFormat& format() const noexcept override { return reader_.info().format; }
  const std::vector<std::uint64_t>& frame_ids() const noexcept override { return reader_.frame_id(); }
  const std::vector<double>& times_s() const noexcept override { return reader_.t(); }
  std::string serial() const override { return reader_.info().camera_serial; }
  Status read(std::size_t index, void* out) override { return reader_.read_frame(index, out); }

 private:
  capture::CaptureReader reader_;
};

Result<MemoryFrames::Content> preload(const capture::CaptureReader& reader) {
  const auto& info = reader.info();
  const std::size_t stride = plane_bytes(info.format.geometry, info.format.type);
  MemoryFrames::Content content{info.format, reader.frame_id(), reader.t(),
                                std::vector<std::byte>(stride * info.frames), info.camera_serial};
  for (std::size_t i = 0; i < info.frames; ++i) {
    if (auto status = reader.read_frame(i, content.planes.data() + i * stride); !status) {
      return tl::unexpected<Error>(status.error());
    }
  }
  return content;
}

}  // namespace

Status MemoryFrames::read(std::size_t index, void* out) {
  const std::size_t stride = plane_bytes(content_.format.geometry, content_.format.type);
  std::memcpy(out, content_.planes.data() + index * stride, stride);
  return {};
}

Result<std::unique_ptr<FrameProvider>> open_capture(const std::filesystem::path& file, std::size_t preload_bytes) {
  auto reader = capture::CaptureReader::open(file);
  if (!reader) return tl::unexpected<Error>(reader.error());
  const auto& info = reader->info();
  if (info.frames == 0) return bad_input(file.string() + ": /frames is empty; a camera needs at least one frame");
  if (info.frames * plane_bytes(info.format.geometry, info.format.type) > preload_bytes) {
    return std::make_unique<CaptureFrames>(std::move(*reader));
  }
  auto content = preload(*reader);
  if (!content) return tl::unexpected<Error>(content.error());
  return std::make_unique<MemoryFrames>(std::move(*content));
}

}  // namespace bolo::fakecam
