// `bolo-ros2`: the frames of a bolod as topics of ROS 2, by Cyclone DDS. bolod starts it if configured with [ros2]
// enable = true. A separate process, because DDS parses whatever the network sends.
//
// Topics NAME/image_raw, NAME/image_deblurred (sensor_msgs/Image) and NAME/camera_info (sensor_msgs/CameraInfo), best
// effort, keep last 5: ROS 2's sensor data profile. Names on DDS: ros2/design, "Topic and Service name mapping to DDS".
#include <dds/dds.h>
#include <dds/ddsrt/log.h>
#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <cxxopts.hpp>

#include "bolo/client.h"
#include "sensor_msgs.h"
#include "src/core/clock.hpp"
#include "src/core/result.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

constexpr int kOpenMs = 100;
constexpr int kWaitMs = 100;  // longest delay until a signal is noticed
constexpr int kDepth = 5;     // history of ROS 2's sensor data profile
constexpr std::int64_t kNsPerS = 1'000'000'000;

using Image = sensor_msgs_msg_dds__Image_;
using CameraInfo = sensor_msgs_msg_dds__CameraInfo_;

struct Request {
  std::string name;
  std::string frame_id;
  bool kelvin = false;
  int domain = 0;
};

struct ClientDeleter {
  void operator()(bolo_client* client) const { bolo_client_close(client); }
};
using Client = std::unique_ptr<bolo_client, ClientDeleter>;

tl::unexpected<Error> dds_failed(const std::string& what, dds_return_t code) {
  return failed(what + ": " + dds_strretcode(code));
}

// Logs only the first messages of DDS: it writes one for every foreign packet, and strangers may send any number.
void log_dds(void* /*unused*/, const dds_log_data_t* entry) {
  static std::atomic<int> lines{0};
  constexpr int kLines = 20;
  constexpr int kLetters = 200;
  const int line = lines.fetch_add(1, std::memory_order_relaxed);
  if (line > kLines) return;
  const std::string_view text(entry->message, std::min<std::size_t>(entry->size, kLetters));
  const std::string shown = line < kLines ? printable(text.substr(0, text.find('\n'))) : "more is not shown";
  std::fprintf(stderr, "bolo-ros2: DDS: %s\n", shown.c_str());
}

// A topic and its writer, which are deleted with the participant.
class Topic {
 public:
  Status open(dds_entity_t participant, const dds_topic_descriptor_t& type, const std::string& name) {
    dds_qos_t* qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, kDepth);
    const std::string on_dds = "rt/" + name;
    const dds_entity_t topic = dds_create_topic(participant, &type, on_dds.c_str(), qos, nullptr);
    writer_ = topic < 0 ? topic : dds_create_writer(participant, topic, qos, nullptr);
    dds_delete_qos(qos);
    return writer_ < 0 ? dds_failed("topic /" + name, writer_) : Status{};
  }

  bool read_by_any() const {
    dds_publication_matched_status_t matched{};
    return dds_get_publication_matched_status(writer_, &matched) == DDS_RETCODE_OK && matched.current_count > 0;
  }

  Status write(const void* message) const {
    const dds_return_t code = dds_write(writer_, message);
    return code < 0 ? dds_failed("a message was not sent", code) : Status{};
  }

 private:
  dds_entity_t writer_ = 0;
};

// ROS 2 names consist of letters, digits and '_', and do not begin with a digit.
std::string topic_name(std::string name) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  for (char& c : name) c = letter(c) || digit(c) ? c : '_';
  return digit(name.empty() ? '0' : name.front()) ? "camera_" + name : name;
}

struct Planes {
  std::vector<std::uint16_t> raw;
  std::vector<std::uint16_t> deblurred;
  std::vector<float> kelvin;
};

class Bridge {
 public:
  explicit Bridge(Request request) : request_(std::move(request)) {}
  Bridge(const Bridge&) = delete;
  Bridge& operator=(const Bridge&) = delete;
  ~Bridge() {
    if (participant_ > 0) dds_delete(participant_);
    dds_set_log_sink(nullptr, nullptr);
  }

  Status open() {
    dds_set_log_sink(log_dds, nullptr);
    participant_ = dds_create_participant(static_cast<dds_domainid_t>(request_.domain), nullptr, nullptr);
    if (participant_ < 0) return dds_failed("DDS does not start", participant_);
    const std::string name = topic_name(request_.name);
    Status opened = raw_.open(participant_, sensor_msgs_msg_dds__Image__desc, name + "/image_raw");
    if (opened) opened = sharp_.open(participant_, sensor_msgs_msg_dds__Image__desc, name + "/image_deblurred");
    if (opened) opened = info_.open(participant_, sensor_msgs_msg_dds__CameraInfo__desc, name + "/camera_info");
    return opened;
  }

  // Runs until a signal arrives.
  Status run() {
    while (!interrupted()) {
      if (Status found = find_stream(); !found) return found;
      if (client_ == nullptr) continue;
      bolo_client_frame frame{};
      const int result = bolo_client_next(client_.get(), kWaitMs, &frame);
      if (result < 0) return failed(bolo_client_error(client_.get()));
      if (result != BOLO_CLIENT_OK) continue;
      if (Status sent = publish(frame); !sent) return sent;
    }
    return {};
  }

 private:
  // A missing stream is no error: the daemon may start later.
  Status find_stream() {
    if (client_ != nullptr) return {};
    bolo_client* opened = nullptr;
    const int result = bolo_client_open(request_.name.c_str(), kOpenMs, &opened);
    client_.reset(opened);
    if (result == BOLO_CLIENT_OK || result == BOLO_CLIENT_ABSENT) return {};
    if (result == BOLO_CLIENT_BAD_ARGUMENT) return bad_input(bolo_client_error(nullptr));
    return failed(bolo_client_error(nullptr));
  }

  Status publish(const bolo_client_frame& frame) {
    const bool raw = raw_.read_by_any();
    const bool sharp = sharp_.read_by_any();
    const bool info = info_.read_by_any();
    const std::size_t pixels = std::size_t{frame.width} * frame.height;
    if (raw) planes_.raw.resize(pixels);
    if (sharp) planes_.deblurred.resize(pixels);
    if ((raw || sharp) && bolo_client_copy(&frame, raw ? planes_.raw.data() : nullptr,
                                           sharp ? planes_.deblurred.data() : nullptr) != BOLO_CLIENT_OK) {
      return {};  // overwritten: skipped
    }
    Status sent;
    if (raw) sent = write_image(raw_, frame, planes_.raw);
    if (sent && sharp) sent = write_image(sharp_, frame, planes_.deblurred);
    if (sent && info) sent = write_info(frame);
    return sent;
  }

  // A stamp has 31 bits of seconds since 1970; times outside are clamped.
  std::int64_t stamped(std::int64_t utc_ns) {
    constexpr std::int64_t kLastNs = (std::int64_t{1} << 31) * kNsPerS - 1;
    const std::int64_t ns = std::clamp(utc_ns, std::int64_t{0}, kLastNs);
    if (ns != utc_ns && !std::exchange(told_no_stamp_, true)) {
      std::fputs(
          "bolo-ros2: frames before 1970 or after January 2038 have the first or last stamp of ROS 2: is this "
          "computer's clock right?\n",
          stderr);
    }
    return ns;
  }

  // UTC at which the camera took the frame; nodes of ROS 2 count in UTC.
  std_msgs_msg_dds__Header_ header(const bolo_client_frame& frame) {
    const std::int64_t taken_ns = frame.host_ns != 0 ? frame.host_ns : frame.receive_ns;
    const std::int64_t ns = stamped(frame.utc_ns != 0 ? frame.utc_ns : dds_time() - monotonic_ns() + taken_ns);
    std_msgs_msg_dds__Header_ made{};
    made.stamp = {static_cast<std::int32_t>(ns / kNsPerS), static_cast<std::uint32_t>(ns % kNsPerS)};
    made.frame_id = request_.frame_id.data();
    return made;
  }

  Status write_image(const Topic& topic, const bolo_client_frame& frame, std::vector<std::uint16_t>& plane) {
    void* values = plane.data();
    std::size_t bytes_per_value = sizeof(std::uint16_t);
    std::string encoding = "mono16";
    if (request_.kelvin) {
      planes_.kelvin.resize(plane.size());
      if (bolo_client_kelvin(client_.get(), plane.data(), plane.size(), planes_.kelvin.data()) != BOLO_CLIENT_OK) {
        return bad_input(std::string("--kelvin (ros2.kelvin): ") + bolo_client_error(client_.get()));
      }
      values = planes_.kelvin.data();
      bytes_per_value = sizeof(float);
      encoding = "32FC1";
    }
    Image image{};
    image.header = header(frame);
    image.height = frame.height;
    image.width = frame.width;
    image.encoding = encoding.data();
    image.step = static_cast<std::uint32_t>(frame.width * bytes_per_value);
    const auto bytes = static_cast<std::uint32_t>(plane.size() * bytes_per_value);
    image.data = {bytes, bytes, static_cast<std::uint8_t*>(values), false};
    return topic.write(&image);
  }

  // Uncalibrated: only the size, as ROS 2 defines it.
  Status write_info(const bolo_client_frame& frame) {
    std::array<char, 1> no_model{};
    CameraInfo info{};
    info.header = header(frame);
    info.height = frame.height;
    info.width = frame.width;
    info.distortion_model = no_model.data();
    return info_.write(&info);
  }

  Request request_;
  dds_entity_t participant_ = 0;
  Topic raw_;
  Topic sharp_;
  Topic info_;
  Client client_;
  Planes planes_;
  bool told_no_stamp_ = false;
};

// Makes this process end when its parent does, however that ends.
bool end_with_parent() {
  const pid_t parent = getppid();
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  return getppid() == parent && parent != 1;
}

Result<int> run(int argc, char** argv) {
  set_program_name("bolo-ros2");
  cxxopts::Options options("bolo-ros2", "The frames of a running bolod as topics of ROS 2.");
  options.add_options()("name", "The daemon's name: /bolo.NAME", cxxopts::value<std::string>(), "NAME")  //
      ("frame-id", "Coordinate frame that the messages name; the daemon's name, else",
       cxxopts::value<std::string>()->default_value(""), "ID")                                       //
      ("kelvin", "Images in kelvin (32FC1), not as the ring has them (mono16)")                      //
      ("domain", "ROS_DOMAIN_ID of its nodes", cxxopts::value<int>()->default_value("0"), "0..232")  //
      ("with-parent", "End with the process that started it");
  options.parse_positional({"name"});
  options.positional_help("NAME");
  cxxopts::ParseResult parsed;
  if (const auto code = parse(options, argc, argv, parsed)) return *code;
  constexpr int kMostDomain = 232;
  Request request;
  if (parsed.count("name") == 0) return bad_input("NAME is missing: which daemon's frames?");
  request.name = parsed["name"].as<std::string>();
  request.domain = parsed["domain"].as<int>();
  if (request.domain < 0 || request.domain > kMostDomain) return bad_input("--domain: expected 0 to 232");
  request.frame_id = parsed["frame-id"].as<std::string>();
  if (request.frame_id.empty()) request.frame_id = request.name;
  request.kelvin = parsed.count("kelvin") != 0;
  if (parsed.count("with-parent") != 0 && !end_with_parent()) return kExitDone;
  catch_interrupts();
  Bridge bridge(std::move(request));
  RETURN_IF_ERROR(bridge.open());
  RETURN_IF_ERROR(bridge.run());
  return kExitDone;
}

}  // namespace
}  // namespace bolo::tools

int main(int argc, char** argv) {
  const bolo::Result<int> done = bolo::tried([&] { return bolo::tools::run(argc, argv); });
  if (done) return *done;
  std::fprintf(stderr, "bolo-ros2: %s\n", bolo::message_line(done.error().message).c_str());
  return done.error().exit_code();
}
