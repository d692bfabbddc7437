// The messages of ROS 2 that a recording of a camera consists of, in CDR (little-endian, as ROS writes it), with their
// definitions. Types: ros2/common_interfaces; CDR: OMG DDSI-RTPS 2.2, 10.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "src/capture/capture.hpp"
#include "src/core/frame.hpp"

namespace bolo::tools::ros {

inline constexpr const char* kImage = "sensor_msgs/msg/Image";
inline constexpr const char* kCameraInfo = "sensor_msgs/msg/CameraInfo";
inline constexpr const char* kDiagnostics = "diagnostic_msgs/msg/DiagnosticArray";
// Ours: what an image has no place for.
inline constexpr const char* kFrame = "bolo_msgs/msg/Frame";

// ros2msg: with all types that it is made of. `type`: one of those above. Thread: any.
std::string definition_of(std::string_view type);

// std_msgs/msg/Header.
struct Header {
  std::uint64_t stamp_ns = 0;  // below 2^31 s
  std::string frame_id;        // the coordinate frame
};

struct Frame {
  std::uint64_t number = 0;  // the camera's counter
  double t_s = 0.0;          // the camera's clock
  double utc_s = 0.0;        // since 1970; 0: not known
  double host_s = 0.0;       // CLOCK_MONOTONIC of the host that recorded it; 0: not known
};

// Encoding "mono16" or "32FC1", rows without padding. Thread: any.
std::string image(const Header& header, Geometry size, PixelType type, const void* plane);
// Not calibrated: a size and nothing else. Thread: any.
std::string camera_info(const Header& header, Geometry size);
std::string frame(const Header& header, const Frame& frame);
// `camera`: what the event happened to; `hardware`: its serial number. Thread: any.
std::string diagnostics(const Header& header, const std::string& camera, const std::string& hardware,
                        const capture::Event& event);

// An image as it stands in a message; good as long as its bytes are.
struct ImageView {
  std::uint64_t stamp_ns = 0;
  Geometry size;
  PixelType type = PixelType::kUint16;
  bool big_endian = false;
  std::size_t step = 0;    // bytes from row to row
  std::string_view bytes;  // of all rows

  // The plane, row-major, in the machine's byte order: plane_bytes(size, type) bytes.
  void copy_to(void* plane) const;
};

// Errors (kBadInput): what is wrong in the message. Thread: any.
Result<ImageView> read_image(std::string_view message);
Result<Frame> read_frame(std::string_view message);
// As diagnostics() wrote it; an empty kind: another program's.
Result<capture::Event> read_diagnostics(std::string_view message);

}  // namespace bolo::tools::ros
