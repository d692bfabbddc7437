// Recordings of ROS 2 (MCAP) as footage: Bolo's own with all that a capture holds, others with pictures and times.
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include <fmt/format.h>

#include "src/capture/contents.hpp"
#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "src/core/text.hpp"
#include "tools/convert/footage.hpp"
#include "tools/convert/mcap_reader.hpp"
#include "tools/convert/ros_messages.hpp"

namespace bolo::tools {
namespace {

constexpr std::size_t kMostFrames = std::size_t{1} << 24U;  // 23 hours at 200 Hz
// Least bytes of the file per message, however compressed: otherwise a few kilobytes could fill all memory.
constexpr std::uint64_t kLeastBytesOfAMessage = 2;

struct Still {
  mcap::Message message;
  std::uint64_t stamp_ns = 0;
  double t_s = 0.0;
  std::uint64_t id = 0;
  std::optional<capture::FrameTimes> times{};
};

struct Series {
  Geometry size;
  PixelType type = PixelType::kUint16;
  std::vector<Still> pictures;
};

// Results of one pass over the file.
struct Found {
  std::size_t most = kMostFrames;                                         // of pictures, frames and events together
  std::map<std::string, Series> images;                                   // by topic
  std::map<std::tuple<std::uint64_t, std::uint32_t>, ros::Frame> frames;  // by log time and sequence number
  std::vector<capture::Event> events;

  Status see(const mcap::Topic& topic, const mcap::Message& message, std::string_view data) {
    if (pictures_ + frames.size() + events.size() >= most) return bad_input("has more frames than its size can hold");
    if (topic.type == ros::kImage) return see_image(topic.name, message, data);
    if (topic.type == ros::kFrame) {
      ASSIGN_OR_RETURN(const auto frame, ros::read_frame(data));
      frames.emplace(std::tuple(message.log_ns, message.sequence), frame);
    } else if (topic.type == ros::kDiagnostics) {
      ASSIGN_OR_RETURN(auto event, ros::read_diagnostics(data));
      if (!event.kind.empty()) events.push_back(std::move(event));
    }
    return {};
  }

 private:
  std::size_t pictures_ = 0;

  Status see_image(const std::string& topic, const mcap::Message& message, std::string_view data) {
    ASSIGN_OR_RETURN(const auto image, at(topic, ros::read_image(data)));
    Series& series = images[topic];
    if (series.pictures.empty()) {
      series.size = image.size;
      series.type = image.type;
    }
    if (!(series.size == image.size) || series.type != image.type) {
      return bad_input(topic + ": its images are not all of one size and type");
    }
    ++pictures_;
    series.pictures.push_back({.message = message, .stamp_ns = image.stamp_ns});
    return {};
  }
};

std::string list_of(const std::map<std::string, Series>& images) {
  std::string text;
  for (const auto& [topic, series] : images) text += (text.empty() ? "" : ", ") + topic;
  return text;
}

Result<std::string> chosen_topic(const Found& found, const std::string& asked) {
  if (found.images.empty()) return bad_input("has no images (sensor_msgs/msg/Image, mono16, 16UC1 or 32FC1)");
  if (asked.empty() && found.images.size() == 1) return found.images.begin()->first;
  if (asked.empty()) return bad_input("has images on several topics; choose one by --topic: " + list_of(found.images));
  if (!found.images.contains(asked)) return bad_input("has no images on " + asked + "; on " + list_of(found.images));
  return asked;
}

// Times and numbers as Bolo wrote them; for files of other programs, from stamp and sequence number.
void number_pictures(const Found& found, Series& series) {
  bool counted = true;
  for (Still& picture : series.pictures) {
    const auto frame = found.frames.find({picture.message.log_ns, picture.message.sequence});
    const bool ours = frame != found.frames.end();
    picture.t_s = ours ? frame->second.t_s : static_cast<double>(picture.stamp_ns) / kNsPerSecond;
    if (ours && frame->second.utc_s > 0.0) picture.times = {frame->second.host_s, frame->second.utc_s};
    picture.id = ours ? frame->second.number : picture.message.sequence;
  }
  std::stable_sort(series.pictures.begin(), series.pictures.end(),
                   [](const Still& a, const Still& b) { return a.t_s < b.t_s; });
  for (std::size_t i = 1; i < series.pictures.size(); ++i) {
    counted = counted && series.pictures[i].id > series.pictures[i - 1].id;
  }
  if (counted) return;
  for (std::size_t i = 0; i < series.pictures.size(); ++i) series.pictures[i].id = i;
}

Status check_times(const Series& series) {
  for (std::size_t i = 0; i < series.pictures.size(); ++i) {
    const double t = series.pictures[i].t_s;
    const bool rises = i == 0 || t > series.pictures[i - 1].t_s;
    if (!std::isfinite(t) || !rises) return bad_input(fmt::format("image {} has no time of its own", i));
  }
  return {};
}

double usual_period(const Series& series, double otherwise) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < series.pictures.size(); ++i) {
    steps.push_back(series.pictures[i].t_s - series.pictures[i - 1].t_s);
  }
  return steps.empty() ? otherwise : quantile(steps, 0.5);
}

double number_in(const mcap::Texts& texts, const char* key, double otherwise) {
  const auto found = texts.find(key);
  return found == texts.end() ? otherwise : bolo::number_of(found->second).value_or(otherwise);
}

std::string text_in(const mcap::Texts& texts, const char* key) {
  const auto found = texts.find(key);
  return found == texts.end() ? std::string() : printable(found->second.substr(0, 1000));
}

class McapFootage final : public Footage {
 public:
  McapFootage(mcap::Reader reader, Found found, const std::string& topic, const StatedFormat& stated)
      : reader_(std::move(reader)), series_(std::move(found.images[topic])), events_(std::move(found.events)) {
    const auto [begin, end] = reader_.metadata().equal_range(mcap::kCapture);
    const auto own =
        std::find_if(begin, end, [&](const auto& entry) { return text_in(entry.second, "topic") == topic; });
    if (own != end) texts_ = own->second;
    info_.frames = series_.pictures.size();
    info_.has_times = std::ranges::all_of(series_.pictures, [](const Still& one) { return one.times.has_value(); });
    StreamFormat& format = info_.format;
    format.geometry = series_.size;
    format.type = series_.type;
    format.frame_period_s = number_in(texts_, "frame_period_s", usual_period(series_, 1.0 / stated.rate_hz));
    format.row_step = static_cast<int>(std::clamp(number_in(texts_, "row_step", 1.0), 1.0, 1024.0));
    format.scale = stated.scale.value_or(LinearScale{Unit::kCount, 1.0, 0.0});
    if (series_.type == PixelType::kFloat32) format.scale = {Unit::kKelvin, 1.0, 0.0};
    if (own != end) {
      const Unit unit = text_in(texts_, "unit") == "kelvin" ? Unit::kKelvin : Unit::kCount;
      format.scale = {unit, number_in(texts_, "scale", 1.0), number_in(texts_, "offset", 0.0)};
    }
    info_.camera_model = text_in(texts_, "camera_model");
    info_.camera_serial = text_in(texts_, "camera_serial");
  }

  Status read(std::size_t index, Frame& frame) override {
    const Still& picture = series_.pictures[index];
    ASSIGN_OR_RETURN(const auto data, reader_.data(picture.message));
    ASSIGN_OR_RETURN(const auto image, ros::read_image(data));
    if (!(image.size == series_.size) || image.type != series_.type) return bad_input("the file was changed meanwhile");
    frame.t_s = picture.t_s;
    frame.id = picture.id;
    frame.times.reset();
    if (info_.has_times) frame.times = picture.times;
    image.copy_to(frame.resize(series_.type, series_.size.pixels()));
    return {};
  }

  Result<Extras> extras() const override {
    Extras extras;
    extras.events = events_;
    for (const auto& [key, value] : texts_) {
      if (extras.attributes.size() == capture::kMostOtherAttributes) break;
      if (const std::string name = mcap::attribute_in(key, mcap::kText); !name.empty()) {
        extras.attributes.push_back({name, value.substr(0, std::min(value.find('\0'), capture::h5::kLongestString))});
      }
      const std::string name = mcap::attribute_in(key, mcap::kNumber);
      const bool is_text = texts_.contains(std::string(mcap::kText) + name);
      const auto number = bolo::number_of(value);
      if (!name.empty() && !is_text && number) extras.attributes.push_back({name, *number});
    }
    return extras;
  }

 private:
  mcap::Reader reader_;
  Series series_;
  std::vector<capture::Event> events_;
  mcap::Texts texts_;  // attributes of the capture behind the topic; empty: written by another program
};

}  // namespace

Result<std::unique_ptr<Footage>> open_mcap(const std::filesystem::path& file, const std::string& topic,
                                           const StatedFormat& stated) {
  ASSIGN_OR_RETURN(mcap::Reader reader, at(file.string(), mcap::Reader::open(file)));
  Found found;
  found.most = std::min<std::uint64_t>(kMostFrames, reader.size() / kLeastBytesOfAMessage);
  const auto see = [&](const mcap::Topic& on, const mcap::Message& message, std::string_view data) {
    return found.see(on, message, data);
  };
  RETURN_IF_ERROR(at(file.string(), reader.walk(see)));
  ASSIGN_OR_RETURN(const std::string chosen, at(file.string(), chosen_topic(found, topic)));
  Series& series = found.images[chosen];
  number_pictures(found, series);
  RETURN_IF_ERROR(at(file.string() + ": " + chosen, check_times(series)));
  auto footage = std::make_unique<McapFootage>(std::move(reader), std::move(found), chosen, stated);
  RETURN_IF_ERROR(at(file.string(), capture::check_format_values(footage->info().format)));
  return footage;
}

}  // namespace bolo::tools
