// bolo info: contents and irregularities of a capture or a still.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "src/capture/capture.hpp"
#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using capture::CaptureReader;
using nlohmann::json;

constexpr std::size_t kPlacesShown = 5;
constexpr double kLastUtc_s = 4e9;  // the year 2096: later ones are invalid
constexpr double kIrregular = 0.2;  // fraction of a period off the frame grid

// Frame intervals divided by the step of the frame number.
std::vector<double> steps_s(const CaptureReader& reader) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < reader.t().size(); ++i) {
    const auto jump = static_cast<double>(reader.frame_id()[i] - reader.frame_id()[i - 1]);
    steps.push_back((reader.t()[i] - reader.t()[i - 1]) / jump);
  }
  return steps;
}

json rate_of(const CaptureReader& reader) {
  const double stated_s = reader.info().format.frame_period_s;
  const double measured_s = median(steps_s(reader));
  json rate{{"stated_hz", 1.0 / stated_s}, {"measured_hz", nullptr}};
  if (measured_s > 0.0) rate["measured_hz"] = 1.0 / measured_s;
  return rate;
}

json lost_frames(const CaptureReader& reader) {
  json first = json::array();
  std::uint64_t lost = 0;
  std::size_t places = 0;
  const auto& id = reader.frame_id();
  for (std::size_t i = 1; i < id.size(); ++i) {
    const std::uint64_t here = id[i] - id[i - 1] - 1;
    if (here == 0) continue;
    lost += here;
    if (++places <= kPlacesShown) {
      first.push_back({{"before_frame", i}, {"lost", here}, {"t_s", reader.t()[i] - reader.t()[0]}});
    }
  }
  return {{"count", lost}, {"places", places}, {"first", first}};
}

json irregular_times(const CaptureReader& reader) {
  json first = json::array();
  std::size_t count = 0;
  const std::vector<double> steps = steps_s(reader);
  const double period_s = median(steps);
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const auto jump = static_cast<double>(reader.frame_id()[i + 1] - reader.frame_id()[i]);
    if (std::abs(steps[i] - period_s) * jump <= kIrregular * period_s) continue;
    if (++count <= kPlacesShown) first.push_back({{"frame", i + 1}, {"interval_s", steps[i] * jump}});
  }
  return {{"count", count}, {"tolerance_of_period", kIrregular}, {"first", first}};
}

json range_of(std::vector<double> values) {
  const std::size_t before = values.size();
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  json range{{"non_finite", before - values.size()}, {"min", nullptr}, {"median", nullptr}, {"max", nullptr}};
  if (values.empty()) return range;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  range["min"] = *low;
  range["max"] = *high;
  range["median"] = median(values);
  return range;
}

Result<json> range_of_frame(const CaptureReader& reader, std::size_t index) {
  const StreamFormat& format = reader.info().format;
  std::vector<std::uint16_t> counts(format.geometry.pixels());
  std::vector<float> floats(format.geometry.pixels());
  const bool is_uint16 = format.type == PixelType::kUint16;
  void* plane = is_uint16 ? static_cast<void*>(counts.data()) : static_cast<void*>(floats.data());
  RETURN_IF_ERROR(reader.read_frame(index, plane));
  std::vector<double> values(format.geometry.pixels());
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = format.scale.to_physical(is_uint16 ? counts[i] : static_cast<double>(floats[i]));
  }
  json range = range_of(std::move(values));
  range["frame"] = index;
  return range;
}

Result<json> values_of(const CaptureReader& reader) {
  json values{{"unit", reader.info().format.scale.unit == Unit::kKelvin ? "kelvin" : "count"}};
  const std::size_t last = reader.info().frames - 1;
  for (const auto& [name, index] : {std::pair{"first", std::size_t{0}}, {"middle", last / 2}, {"last", last}}) {
    ASSIGN_OR_RETURN(json range, range_of_frame(reader, index));
    values[name] = std::move(range);
  }
  return values;
}

json fields(const capture::NoStimulus&) { return {{"kind", "none"}}; }
json fields(const capture::Uniform& u) { return {{"kind", "uniform"}, {"temperature_k", u.temperature_k}}; }
json fields(const capture::Chopper& c) {
  return {{"kind", "chopper"}, {"cold_k", c.cold_k}, {"on_s", c.on_s}, {"off_s", c.off_s}, {"level_k", c.level_k}};
}
json fields(const capture::BarTarget& b) {
  return {{"kind", "bar_target"},
          {"cold_k", b.cold_k},
          {"hot_k", b.hot_k},
          {"period_px", b.period_px},
          {"bar_width_px", b.bar_width_px},
          {"slant_px_per_row", b.slant_px_per_row},
          {"velocity_px_s", b.velocity_px_s}};
}
json fields(const capture::SceneStimulus& s) {
  const auto [left, right] = std::minmax_element(s.x_px.begin(), s.x_px.end());
  const auto [top, bottom] = std::minmax_element(s.y_px.begin(), s.y_px.end());
  return {{"kind", "scene"},
          {"image_width", s.image_width},
          {"image_height", s.image_height},
          {"trajectory_points", s.t_s.size()},
          {"trajectory_t_s", {s.t_s.front(), s.t_s.back()}},
          {"trajectory_x_px", {*left, *right}},
          {"trajectory_y_px", {*top, *bottom}}};
}

// UTC at a time of /t: that of the first frame at or after it.
json utc_at(const CaptureReader& reader, double t_s) {
  const auto frame = std::lower_bound(reader.t().begin(), reader.t().end(), t_s);
  if (!reader.info().has_times || frame == reader.t().end()) return nullptr;
  const double utc_s = reader.t_utc()[static_cast<std::size_t>(frame - reader.t().begin())];
  const bool known = utc_s > 0.0 && utc_s < kLastUtc_s;
  return known ? json(utc_text(to_ns(utc_s))) : json(nullptr);
}

json events_of(const CaptureReader& reader) {
  json events = json::array();
  for (const auto& event : reader.events()) {
    events.push_back({{"t_s", event.t_s}, {"kind", event.kind}});
    if (json utc = utc_at(reader, event.t_s); !utc.is_null()) events.back()["utc"] = std::move(utc);
  }
  return events;
}

Result<json> attributes_of(const CaptureReader& reader) {
  ASSIGN_OR_RETURN(const std::vector<capture::Attribute> attributes, reader.attributes());
  json out = json::object();
  for (const auto& attribute : attributes) {
    std::visit([&](const auto& value) { out[attribute.name] = value; }, attribute.value);
  }
  return out;
}

Result<json> describe(const CaptureReader& reader) {
  const capture::CaptureInfo& info = reader.info();
  const StreamFormat& format = info.format;
  ASSIGN_OR_RETURN(json values, values_of(reader));
  ASSIGN_OR_RETURN(json attributes, attributes_of(reader));
  const capture::Stimulus stimulus = reader.stimulus().value_or(capture::NoStimulus{});  // warnings() reports the error
  ASSIGN_OR_RETURN(const std::vector<capture::Point> points, reader.points());
  return json{{"kind", "capture"},
              {"format", reader.file_format() == capture::FileFormat::kMatlab ? "matlab-v7.3" : "bolo-capture"},
              {"width", format.geometry.width},
              {"height", format.geometry.height},
              {"row_step", format.row_step},
              {"type", format.type == PixelType::kUint16 ? "uint16" : "float32"},
              {"unit", format.scale.unit == Unit::kKelvin ? "kelvin" : "count"},
              {"scale", format.scale.scale},
              {"offset", format.scale.offset},
              {"frames", info.frames},
              {"frame_period_s", format.frame_period_s},
              {"duration_s", reader.t().back() - reader.t().front()},
              {"utc", {{"first", utc_at(reader, reader.t().front())}, {"last", utc_at(reader, reader.t().back())}}},
              {"rate", rate_of(reader)},
              {"lost_frames", lost_frames(reader)},
              {"irregular_times", irregular_times(reader)},
              {"values", std::move(values)},
              {"stimulus", std::visit([](const auto& kind) { return fields(kind); }, stimulus)},
              {"truth", info.has_truth},
              {"motion", info.has_motion},
              {"points", points.size()},
              {"events", events_of(reader)},
              {"camera_model", info.camera_model},
              {"camera_serial", info.camera_serial},
              {"attributes", std::move(attributes)},
              {"warnings", reader.warnings()}};
}

json describe(const capture::StillImage& still) {
  json values = range_of({still.kelvin.begin(), still.kelvin.end()});
  values["unit"] = "kelvin";
  return {{"kind", "still"}, {"width", still.width}, {"height", still.height}, {"values", std::move(values)}};
}

Result<json> describe_file(const std::string& file) {
  const Result<CaptureReader> reader = CaptureReader::open(file);
  if (reader) return describe(*reader);
  if (const Result<capture::StillImage> still = capture::read_still(file)) return describe(*still);
  return tl::unexpected<Error>(reader.error());
}

void item(const char* name, const std::string& text) { std::printf("  %-10s %s\n", name, printable(text).c_str()); }

std::string number(const json& value, int digits = 6) {
  if (!value.is_number()) return "none";
  return fmt::format("{:.{}g}", value.get<double>(), digits);
}

std::string range_text(const json& range) {
  return fmt::format("{} .. {} .. {}{}", number(range["min"]), number(range["median"]), number(range["max"]),
                     range["non_finite"] != 0 ? fmt::format(", {} not finite", range["non_finite"].dump()) : "");
}

std::string lost_text(const json& lost) {
  if (lost["count"] == 0) return "none";
  std::string text =
      lost["count"].dump() + " in " + lost["places"].dump() + (lost["places"] == 1 ? " place" : " places");
  const char* between = ": ";
  for (const json& gap : lost["first"]) {
    text += fmt::format("{}{} before frame {} ({} s)", std::exchange(between, ", "), gap["lost"].dump(),
                        gap["before_frame"].dump(), number(gap["t_s"]));
  }
  return text;
}

std::string irregular_text(const json& irregular) {
  if (irregular["count"] == 0) return "none";
  std::string text = irregular["count"].dump() + " off the frame grid by more than a fifth of a period";
  const char* between = ": ";
  for (const json& step : irregular["first"]) {
    text += fmt::format("{}frame {} (after {} s)", std::exchange(between, ", "), step["frame"].dump(),
                        number(step["interval_s"]));
  }
  return text;
}

// One line of "name value" pairs; long lists are only counted.
std::string pairs_text(const json& object) {
  std::string text;
  for (const auto& [name, value] : object.items()) {
    if (!text.empty()) text += ", ";
    const bool is_long = value.is_array() && value.size() > kPlacesShown;
    text += name + " " + (is_long ? "of " + std::to_string(value.size()) + " values" : json_text(value, -1, false));
  }
  return text.empty() ? "none" : text;
}

std::string events_text(const json& events) {
  std::string text = std::to_string(events.size());
  for (std::size_t i = 0; i < std::min(events.size(), kPlacesShown); ++i) {
    text += (i == 0 ? ": " : ", ") + events[i]["kind"].get<std::string>() + " at " + number(events[i]["t_s"], 9) + " s";
  }
  return text;
}

std::string uncertainty_text(const json& attributes) {
  const json uncertainty_s = attributes.value("utc_uncertainty_s", json(nullptr));
  if (!uncertainty_s.is_number()) return "";
  if (uncertainty_s.get<double>() * kNsPerSecond >= static_cast<double>(kUnboundedClockErrorNs)) {
    return "; nothing kept that host's clock: its error is not known";
  }
  return fmt::format(", within {} s", number(uncertainty_s, 3));
}

void print_capture(const json& info) {
  const std::string unit = info["values"]["unit"];
  item("format", info["format"]);
  item("frames", info["frames"].dump() + " of " + info["width"].dump() + "x" + info["height"].dump() + " " +
                     info["type"].get<std::string>() + ", " + number(info["duration_s"]) + " s, row step " +
                     info["row_step"].dump());
  const json& attributes = info["attributes"];
  if (attributes.contains("recorded_at")) {
    const auto word = [&attributes](const char* name) {
      const json value = attributes.value(name, json("unknown"));
      return value.is_string() ? value.get<std::string>() : value.dump();
    };
    item("recorded", word("recorded_at") + " on " + word("host_name") + " by bolo " + word("bolo_version"));
  }
  if (const json& utc = info["utc"]; utc["first"].is_string() && utc["last"].is_string()) {
    item("utc",
         utc["first"].get<std::string>() + " to " + utc["last"].get<std::string>() + uncertainty_text(attributes));
  }
  item("unit", unit == "kelvin" ? "kelvin = " + number(info["scale"]) + " * value + " + number(info["offset"]) : unit);
  item("rate",
       number(info["rate"]["measured_hz"]) + " Hz measured, " + number(info["rate"]["stated_hz"]) + " Hz stated");
  item("lost", lost_text(info["lost_frames"]));
  item("irregular", irregular_text(info["irregular_times"]));
  for (const char* name : {"first", "middle", "last"}) {
    const json& range = info["values"][name];
    item(name, range_text(range) + " " + unit + " (min .. median .. max of frame " + range["frame"].dump() + ")");
  }
  item("stimulus", pairs_text(info["stimulus"]));
  if (info["points"] != 0) item("points", info["points"].dump() + " single pixels, their places in /points");
  item("truth", info["truth"].get<bool>() ? "yes" : "no");
  if (info["motion"].get<bool>()) item("motion", "velocity and confidence of each block of 8x8 pixels");
  item("events", events_text(info["events"]));
  item("camera", info["camera_model"].get<std::string>() + " " + info["camera_serial"].get<std::string>());
  item("attributes", pairs_text(info["attributes"]));
  for (const json& warning : info["warnings"]) item("warning", warning);
}

void print_still(const json& info) {
  item("format", "a still image, not a capture");
  item("size", info["width"].dump() + "x" + info["height"].dump());
  item("values", range_text(info["values"]) + " kelvin (min .. median .. max)");
}

Status run_info(const cxxopts::ParseResult& given) {
  if (given.count("file") != 1) return bad_input("which file? usage: bolo info FILE [--json]");
  const std::string file = given["file"].as<std::string>();
  ASSIGN_OR_RETURN(json info, describe_file(file));
  info["file"] = file;
  if (given.count("json") != 0) {
    std::cout << json_text(info, 2) << '\n';
    return {};
  }
  std::printf("%s\n", printable(file).c_str());
  info["kind"] == "still" ? print_still(info) : print_capture(info);
  return {};
}

}  // namespace

int info_main(int argc, char** argv) {
  cxxopts::Options options("bolo info",
                           "Describe a capture (.h5, the authors' .mat) or a still, and any irregularities.");
  add_option<bool>(options, "json", "Print one JSON object");
  add_option<std::string>(options, "file", "");
  options.parse_positional({"file"});
  options.positional_help("FILE");
  return run_verb("info", std::move(options), argc, argv, run_info, false);
}

}  // namespace bolo::tools
