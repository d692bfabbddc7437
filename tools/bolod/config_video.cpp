#include "tools/bolod/config_video.hpp"

#include <string>
#include <utility>

namespace bolo::daemon {
namespace {

template <typename Enum, std::size_t N>
using Names = std::array<std::pair<std::string_view, Enum>, N>;

constexpr Names<v4l2::Plane, 2> kPlanes{{{"raw", v4l2::Plane::kRaw}, {"deblurred", v4l2::Plane::kDeblurred}}};
constexpr Names<v4l2::PixelFormat, 3> kFormats{
    {{"y16", v4l2::PixelFormat::kY16}, {"grey", v4l2::PixelFormat::kGrey}, {"yuyv", v4l2::PixelFormat::kYuyv}}};
constexpr Names<v4l2::Y16Unit, 2> kUnits{{{"10mk", v4l2::Y16Unit::k10mK}, {"100mk", v4l2::Y16Unit::k100mK}}};
constexpr Names<v4l2::Gain, 2> kGains{{{"auto", v4l2::Gain::kAuto}, {"fixed", v4l2::Gain::kFixed}}};

constexpr double kHottestK = 65535.0;  // the largest count, too
constexpr std::string_view kKelvin = "K (counts when the source has no kelvin)";

void agc_keys(model::KeyTable& keys, v4l2::AgcOptions& agc) {
  keys.choice<v4l2::Gain>("gain", agc.gain, kGains,
                          "8 bits: auto follows the picture; fixed shows low_k black and high_k white.");
  keys.number("low_k", agc.low_k, {0.0, kHottestK, kKelvin}, "Fixed gain: black.");
  keys.number("high_k", agc.high_k, {0.0, kHottestK, kKelvin}, "Fixed gain: white.");
  keys.number("low_percent", agc.low_percent, {0.0, 100.0, "%"}, "Auto gain: pixels that are black.");
  keys.number("high_percent", agc.high_percent, {0.0, 100.0, "%"}, "Auto gain: pixels that are not white.");
  keys.number("smooth_s", agc.smooth_s, {0.0, 3600.0, "s"}, "Auto gain: time constant with which it follows.");
  keys.number("least_span_k", agc.least_span_k, {0.0, kHottestK, kKelvin},
              "Auto gain: white is at least this far above black, so that noise stays faint.");
}

void device_keys(model::KeyTable& keys, VideoOptions& video) {
  keys.boolean("enable", video.enabled,
               "Show frames on it; `modprobe v4l2loopback video_nr=10 exclusive_caps=1` first.");
  keys.text("device", video.sink.device, "The device.");
  keys.choice<v4l2::Plane>("plane", video.sink.plane, kPlanes, "Frames as they came, or sharp.");
  keys.choice<v4l2::PixelFormat>("format", video.sink.format, kFormats,
                                 "y16: temperatures in 16 bits. grey: 8 bits. yuyv: the same for programs that take "
                                 "no grey, as browsers do.");
  keys.choice<v4l2::Y16Unit>("y16_unit", video.sink.y16_unit, kUnits,
                             "y16: kelvin a count; counts of a source without kelvin stay as they are.");
  agc_keys(keys, video.sink.agc);
}

Status check_agc(const v4l2::AgcOptions& agc) {
  if (agc.gain == v4l2::Gain::kFixed && agc.low_k >= agc.high_k) return bad_input("low_k must be below high_k");
  if (agc.low_percent >= agc.high_percent) return bad_input("low_percent must be below high_percent");
  return {};
}

}  // namespace

void video_keys(model::KeyTable& keys, std::array<VideoOptions, kVideoDevices>& video) {
  keys.section(kVideoSections[0], "frames as a camera of the system, for programs that know only such: v4l2loopback");
  device_keys(keys, video[0]);
  keys.section(kVideoSections[1], "another such device, as raw frames beside sharp ones");
  device_keys(keys, video[1]);
}

Status check_video(const model::KeyTable& keys, const std::array<VideoOptions, kVideoDevices>& video, int width) {
  for (std::size_t i = 0; i < kVideoDevices; ++i) {
    const std::string section(kVideoSections[i]);
    if (const Status agc = check_agc(video[i].sink.agc); !agc) {
      return at(keys.where(section + ".high_k").append(section), agc.error());
    }
    if (!video[i].enabled) continue;
    if (const Status fits = v4l2::check_width(video[i].sink.format, width); !fits) {
      return at(keys.where(section + ".format").append(section), fits.error());
    }
  }
  if (video[0].enabled && video[1].enabled && video[0].sink.device == video[1].sink.device) {
    return bad_input(keys.where("v4l2_second.device") + "v4l2 and v4l2_second have the same device " +
                     video[0].sink.device);
  }
  return {};
}

}  // namespace bolo::daemon
