#include "drivers/v4l2/video_port.hpp"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>

namespace bolo::v4l2 {
namespace {

constexpr std::string_view kDriver = "v4l2 loopback";
constexpr double kPeriodUnit = 1e6;  // timeperframe in microseconds

int request(int fd, unsigned long what, void* argument) {
  int result = 0;
  do {
    result = ioctl(fd, what, argument);
  } while (result < 0 && errno == EINTR);
  return result;
}

// "modprobe v4l2loopback video_nr=10 exclusive_caps=1", with the number from the path if it has one.
std::string advice(const std::string& path) {
  std::size_t digits = path.size();
  while (digits > 0 && std::isdigit(static_cast<unsigned char>(path[digits - 1])) != 0) --digits;
  const std::string number = digits < path.size() ? path.substr(digits) : "10";
  return "modprobe v4l2loopback video_nr=" + number + " exclusive_caps=1";
}

tl::unexpected<Error> wrong_device(const std::string& path, const std::string& what) {
  return bad_input(path + " is " + what + ", not v4l2loopback: " + advice(path));
}

}  // namespace

Status LoopbackPort::open(const VideoFormat& format) {
  close();
  fd_ = UniqueFd(::open(path_.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
  if (!fd_) {
    if (errno == ENOENT || errno == ENXIO || errno == ENODEV) {
      return bad_input(path_ + " is not there: " + advice(path_));
    }
    if (errno == EISDIR) return wrong_device(path_, "a folder");
    const std::string why = std::strerror(errno);
    const std::string fix = errno == EACCES ? "; the user must be in the group video" : "";
    return bad_input(path_ + ": cannot be opened: " + why + fix);
  }
  Status ready = check_driver();
  if (ready) ready = set_format(format);
  if (ready) ready = become_writer();
  if (!ready) close();
  return ready;
}

Status LoopbackPort::check_driver() const {
  struct stat there {};
  if (fstat(fd_.get(), &there) == 0 && !S_ISCHR(there.st_mode)) return wrong_device(path_, "no device");
  v4l2_capability has{};
  if (request(fd_.get(), VIDIOC_QUERYCAP, &has) < 0) return wrong_device(path_, "no video device");
  const auto* const driver = reinterpret_cast<const char*>(has.driver);
  const std::string name(driver, strnlen(driver, sizeof has.driver));
  if (name != kDriver) return wrong_device(path_, name);
  const std::uint32_t caps = (has.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? has.device_caps : has.capabilities;
  if ((caps & V4L2_CAP_VIDEO_OUTPUT) != 0) return {};
  return bad_input(path_ + " takes no frames: another program writes to it already; stop that, or use another device");
}

// The driver rounds sizeimage up to pages; each write has the size of one image.
Status LoopbackPort::set_format(const VideoFormat& format) const {
  v4l2_format wanted{};
  wanted.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  v4l2_pix_format& pix = wanted.fmt.pix;
  pix.width = static_cast<std::uint32_t>(format.geometry.width);
  pix.height = static_cast<std::uint32_t>(format.geometry.height);
  pix.pixelformat = static_cast<std::uint32_t>(format.pixels);
  pix.field = V4L2_FIELD_NONE;
  pix.bytesperline = static_cast<std::uint32_t>(line_bytes(format.pixels, format.geometry.width));
  pix.sizeimage = pix.bytesperline * pix.height;
  pix.colorspace = V4L2_COLORSPACE_SRGB;
  const v4l2_pix_format asked = pix;
  const std::string what =
      std::to_string(asked.width) + "x" + std::to_string(asked.height) + " " + std::string(name(format.pixels));
  if (request(fd_.get(), VIDIOC_S_FMT, &wanted) < 0) {
    const std::string fix = errno == EBUSY ? "; another program uses it: stop that, or use another device" : "";
    return bad_input(path_ + ": cannot be set to " + what + ": " + std::strerror(errno) + fix);
  }
  if (pix.width != asked.width || pix.height != asked.height || pix.pixelformat != asked.pixelformat ||
      pix.sizeimage < asked.sizeimage) {
    return bad_input(path_ + ": cannot be set to " + what +
                     "; another program holds it to another format: close its readers, or load the module again");
  }
  v4l2_streamparm rate{};  // informs readers; a refusal does no harm
  rate.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  rate.parm.output.timeperframe.numerator =
      static_cast<std::uint32_t>(std::lround(format.frame_period_s * kPeriodUnit));
  rate.parm.output.timeperframe.denominator = static_cast<std::uint32_t>(kPeriodUnit);
  request(fd_.get(), VIDIOC_S_PARM, &rate);
  return {};
}

// The driver releases its writer at close() only if it was streaming: otherwise the device would stay busy for ever,
// even for the next daemon. write() works the same either way.
Status LoopbackPort::become_writer() const {
  int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  if (request(fd_.get(), VIDIOC_STREAMON, &type) >= 0) return {};
  return bad_input(path_ + ": takes no stream: " + std::strerror(errno) + "; load the module again: " + advice(path_));
}

int LoopbackPort::write(std::span<const std::byte> image) noexcept {
  const ssize_t written = ::write(fd_.get(), image.data(), image.size());
  if (written < 0) return errno == EINTR ? EAGAIN : errno;
  return static_cast<std::size_t>(written) == image.size() ? 0 : EMSGSIZE;
}

}  // namespace bolo::v4l2
