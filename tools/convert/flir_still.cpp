#include "tools/convert/flir_still.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>
#include <utility>

#include <nlohmann/json.hpp>

#include "src/core/byte_order.hpp"
#include "tools/cli/process.hpp"

namespace bolo::tools {
namespace {

using nlohmann::json;

constexpr double kZeroCelsius_k = 273.15;
constexpr double kHottest_k = 1e4;                                    // far above any camera's range
constexpr std::uintmax_t kLargestStill = std::uintmax_t{256} << 20U;  // a camera's have some MiB
constexpr const char* kPackage = "libimage-exiftool-perl";

double radiation(double kelvin, const FlirConstants& c) {
  return c.planck_r1 / (c.planck_r2 * (std::exp(c.planck_b / kelvin) - c.planck_f)) - c.planck_o;
}

// raw value = factor * radiation of the object itself + offset.
struct Path {
  double factor;
  double offset;
};

Path path_of(const FlirConstants& c) {
  const double t = atmosphere_transmission(c);
  const double w = c.window_transmission;
  const double e = c.emissivity;
  return {w * e * t, w * ((1.0 - e) * t * radiation(c.reflected_k, c) + (1.0 - t) * radiation(c.atmosphere_k, c)) +
                         (1.0 - w) * radiation(c.window_k, c)};
}

double kelvin_of(double raw, const Path& path, const FlirConstants& c) {
  const double object = (raw - path.offset) / path.factor;
  return c.planck_b / std::log(c.planck_r1 / (c.planck_r2 * (object + c.planck_o)) + c.planck_f);
}

Result<json> read_tags(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(const auto text, output_of({"exiftool", "-json", "-n", "-FLIR:all", "--", file.string()}, kPackage));
  const json tags = json::parse(contents(text.file), nullptr, false);
  if (!tags.is_array() || tags.empty() || !tags[0].is_object()) return failed("exiftool said nothing of it");
  return tags[0];
}

struct Tag {
  const char* name;
  double FlirConstants::*member;
  double offset = 0.0;
  bool needed = false;
};

constexpr Tag kTags[] = {
    {"PlanckR1", &FlirConstants::planck_r1, 0.0, true},
    {"PlanckR2", &FlirConstants::planck_r2, 0.0, true},
    {"PlanckB", &FlirConstants::planck_b, 0.0, true},
    {"PlanckF", &FlirConstants::planck_f, 0.0, true},
    {"PlanckO", &FlirConstants::planck_o, 0.0, true},
    {"Emissivity", &FlirConstants::emissivity},
    {"ObjectDistance", &FlirConstants::distance_m},
    {"ReflectedApparentTemperature", &FlirConstants::reflected_k, kZeroCelsius_k},
    {"AtmosphericTemperature", &FlirConstants::atmosphere_k, kZeroCelsius_k},
    {"IRWindowTemperature", &FlirConstants::window_k, kZeroCelsius_k},
    {"IRWindowTransmission", &FlirConstants::window_transmission},
    {"RelativeHumidity", &FlirConstants::humidity},
    {"AtmosphericTransAlpha1", &FlirConstants::alpha1},
    {"AtmosphericTransAlpha2", &FlirConstants::alpha2},
    {"AtmosphericTransBeta1", &FlirConstants::beta1},
    {"AtmosphericTransBeta2", &FlirConstants::beta2},
    {"AtmosphericTransX", &FlirConstants::x},
};

Result<FlirConstants> constants_of(const json& tags) {
  FlirConstants constants;
  for (const Tag& tag : kTags) {
    const auto found = tags.find(tag.name);
    const bool there = found != tags.end() && found->is_number() && std::isfinite(found->get<double>());
    if (there) constants.*tag.member = found->get<double>() + tag.offset;
    if (!there && tag.needed)
      return bad_input(std::string("the constant ") + tag.name + " is missing; not a radiometric still");
  }
  const auto share = [](double v) { return v > 0.0 && v <= 1.0; };
  if (!share(constants.emissivity) || !share(constants.window_transmission) || constants.distance_m < 0.0) {
    return bad_input("emissivity, window transmission or distance is out of range");
  }
  return constants;
}

std::string text_of(const json& tags, const char* name) {
  const auto found = tags.find(name);
  if (found == tags.end()) return {};
  return found->is_string() ? found->get<std::string>() : found->dump();
}

Result<Picture> read_raw(const std::filesystem::path& file, const std::string& type) {
  ASSIGN_OR_RETURN(const auto image, output_of({"exiftool", "-b", "-RawThermalImage", "--", file.string()}, kPackage));
  if (std::filesystem::file_size(image.file) == 0) {
    return bad_input("there is no raw thermal image in it; not a radiometric still");
  }
  if (type != "PNG") {
    ASSIGN_OR_RETURN(TiffReader reader, TiffReader::open(image.file));
    return reader.read(0);
  }
  Result<Picture> picture = read_png_picture(image.file);
  if (picture && is_byte_swapped(picture->geometry, picture->u16)) {
    for (std::uint16_t& value : picture->u16) value = swap_bytes(value);
  }
  return picture;
}

}  // namespace

double atmosphere_transmission(const FlirConstants& k) {
  const double c = k.atmosphere_k - kZeroCelsius_k;
  const double water =
      std::sqrt(k.humidity * std::exp(1.5587 + 0.06939 * c - 2.7816e-4 * c * c + 6.8455e-7 * c * c * c));
  const double way = -std::sqrt(k.distance_m);
  return k.x * std::exp(way * (k.alpha1 + k.beta1 * water)) +
         (1.0 - k.x) * std::exp(way * (k.alpha2 + k.beta2 * water));
}

double flir_kelvin(double raw, const FlirConstants& constants) { return kelvin_of(raw, path_of(constants), constants); }

bool is_byte_swapped(Geometry geometry, std::span<const std::uint16_t> values) {
  double as_is = 0.0;
  double other = 0.0;
  const auto width = static_cast<std::size_t>(geometry.width);
  for (std::size_t i = 1; i < values.size(); ++i) {
    if (i % width == 0) continue;
    as_is += std::abs(static_cast<int>(values[i]) - static_cast<int>(values[i - 1]));
    other += std::abs(static_cast<int>(swap_bytes(values[i])) - static_cast<int>(swap_bytes(values[i - 1])));
  }
  return other < as_is;
}

Result<FlirStill> read_flir_still(const std::filesystem::path& file) {
  std::error_code ignored;  // for names that no file can have
  if (!std::filesystem::is_regular_file(file, ignored)) return bad_input("is not there");
  // exiftool would search terabytes for a picture, and accepts files of any content.
  if (std::filesystem::file_size(file, ignored) > kLargestStill) return bad_input("is larger than a still can be");
  std::array<char, 2> begin{};
  std::ifstream(file, std::ios::binary).read(begin.data(), begin.size());
  if (begin != std::array<char, 2>{'\xff', '\xd8'}) return bad_input("is no JPEG");
  ASSIGN_OR_RETURN(const json tags, read_tags(file));
  ASSIGN_OR_RETURN(const FlirConstants constants, constants_of(tags));
  ASSIGN_OR_RETURN(Picture raw, read_raw(file, text_of(tags, "RawThermalImageType")));
  if (raw.type != PixelType::kUint16) return bad_input("its raw thermal image is not of 16 bits");
  return FlirStill{std::move(raw), constants, text_of(tags, "CameraModel"), text_of(tags, "CameraSerialNumber")};
}

Result<Picture> to_kelvin(const FlirStill& still) {
  Picture picture{{}, still.raw.geometry, PixelType::kFloat32};
  const Path path = path_of(still.constants);
  picture.f32.reserve(still.raw.u16.size());
  for (const std::uint16_t raw : still.raw.u16) {
    const double kelvin = kelvin_of(raw, path, still.constants);
    const bool good = kelvin > 0.0 && kelvin < kHottest_k;
    picture.f32.push_back(good ? static_cast<float>(kelvin) : std::numeric_limits<float>::quiet_NaN());
  }
  const bool any = std::ranges::any_of(picture.f32, [](float kelvin) { return std::isfinite(kelvin); });
  if (!any) return bad_input("its constants make no temperature of any pixel; it is damaged");
  return picture;
}

}  // namespace bolo::tools
