#include "drivers/v4l2_source/video_device.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include "src/core/text.hpp"

namespace bolo::v4l2_source {
namespace {

constexpr std::size_t kBytesAPixel = 2;
constexpr std::uint32_t kMostPixels = 32U << 20;  // larger than any thermal camera: limits the memory of the buffers

std::string text_of(std::uint32_t code) {
  std::string text;
  for (int i = 0; i < 4; ++i) text += static_cast<char>(code >> (8 * i) & 0x7fU);
  return printable(text.substr(0, text.find_last_not_of(' ') + 1));
}

std::size_t stride_of(const v4l2_pix_format& pixels) {
  return std::max<std::size_t>(pixels.bytesperline, kBytesAPixel * pixels.width);
}

std::string list_of(const std::vector<VideoNode>& nodes) {
  std::string text;
  for (const VideoNode& node : nodes) {
    text += (text.empty() ? "" : ", ") + node.path + (node.serial.empty() ? "" : " (" + node.serial + ")");
  }
  return text.empty() ? "none" : printable(text);
}

bool is_path(const std::string& device) { return device.find('/') != std::string::npos; }

// Nodes to try, in order: a camera may have several, of which one sends frames.
Result<std::vector<VideoNode>> candidates(VideoSystem& system, const std::string& device, const std::string& serial) {
  std::vector<VideoNode> all = system.nodes();
  std::vector<VideoNode> chosen;
  const std::string& wanted = is_path(device) ? serial : device;
  for (const VideoNode& node : all) {
    const bool right = wanted.empty() ? node.path == device : node.serial == wanted;
    if (right) chosen.insert(node.path == device ? chosen.begin() : chosen.end(), node);
  }
  if (!chosen.empty()) return chosen;
  if (wanted.empty()) return std::vector<VideoNode>{{device, ""}};  // a symbolic link: let the kernel resolve it
  return bad_input("no video device has the serial number '" + wanted + "'; there are: " + list_of(all));
}

std::string describe_error(int error) {
  switch (error) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
      return "it is not there: plug the camera in; `v4l2-ctl --list-devices` shows what is";
    case EACCES:
    case EPERM:
      return "this user may not open it: join the group video";
    case EBUSY:
      return std::string(kInUse) + ", perhaps a bolod that runs: end that one";
    default:
      return std::strerror(error);
  }
}

}  // namespace

tl::unexpected<Error> VideoDevice::refused(const std::string& what) const { return bad_input(path_ + ": " + what); }

Result<std::unique_ptr<VideoDevice>> VideoDevice::open(VideoSystem& system, const V4l2SourceOptions& options,
                                                       const std::string& serial) {
  ASSIGN_OR_RETURN(const auto nodes, candidates(system, options.device, serial));
  Status status;
  for (const VideoNode& node : nodes) {
    const int fd = system.open(node.path.c_str());
    if (fd < 0) {
      status = bad_input(node.path + ": " + describe_error(errno));
      continue;
    }
    std::unique_ptr<VideoDevice> device(new VideoDevice(system, fd, node.path, node.serial));
    status = device->check_capabilities();
    if (status) status = device->agree_on_format(options.format);
    if (status) status = device->request_buffers(options.buffers);
    if (status) return device;
  }
  return tl::unexpected<Error>(std::move(status.error()));
}

VideoDevice::~VideoDevice() {
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (streaming_) system_.ioctl(fd_, VIDIOC_STREAMOFF, &type);
  for (const Buffer& buffer : buffers_) system_.unmap(buffer.memory, buffer.bytes);
  system_.close(fd_);
}

Status VideoDevice::check_capabilities() {
  v4l2_capability device{};
  if (system_.ioctl(fd_, VIDIOC_QUERYCAP, &device) < 0) return refused("it is no video device");
  const std::uint32_t can =
      (device.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? device.device_caps : device.capabilities;
  if ((can & V4L2_CAP_VIDEO_CAPTURE) == 0) return refused("it gives no frames; a camera's other node may");
  if ((can & V4L2_CAP_STREAMING) == 0) return refused("it has no memory-mapped buffers");
  model_.assign(reinterpret_cast<const char*>(device.card), strnlen(reinterpret_cast<const char*>(device.card), 32));
  return {};
}

std::string VideoDevice::offered() {
  std::string text;
  v4l2_fmtdesc format{};
  format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  for (std::uint32_t i = 0; i < 32; ++i) {
    format.index = i;  // set again, because the driver may change it
    if (system_.ioctl(fd_, VIDIOC_ENUM_FMT, &format) != 0) break;
    text += (text.empty() ? "" : ", ") + text_of(format.pixelformat);
  }
  return text.empty() ? "nothing" : text;
}

// Keeps the device's image size.
Status VideoDevice::agree_on_format(std::uint32_t wanted) {
  v4l2_format format{};
  format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (system_.ioctl(fd_, VIDIOC_G_FMT, &format) < 0) return refused(describe_error(errno));
  v4l2_pix_format& pixels = format.fmt.pix;
  if (pixels.pixelformat != wanted) {
    pixels.pixelformat = wanted;
    pixels.field = V4L2_FIELD_NONE;
    pixels.bytesperline = pixels.sizeimage = 0;
    const bool set = system_.ioctl(fd_, VIDIOC_S_FMT, &format) == 0;
    if (!set && errno == EBUSY) return refused(describe_error(errno));
    if (!set || pixels.pixelformat != wanted) {
      return refused(
          fmt::format("it does not send {}; it offers {}. Values of 8 bits are a picture for the eye, no "
                      "measurement: look for the camera's 16-bit mode",
                      text_of(wanted), offered()));
    }
  }
  if (pixels.width == 0 || pixels.height == 0 || pixels.height > kMostPixels / pixels.width) {
    return refused(fmt::format("it sends frames of {}x{}: from 1 to {} pixels are taken", pixels.width, pixels.height,
                               kMostPixels));
  }
  code_ = pixels.pixelformat;
  geometry_ = {static_cast<int>(pixels.width), static_cast<int>(pixels.height)};
  stride_ = stride_of(pixels);
  image_bytes_ = pixels.sizeimage;
  // Frames of either size count as complete, so their last row must lie within both.
  const std::size_t last_row = stride_ * (pixels.height - 1);
  if (image_bytes_ < last_row + kBytesAPixel * pixels.width) {
    return refused(fmt::format("it sends frames of {} bytes, too few for {}x{} pixels of 16 bits", image_bytes_,
                               pixels.width, pixels.height));
  }
  query_period();
  return {};
}

bool VideoDevice::has_its_format() noexcept {
  v4l2_format now{};
  now.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (system_.ioctl(fd_, VIDIOC_G_FMT, &now) < 0) return true;  // a lost device is noticed by its frames
  const v4l2_pix_format& pixels = now.fmt.pix;
  return pixels.pixelformat == code_ && static_cast<int>(pixels.width) == geometry_.width &&
         static_cast<int>(pixels.height) == geometry_.height && stride_of(pixels) == stride_;
}

void VideoDevice::query_period() {
  v4l2_streamparm parameters{};
  parameters.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (system_.ioctl(fd_, VIDIOC_G_PARM, &parameters) < 0) return;
  const v4l2_fract& period = parameters.parm.capture.timeperframe;
  if (period.numerator > 0 && period.denominator > 0) {
    period_s_ = static_cast<double>(period.numerator) / static_cast<double>(period.denominator);
  }
}

Status VideoDevice::request_buffers(int count) {
  v4l2_requestbuffers request{};
  request.count = static_cast<std::uint32_t>(count);
  request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  request.memory = V4L2_MEMORY_MMAP;
  if (system_.ioctl(fd_, VIDIOC_REQBUFS, &request) < 0) return refused(describe_error(errno));
  if (request.count < 2) return refused("it has no room for two frames");
  for (std::uint32_t i = 0; i < std::min<std::uint32_t>(request.count, VIDEO_MAX_FRAME); ++i) {
    v4l2_buffer buffer{};
    buffer.index = i;
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    if (system_.ioctl(fd_, VIDIOC_QUERYBUF, &buffer) < 0) return refused(describe_error(errno));
    void* const memory = system_.map(fd_, buffer.length, buffer.m.offset);
    if (memory == nullptr) return refused("its buffers cannot be mapped: " + describe_error(errno));
    buffers_.push_back({memory, buffer.length});
    if (system_.ioctl(fd_, VIDIOC_QBUF, &buffer) < 0) return refused(describe_error(errno));
  }
  return {};
}

Status VideoDevice::start() {
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (system_.ioctl(fd_, VIDIOC_STREAMON, &type) < 0) return refused(describe_error(errno));
  streaming_ = true;
  return {};
}

int VideoDevice::take(VideoFrame& frame) noexcept {
  frame.buffer = {};
  frame.buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  frame.buffer.memory = V4L2_MEMORY_MMAP;
  if (system_.ioctl(fd_, VIDIOC_DQBUF, &frame.buffer) < 0) return errno;
  if (frame.buffer.index >= buffers_.size()) return EPROTO;
  const Buffer& buffer = buffers_[frame.buffer.index];
  frame.bytes = {static_cast<const std::byte*>(buffer.memory),
                 std::min<std::size_t>(frame.buffer.bytesused, buffer.bytes)};
  return 0;
}

}  // namespace bolo::v4l2_source
