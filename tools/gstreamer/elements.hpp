// The elements of the plugin, and what both need.
#pragma once

#include <gst/gst.h>
#include <gst/video/video.h>

#include <cstddef>
#include <cstring>

namespace bolo::tools {

// Registers "bolosrc" and "bolodeblur". Thread: GStreamer's, once.
gboolean register_source(GstPlugin* plugin);
gboolean register_deblur(GstPlugin* plugin);

constexpr GParamFlags kProperty = static_cast<GParamFlags>(G_PARAM_READWRITE | G_PARAM_STATIC_STRINGS);
constexpr GParamFlags kReadable = static_cast<GParamFlags>(G_PARAM_READABLE | G_PARAM_STATIC_STRINGS);

// A mapped frame of one plane, for the life of this.
class MappedFrame {
 public:
  MappedFrame(const GstVideoInfo& info, GstBuffer* buffer, GstMapFlags flags)
      : mapped_(gst_video_frame_map(&frame_, &info, buffer, flags) != FALSE) {}
  ~MappedFrame() {
    if (mapped_) gst_video_frame_unmap(&frame_);
  }
  MappedFrame(const MappedFrame&) = delete;
  MappedFrame& operator=(const MappedFrame&) = delete;

  explicit operator bool() const { return mapped_; }
  std::size_t height() const { return static_cast<std::size_t>(GST_VIDEO_FRAME_HEIGHT(&frame_)); }
  std::size_t row_bytes() const {
    return static_cast<std::size_t>(GST_VIDEO_FRAME_WIDTH(&frame_) * GST_VIDEO_FRAME_COMP_PSTRIDE(&frame_, 0));
  }
  char* row(std::size_t y) const {
    return static_cast<char*>(GST_VIDEO_FRAME_PLANE_DATA(&frame_, 0)) +
           y * static_cast<std::size_t>(GST_VIDEO_FRAME_PLANE_STRIDE(&frame_, 0));
  }
  // From and to rows without padding.
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
  GstVideoFrame frame_{};
  bool mapped_;
};

}  // namespace bolo::tools
