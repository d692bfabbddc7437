// The ROS 2 messages of a camera recording, in CDR (little-endian, as ROS writes it), and their definitions. Types:
// ros2/common_interfaces; CDR: OMG DDSI-RTPS 2.2, 10.
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
// Our own type, for data that an image cannot hold.
inline constexpr const char* kFrame = "bolo_msgs/msg/Frame";

// Definition in ros2msg of `type` (one of those above) and all types it uses. Thread: any.
std::string definition_of(std::string_view type);

struct Header {
  std::uint64_t stamp_ns = 0;  // below 2^31 s
  std::string frame_id;        // coordinate frame
};

struct Frame {
  std::uint64_t number = 0;  // the camera's counter
  double t_s = 0.0;          // the camera's clock
  double utc_s = 0.0;        // since 1970; 0: unknown
  double host_s = 0.0;       // CLOCK_MONOTONIC of the recording host; 0: unknown
};

// Encoding "mono16" or "32FC1", rows without padding. Thread: any.
std::string image(const Header& header, Geometry size, PixelType type, const void* plane);
// Uncalibrated: only the size. Thread: any.
std::string camera_info(const Header& header, Geometry size);
std::string frame(const Header& header, const Frame& frame);
// `camera`: subject of the event; `hardware`: its serial number. Thread: any.
std::string diagnostics(const Header& header, const std::string& camera, const std::string& hardware,
                        const capture::Event& event);

// An image in a message; valid as long as the message's bytes.
struct ImageView {
  std::uint64_t stamp_ns = 0;
  Geometry size;
  PixelType type = PixelType::kUint16;
  bool big_endian = false;
  std::size_t step = 0;    // between rows
  std::string_view bytes;  // of all rows

  // Copies the plane, row-major, in native byte order: plane_bytes(size, type) bytes.
  void copy_to(void* plane) const;
};

// Errors (kBadInput): the fault in the message. Thread: any.
Result<ImageView> read_image(std::string_view message);
Result<Frame> read_frame(std::string_view message);
// Inverse of diagnostics(); an empty kind: of another program.
Result<capture::Event> read_diagnostics(std::string_view message);

}  // namespace bolo::tools::ros
