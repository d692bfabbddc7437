#include "drivers/v4l2/v4l2_section.hpp"

#include <array>
#include <utility>

namespace bolo::v4l2 {
namespace {

template <typename Enum, std::size_t N>
using Names = std::array<std::pair<std::string_view, Enum>, N>;

constexpr Names<Plane, 2> kPlanes{{{"raw", Plane::kRaw}, {"deblurred", Plane::kDeblurred}}};
constexpr Names<PixelFormat, 3> kFormats{
    {{"y16", PixelFormat::kY16}, {"grey", PixelFormat::kGrey}, {"yuyv", PixelFormat::kYuyv}}};
constexpr Names<Y16Unit, 2> kUnits{{{"10mk", Y16Unit::k10mK}, {"100mk", Y16Unit::k100mK}}};
constexpr Names<Gain, 2> kGains{{{"auto", Gain::kAuto}, {"fixed", Gain::kFixed}}};

constexpr double kHottestK = 65535.0;  // the largest count, too
constexpr std::string_view kKelvin = "K (counts when the source has no kelvin)";

void agc_keys(model::KeyTable& keys, AgcOptions& agc) {
  keys.choice<Gain>("gain", agc.gain, kGains,
                    "8 bits: auto follows the picture; fixed shows low_k black and high_k white.");
  keys.number("low_k", agc.low_k, {0.0, kHottestK, kKelvin}, "Fixed gain: black.");
  keys.number("high_k", agc.high_k, {0.0, kHottestK, kKelvin}, "Fixed gain: white.");
  keys.number("low_percent", agc.low_percent, {0.0, 100.0, "%"}, "Auto gain: pixels that are black.");
  keys.number("high_percent", agc.high_percent, {0.0, 100.0, "%"}, "Auto gain: pixels that are not white.");
  keys.number("smooth_s", agc.smooth_s, {0.0, 3600.0, "s"}, "Auto gain: time constant with which it follows.");
  keys.number("least_span_k", agc.least_span_k, {0.0, kHottestK, kKelvin},
              "Auto gain: white is at least this far above black, so that noise stays faint.");
}

Status check_agc(const AgcOptions& agc) {
  if (agc.gain == Gain::kFixed && agc.low_k >= agc.high_k) return bad_input("low_k must be below high_k");
  if (agc.low_percent >= agc.high_percent) return bad_input("low_percent must be below high_percent");
  return {};
}

}  // namespace

V4l2Section::V4l2Section(std::string name, std::string meaning, V4l2Options options)
    : name_(std::move(name)), meaning_(std::move(meaning)), options_(std::move(options)) {}

void V4l2Section::declare(model::KeyTable& keys) {
  keys.section(name_, meaning_);
  keys.boolean("enable", enabled_, "Show frames on it; `modprobe v4l2loopback video_nr=10 exclusive_caps=1` first.");
  keys.text("device", options_.device, "The device.");
  keys.choice<Plane>("plane", options_.plane, kPlanes, "Frames as they came, or sharp.");
  keys.choice<PixelFormat>("format", options_.format, kFormats,
                           "y16: temperatures in 16 bits. grey: 8 bits. yuyv: the same for programs that take "
                           "no grey, as browsers do.");
  keys.choice<Y16Unit>("y16_unit", options_.y16_unit, kUnits,
                       "y16: kelvin a count; counts of a source without kelvin stay as they are.");
  agc_keys(keys, options_.agc);
}

std::vector<std::string> V4l2Section::live_keys() const {
  std::vector<std::string> keys;
  model::KeyTable table;
  table.section(name_, "");
  AgcOptions agc;
  agc_keys(table, agc);
  for (const auto& [path, text] : table.texts()) keys.push_back(path);
  return keys;
}

Status V4l2Section::check(const model::KeyTable& keys, const pipeline::SinkContext& context,
                          std::span<const std::shared_ptr<SinkSection>> before) const {
  if (const Status agc = check_agc(options_.agc); !agc) {
    return at(keys.where(name_ + ".high_k").append(name_), agc.error());
  }
  if (!enabled_) return {};
  if (const Status fits = check_width(options_.format, context.frame.width); !fits) {
    return at(keys.where(name_ + ".format").append(name_), fits.error());
  }
  for (const auto& other : before) {
    const auto* video = dynamic_cast<const V4l2Section*>(other.get());
    if (video == nullptr || !video->enabled_ || video->options_.device != options_.device) continue;
    return bad_input(keys.where(name_ + ".device") + video->name_ + " and " + name_ + " have the same device " +
                     options_.device);
  }
  return {};
}

std::string V4l2Section::describe(const pipeline::SinkContext& /*context*/) const {
  if (!enabled_) return {};
  return options_.device + " (" + (options_.plane == Plane::kRaw ? "raw" : "deblurred") + ", " +
         std::string(v4l2::name(options_.format)) + ")";
}

std::unique_ptr<pipeline::FrameSink> V4l2Section::make(const pipeline::SinkContext& /*context*/) const {
  return enabled_ ? std::make_unique<V4l2Sink>(options_) : nullptr;
}

}  // namespace bolo::v4l2
