// Reads an image topic like a ROS 2 node, but with another vendor's DDS (Fast DDS) and types generated from the same
// IDL by its own generator: ros2_subscriber NAME PLANE SECONDS. Prints a line per message: stamp in ns, encoding,
// width, height, step, frame id, CRC-32 of the data; and a line "info ..." for each camera_info.
#include <zlib.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

#include "sensor_msgsPubSubTypes.h"

namespace fast = eprosima::fastdds::dds;
using sensor_msgs::msg::dds_::CameraInfo_;
using sensor_msgs::msg::dds_::CameraInfo_PubSubType;
using sensor_msgs::msg::dds_::Image_;
using sensor_msgs::msg::dds_::Image_PubSubType;

namespace {

long long ns_of(const builtin_interfaces::msg::dds_::Time_& stamp) {
  return stamp.sec() * 1'000'000'000LL + stamp.nanosec();
}

void print(Image_& image) {
  const auto crc = crc32(0, image.data().data(), static_cast<unsigned>(image.data().size()));
  std::printf("%lld %s %u %u %u %s %lu\n", ns_of(image.header().stamp()), image.encoding().c_str(), image.width(),
              image.height(), image.step(), image.header().frame_id().c_str(), crc);
}

void print(CameraInfo_& info) {
  std::printf("info %lld %u %u %s\n", ns_of(info.header().stamp()), info.width(), info.height(),
              info.header().frame_id().c_str());
}

template <typename T>
class Printer : public fast::DataReaderListener {
 public:
  void on_data_available(fast::DataReader* reader) override {
    T message;
    fast::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
      if (info.valid_data) print(message);
    }
    std::fflush(stdout);
  }
};

template <typename T, typename Support>
void subscribe(fast::DomainParticipant* node, const std::string& name, Printer<T>& printer) {
  fast::TypeSupport type(new Support());
  type.register_type(node);
  fast::Topic* topic = node->create_topic("rt/" + name, type.get_type_name(), fast::TOPIC_QOS_DEFAULT);
  fast::DataReaderQos qos = fast::DATAREADER_QOS_DEFAULT;
  qos.reliability().kind = fast::BEST_EFFORT_RELIABILITY_QOS;  // ROS 2's profile for sensor data
  qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 5;
  fast::Subscriber* subscriber = node->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
  if (topic == nullptr || subscriber->create_datareader(topic, qos, &printer) == nullptr) std::abort();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  fast::DomainParticipantQos qos = fast::PARTICIPANT_QOS_DEFAULT;
  qos.transport().listen_socket_buffer_size = 8U << 20U;  // recommended for large messages in ROS 2's DDS tuning guide
  const char* domain = std::getenv("ROS_DOMAIN_ID");
  auto* node = fast::DomainParticipantFactory::get_instance()->create_participant(
      domain != nullptr ? static_cast<std::uint32_t>(std::atoi(domain)) : 0U, qos);
  if (node == nullptr) return 1;
  Printer<Image_> images;
  Printer<CameraInfo_> infos;
  subscribe<Image_, Image_PubSubType>(node, std::string(argv[1]) + "/" + argv[2], images);
  subscribe<CameraInfo_, CameraInfo_PubSubType>(node, std::string(argv[1]) + "/camera_info", infos);
  std::this_thread::sleep_for(std::chrono::duration<double>(std::atof(argv[3])));
  std::_Exit(0);  // listener threads may be processing a message
}
