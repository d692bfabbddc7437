// Captures as a recording of ROS 2 (MCAP), with the messages that a camera driver would publish.
#include <algorithm>
#include <charconv>
#include <ctime>
#include <set>
#include <utility>

#include "src/capture/contents.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "tools/convert/footage.hpp"
#include "tools/convert/mcap_reader.hpp"
#include "tools/convert/ros_messages.hpp"

namespace bolo::tools {
namespace {

const std::string* text_of(const std::vector<capture::Attribute>& attributes, const std::string& name) {
  for (const capture::Attribute& attribute : attributes) {
    if (attribute.name == name) return std::get_if<std::string>(&attribute.value);
  }
  return nullptr;
}

// Parses "2026-11-23T12:34:56.789Z". Nothing for another text, or a time that no stamp can have (clock never set).
std::optional<double> utc_s(const std::string& text) {
  std::tm date{};
  const char* rest = strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &date);
  if (rest == nullptr) return std::nullopt;
  double fraction = 0.0;
  if (*rest == '.') std::from_chars(rest, text.c_str() + text.size(), fraction);
  const double since_1970_s = static_cast<double>(timegm(&date)) + fraction;
  return since_1970_s > 0.0 && since_1970_s <= capture::kLastTime_s ? std::optional(since_1970_s) : std::nullopt;
}

mcap::Texts described(const std::string& topic, const capture::CaptureInfo& info, const Extras& extras) {
  const StreamFormat& format = info.format;
  mcap::Texts texts{{"topic", topic},
                    {"unit", format.scale.unit == Unit::kKelvin ? "kelvin" : "count"},
                    {"scale", shortest(format.scale.scale)},
                    {"offset", shortest(format.scale.offset)},
                    {"frame_period_s", shortest(format.frame_period_s)},
                    {"row_step", std::to_string(format.row_step)},
                    {"camera_model", info.camera_model},
                    {"camera_serial", info.camera_serial}};
  for (const capture::Attribute& attribute : extras.attributes) {
    const double* number = std::get_if<double>(&attribute.value);
    const std::string key(number != nullptr ? mcap::kNumber : mcap::kText);
    texts[key + attribute.name] = number != nullptr ? shortest(*number) : std::get<std::string>(attribute.value);
  }
  return texts;
}

class McapSink final : public FootageSink {
 public:
  static Result<std::unique_ptr<FootageSink>> open(const Target& target, const Footage& footage) {
    ASSIGN_OR_RETURN(auto writer, mcap::Writer::create(target.file, "bolo " BOLO_VERSION));
    std::unique_ptr<McapSink> sink(new McapSink(std::move(writer), target.name));
    RETURN_IF_ERROR(sink->begin(footage.parts()));
    return sink;
  }

  Status write(const Frame& frame) override {
    const Part& part = parts_[frame.part];
    place_clock(frame);
    if (Status good = write_events(frame.t_s); !good) return good;
    const std::uint64_t ns = stamp_ns(frame.t_s);
    const ros::Header header{ns, name_};
    const auto number = static_cast<std::uint32_t>(frame.id);
    Status good = writer_.write(part.channel, number, ns,
                                ros::image(header, part.format.geometry, part.format.type, frame.data()));
    if (!good || frame.t_s == last_t_s_) return good;  // raw and sharp plane of one frame
    last_t_s_ = frame.t_s;
    good = writer_.write(infos_, number, ns, ros::camera_info(header, part.format.geometry));
    return good ? writer_.write(frames_, number, ns, ros::frame(header, identity_of(frame))) : good;
  }

  Status finish() override {
    const Status good = write_events(std::numeric_limits<double>::infinity());
    return good ? writer_.finish() : good;
  }

  std::string meaning() const override {
    std::string topics;
    for (const Part& part : parts_) topics += (topics.empty() ? "" : ", ") + part.topic;
    return "topics " + topics +
           (begun_s_ || has_utc_ ? "" : "; stamps are the camera's clock: when it was recorded is not known");
  }

 private:
  struct Part {
    std::string topic;
    StreamFormat format;
    std::uint16_t channel = 0;
  };

  McapSink(mcap::Writer writer, std::string name) : writer_(std::move(writer)), name_(std::move(name)) {}

  Status begin(const std::vector<const Footage*>& footages) {
    std::set<std::string> topics;
    for (const Footage* footage : footages) {
      ASSIGN_OR_RETURN(const Extras extras, footage->extras());
      const bool sharp = text_of(extras.attributes, "solver") != nullptr;
      Part part{"/" + name_ + (sharp ? "/image_deblurred" : "/image_raw"), footage->info().format};
      if (!topics.insert(part.topic).second) {
        return bad_input("two captures would be " + part.topic + "; convert a raw and a sharp one, or each by itself");
      }
      if (const std::string* at = text_of(extras.attributes, "recorded_at"); at != nullptr && !begun_s_) {
        begun_s_ = utc_s(*at);
      }
      if (events_.empty()) events_ = extras.events;
      has_utc_ = has_utc_ || footage->info().has_times;
      serial_ = footage->info().camera_serial;
      RETURN_IF_ERROR(writer_.add_metadata(mcap::kCapture, described(part.topic, footage->info(), extras)));
      parts_.push_back(std::move(part));
    }
    return add_channels();
  }

  Status add_channels() {
    const auto add = [&](const std::string& topic, const char* type, std::uint16_t& channel) -> Status {
      ASSIGN_OR_RETURN(channel, writer_.add_channel(topic, type, ros::definition_of(type)));
      return {};
    };
    for (Part& part : parts_) RETURN_IF_ERROR(add(part.topic, ros::kImage, part.channel));
    RETURN_IF_ERROR(add("/" + name_ + "/camera_info", ros::kCameraInfo, infos_));
    RETURN_IF_ERROR(add("/" + name_ + "/frame", ros::kFrame, frames_));
    return events_.empty() ? Status{} : add("/diagnostics", ros::kDiagnostics, diagnostics_);
  }

  static ros::Frame identity_of(const Frame& frame) {
    ros::Frame identity{frame.id, frame.t_s};
    if (frame.times) identity.utc_s = frame.times->utc_s;
    if (frame.times) identity.host_s = frame.times->host_s;
    return identity;
  }

  // UTC if the frame has it; otherwise the time since the first frame, added to the start of the recording.
  void place_clock(const Frame& frame) {
    if (frame.times && frame.times->utc_s > 0.0) {
      base_ns_ = to_ns(frame.times->utc_s);
      base_t_s_ = frame.t_s;
    } else if (!base_ns_) {
      base_ns_ = begun_s_ ? to_ns(*begun_s_) : std::max(to_ns(frame.t_s), std::int64_t{0});
      base_t_s_ = frame.t_s;
    }
  }

  std::uint64_t stamp_ns(double t_s) const {
    const double latest_s = capture::kLastTime_s - static_cast<double>(*base_ns_) / kNsPerSecond;
    const std::int64_t ns = *base_ns_ + to_ns(std::clamp(t_s - base_t_s_, -capture::kLastTime_s, latest_s));
    return static_cast<std::uint64_t>(std::max(ns, std::int64_t{0}));
  }

  Status write_events(double until_s) {
    for (; next_event_ < events_.size() && events_[next_event_].t_s <= until_s; ++next_event_) {
      if (!base_ns_) continue;
      const capture::Event& event = events_[next_event_];
      const std::uint64_t ns = stamp_ns(event.t_s);
      RETURN_IF_ERROR(writer_.write(diagnostics_, static_cast<std::uint32_t>(next_event_), ns,
                                    ros::diagnostics({ns, name_}, name_, serial_, event)));
    }
    return {};
  }

  mcap::Writer writer_;
  std::string name_;
  std::string serial_;
  std::vector<Part> parts_;
  std::uint16_t infos_ = 0;
  std::uint16_t frames_ = 0;
  std::uint16_t diagnostics_ = 0;
  std::vector<capture::Event> events_;
  std::size_t next_event_ = 0;
  std::optional<double> begun_s_;  // UTC of the first frame
  bool has_utc_ = false;
  std::optional<std::int64_t> base_ns_;  // stamp at base_t_s_
  double base_t_s_ = 0.0;
  std::optional<double> last_t_s_;
};

}  // namespace

Result<std::unique_ptr<FootageSink>> open_mcap_sink(const Target& target, const Footage& footage) {
  return McapSink::open(target, footage);
}

}  // namespace bolo::tools
