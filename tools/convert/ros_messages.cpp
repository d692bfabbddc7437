#include "tools/convert/ros_messages.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "src/capture/contents.hpp"
#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "tools/convert/mcap_reader.hpp"

namespace bolo::tools::ros {
namespace {

constexpr std::uint64_t kNsPerSecondWhole = 1'000'000'000;
constexpr int kMostSide = 1 << 15;
constexpr std::string_view kLittleEndian{"\0\1\0\0", 4};

// The definition of a type that another one uses.
std::string part(const char* type, const char* fields) {
  return std::string(80, '=') + "\nMSG: " + type + "\n" + fields;
}

// CDR: each number is aligned to its size, counted after the 4-byte header of the message.
class CdrWriter {
 public:
  CdrWriter() { fields_.raw(kLittleEndian); }
  template <typename T>
  CdrWriter& number(T value) {
    constexpr std::string_view kZeros("\0\0\0\0\0\0\0", sizeof(std::uint64_t) - 1);
    fields_.raw(kZeros.substr(0, (sizeof value - fields_.size() % sizeof value + kLittleEndian.size()) % sizeof value));
    fields_.number(value);
    return *this;
  }
  CdrWriter& text(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size() + 1));
    fields_.raw(text).raw(std::string_view("\0", 1));
    return *this;
  }
  CdrWriter& bytes(std::string_view bytes) {
    number(static_cast<std::uint32_t>(bytes.size()));
    fields_.raw(bytes);
    return *this;
  }
  CdrWriter& header(const Header& header) {
    number(static_cast<std::int32_t>(header.stamp_ns / kNsPerSecondWhole));
    number(static_cast<std::uint32_t>(header.stamp_ns % kNsPerSecondWhole));
    return text(header.frame_id);
  }
  const std::string& message() const { return fields_.bytes(); }

 private:
  mcap::Fields fields_;
};

class CdrReader {
 public:
  explicit CdrReader(std::string_view message)
      : size_(message.size()), fields_(message), little_(fields_.raw(4) == kLittleEndian) {}
  template <typename T>
  T number() {
    const std::size_t at = size_ - fields_.rest().size() - kLittleEndian.size();
    fields_.raw((sizeof(T) - at % sizeof(T)) % sizeof(T));
    return fields_.number<T>();
  }
  std::string_view text() {
    const std::string_view with_end = bytes();
    return with_end.substr(0, with_end.size() - (with_end.empty() ? 0 : 1));
  }
  std::string_view bytes() { return fields_.raw(number<std::uint32_t>()); }
  std::uint64_t header() {
    const auto seconds = number<std::int32_t>();
    const auto ns = number<std::uint32_t>();
    text();
    return static_cast<std::uint64_t>(std::max(seconds, 0)) * kNsPerSecondWhole + ns;
  }
  Status check(const char* type) const {
    if (!little_) return bad_input(std::string(type) + ": is not in little-endian CDR");
    return fields_.good() ? Status{} : bad_input(std::string(type) + ": is shorter than it says");
  }

 private:
  std::size_t size_;
  mcap::FieldReader fields_;
  bool little_;
};

}  // namespace

std::string definition_of(std::string_view type) {
  const std::string header = part("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n") +
                             part("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
  if (type == kImage) {
    return "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
           "uint8[] data\n" +
           header;
  }
  if (type == kCameraInfo) {
    return "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
           "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n" +
           header +
           part("sensor_msgs/RegionOfInterest",
                "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n");
  }
  if (type == kDiagnostics) {
    return "std_msgs/Header header\nDiagnosticStatus[] status\n" + header +
           part("diagnostic_msgs/DiagnosticStatus",
                "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\n"
                "string hardware_id\nKeyValue[] values\n") +
           part("diagnostic_msgs/KeyValue", "string key\nstring value\n");
  }
  return "# What Bolo knows of the image with the same header.\nstd_msgs/Header header\n"
         "uint64 frame_number  # the camera's counter; a jump is a lost frame\n"
         "float64 t             # s, the camera's clock\n"
         "float64 t_utc         # s since 1970; 0: not known\n"
         "float64 t_host        # s, CLOCK_MONOTONIC of the host that recorded it; 0: not known\n" +
         header;
}

std::string image(const Header& header, Geometry size, PixelType type, const void* plane) {
  CdrWriter cdr;
  cdr.header(header).number(static_cast<std::uint32_t>(size.height)).number(static_cast<std::uint32_t>(size.width));
  cdr.text(type == PixelType::kUint16 ? "mono16" : "32FC1").number(std::uint8_t{0});
  cdr.number(static_cast<std::uint32_t>(static_cast<std::size_t>(size.width) * bytes_of(type)));
  return cdr.bytes({static_cast<const char*>(plane), plane_bytes(size, type)}).message();
}

std::string camera_info(const Header& header, Geometry size) {
  constexpr std::size_t kMatrices = 9 + 9 + 12;
  CdrWriter cdr;
  cdr.header(header).number(static_cast<std::uint32_t>(size.height)).number(static_cast<std::uint32_t>(size.width));
  cdr.text("").number(std::uint32_t{0});  // no distortion
  for (std::size_t i = 0; i < kMatrices; ++i) cdr.number(0.0);
  for (std::size_t i = 0; i < 2 + 4; ++i) cdr.number(std::uint32_t{0});  // binning, region of interest
  return cdr.number(std::uint8_t{0}).message();
}

std::string frame(const Header& header, const Frame& frame) {
  return CdrWriter()
      .header(header)
      .number(frame.number)
      .number(frame.t_s)
      .number(frame.utc_s)
      .number(frame.host_s)
      .message();
}

std::string diagnostics(const Header& header, const std::string& camera, const std::string& hardware,
                        const capture::Event& event) {
  CdrWriter cdr;
  cdr.header(header).number(std::uint32_t{1});
  cdr.number(std::uint8_t{event.kind == "nuc" ? std::uint8_t{0} : std::uint8_t{1}});
  cdr.text(camera).text(event.kind).text(hardware).number(std::uint32_t{2});
  return cdr.text("t").text(shortest(event.t_s)).text("event").text(event.kind).message();
}

void ImageView::copy_to(void* plane) const {
  const std::size_t row_bytes = plane_bytes({size.width, 1}, type);
  auto* to = static_cast<char*>(plane);
  for (std::size_t row = 0; row < static_cast<std::size_t>(size.height); ++row) {
    std::memcpy(to + row * row_bytes, bytes.data() + row * step, row_bytes);
  }
  if (!big_endian) return;
  const std::size_t value = bytes_of(type);
  for (std::size_t i = 0; i < plane_bytes(size, type); i += value) std::reverse(to + i, to + i + value);
}

Result<ImageView> read_image(std::string_view message) {
  CdrReader cdr(message);
  ImageView image;
  image.stamp_ns = cdr.header();
  const auto height = cdr.number<std::uint32_t>();
  const auto width = cdr.number<std::uint32_t>();
  const std::string_view encoding = cdr.text();
  image.big_endian = cdr.number<std::uint8_t>() != 0;
  image.step = cdr.number<std::uint32_t>();
  image.bytes = cdr.bytes();
  RETURN_IF_ERROR(cdr.check("an image"));
  if (encoding == "32FC1") {
    image.type = PixelType::kFloat32;
  } else if (encoding != "mono16" && encoding != "16UC1") {
    return bad_input("an image is " + printable(encoding.substr(0, 40)) + "; expected mono16, 16UC1 or 32FC1");
  }
  const bool sized = width >= 1 && width <= kMostSide && height >= 1 && height <= kMostSide;
  const std::size_t row_bytes = std::size_t{width} * bytes_of(image.type);
  if (!sized || image.step < row_bytes || image.bytes.size() / height < image.step) {
    return bad_input("an image of " + std::to_string(width) + "x" + std::to_string(height) + " in " +
                     std::to_string(image.bytes.size()) + " bytes cannot be");
  }
  image.size = {static_cast<int>(width), static_cast<int>(height)};
  return image;
}

Result<Frame> read_frame(std::string_view message) {
  CdrReader cdr(message);
  cdr.header();
  Frame frame;
  frame.number = cdr.number<std::uint64_t>();
  frame.t_s = cdr.number<double>();
  frame.utc_s = cdr.number<double>();
  frame.host_s = cdr.number<double>();
  RETURN_IF_ERROR(cdr.check("a frame's number"));
  for (const double t_s : {frame.t_s, frame.utc_s, frame.host_s}) {
    if (!(std::abs(t_s) <= capture::kLastTime_s)) return bad_input("a frame has a time that no clock shows");
  }
  return frame;
}

Result<capture::Event> read_diagnostics(std::string_view message) {
  CdrReader cdr(message);
  capture::Event event;
  cdr.header();
  if (cdr.number<std::uint32_t>() != 1) return event;
  cdr.number<std::uint8_t>();
  for (int i = 0; i < 3; ++i) cdr.text();
  if (cdr.number<std::uint32_t>() != 2) return event;
  const std::string_view time_key = cdr.text();
  const auto time = number_of(cdr.text());
  const std::string_view kind_key = cdr.text();
  const std::string_view kind = cdr.text();
  RETURN_IF_ERROR(cdr.check("a diagnosis"));
  if (time_key != "t" || !time || std::abs(*time) > capture::kLastTime_s || kind_key != "event") return event;
  event.t_s = *time;
  event.kind = printable(kind.substr(0, capture::kLongestEventKind));
  return event;
}

}  // namespace bolo::tools::ros
