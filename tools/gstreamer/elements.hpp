// The elements of the plugin and their shared parts.
#pragma once

#include <gst/gst.h>
#include <gst/video/video.h>

#include <cstddef>
#include <cstring>
#include <utility>

namespace bolo::tools {

// Registers "bolodeblur". Thread: GStreamer's, once.
gboolean register_deblur(GstPlugin* plugin);

constexpr GParamFlags kProperty = static_cast<GParamFlags>(G_PARAM_READWRITE | G_PARAM_STATIC_STRINGS);
constexpr GParamFlags kReadable = static_cast<GParamFlags>(G_PARAM_READABLE | G_PARAM_STATIC_STRINGS);

// Maps a one-plane frame for its lifetime; false if the buffer, by its layout, ends before the last row. If the layout
// is larger than the caps, the frame is in its corner.
class MappedFrame {
 public:
  MappedFrame(const GstVideoInfo& info, GstBuffer* buffer, GstMapFlags flags)
      : height_(static_cast<std::size_t>(info.height)),
        row_bytes_(static_cast<std::size_t>(info.width * GST_VIDEO_INFO_COMP_PSTRIDE(&info, 0))),
        mapped_(gst_video_frame_map(&frame_, &info, buffer, flags) != FALSE) {
    if (mapped_ && !fits()) unmap();
  }
  ~MappedFrame() { unmap(); }
  MappedFrame(const MappedFrame&) = delete;
  MappedFrame& operator=(const MappedFrame&) = delete;

  explicit operator bool() const { return mapped_; }
  std::size_t height() const { return height_; }
  std::size_t row_bytes() const { return row_bytes_; }
  char* row(std::size_t y) const {
    return static_cast<char*>(GST_VIDEO_FRAME_PLANE_DATA(&frame_, 0)) +
           y * static_cast<std::size_t>(GST_VIDEO_FRAME_PLANE_STRIDE(&frame_, 0));
  }
  // Copy from and to rows without padding.
  void take(const void* rows) const {
    for (std::size_t y = 0; y < height(); ++y) {
      std::memcpy(row(y), static_cast<const char*>(rows) + y * row_bytes(), row_bytes());
    }
  }
  void give(void* rows) const {
    for (std::size_t y = 0; y < height(); ++y) {
      std::memcpy(static_cast<char*>(rows) + y * row_bytes(), row(y), row_bytes());
    }
  }

 private:
  void unmap() {
    if (std::exchange(mapped_, false)) gst_video_frame_unmap(&frame_);
  }
  // GStreamer checks the size only of buffers without a layout of their own.
  bool fits() const {
    const std::ptrdiff_t begin = row(0) - reinterpret_cast<const char*>(frame_.map[0].data);
    const std::ptrdiff_t end = row(height_ - 1) - row(0) + begin + static_cast<std::ptrdiff_t>(row_bytes_);
    const int stride = GST_VIDEO_FRAME_PLANE_STRIDE(&frame_, 0);
    return stride >= 0 && static_cast<std::size_t>(stride) >= row_bytes_ && begin >= 0 &&
           end <= static_cast<std::ptrdiff_t>(frame_.map[0].size);
  }

  std::size_t height_;
  std::size_t row_bytes_;
  GstVideoFrame frame_{};
  bool mapped_;
};

}  // namespace bolo::tools
