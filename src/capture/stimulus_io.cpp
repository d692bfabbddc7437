// The `/stimulus` group: each kind is a row of the table in docs/formats.md.
#include <algorithm>
#include <cmath>
#include <concepts>
#include <span>
#include <type_traits>
#include <variant>

#include "src/capture/contents.hpp"

namespace bolo::capture {
namespace {

using h5::text;

const std::string kGroup = "/stimulus";
constexpr std::size_t kMostImagePixels = std::size_t{1} << 28;

template <typename T, typename Kind>
concept Of = std::same_as<std::remove_const_t<T>, Kind>;

constexpr const char* name_of(const Uniform*) { return "uniform"; }
constexpr const char* name_of(const Chopper*) { return "chopper"; }
constexpr const char* name_of(const BarTarget*) { return "bar_target"; }
constexpr const char* name_of(const SceneStimulus*) { return "scene"; }

// The fields of each kind, in the order of the file, for reading and writing.
void each_field(auto& fields, Of<Uniform> auto& u) {
  fields.number("temperature_k", u.temperature_k);
  fields.accuracy("level_accuracy_k", u.level_accuracy_k);
}

void each_field(auto& fields, Of<Chopper> auto& c) {
  fields.number("cold_k", c.cold_k);
  fields.series("on_s", c.on_s);
  fields.series("off_s", c.off_s);
  fields.series("level_k", c.level_k);
  fields.accuracy("level_accuracy_k", c.level_accuracy_k);
}

void each_field(auto& fields, Of<BarTarget> auto& b) {
  fields.number("cold_k", b.cold_k);
  fields.number("hot_k", b.hot_k);
  fields.number("period_px", b.period_px);
  fields.number("bar_width_px", b.bar_width_px);
  fields.number("slant_px_per_row", b.slant_px_per_row);
  fields.number("velocity_px_s", b.velocity_px_s);
  fields.accuracy("level_accuracy_k", b.level_accuracy_k);
}

void each_field(auto& fields, Of<SceneStimulus> auto& s) {
  fields.image("image_k", s.image_width, s.image_height, s.image_k);
  fields.series("t_s", s.t_s);
  fields.series("x_px", s.x_px);
  fields.series("y_px", s.y_px);
}

class FieldReader {
 public:
  FieldReader(hid_t file, hid_t group) : file_(file), owner_{group, kGroup} {}

  void number(const char* name, double& out) { take(h5::number_attribute(owner_, name), out); }
  // Keeps the default if the file has none.
  void accuracy(const char* name, double& out) {
    if (H5Aexists(owner_.id, name) > 0) number(name, out);
  }
  void series(const char* name, std::vector<double>& out) { take(h5::read_doubles(file_, kGroup + "/" + name), out); }
  void image(const char* name, int& width, int& height, std::vector<float>& values) {
    StillImage image;
    take(read_image(file_, kGroup + "/" + name), image);
    width = image.width;
    height = image.height;
    values = std::move(image.kelvin);
  }
  const Status& status() const { return status_; }

 private:
  template <typename T>
  void take(Result<T> result, T& out) {
    if (result) {
      out = std::move(*result);
    } else if (status_) {
      status_ = tl::unexpected<Error>(std::move(result.error()));
    }
  }

  hid_t file_;
  h5::Owner owner_;
  Status status_;
};

struct FieldWriter {
  void number(const char* name, double value) { good = good && h5::write_attribute(group, name, value); }
  void accuracy(const char* name, double value) {
    if (value != kLevelAccuracyK) number(name, value);
  }
  void series(const char* name, const std::vector<double>& values) {
    good = good && h5::write_dataset(group, name, H5T_NATIVE_DOUBLE, {values.size()}, values.data());
  }
  void image(const char* name, int width, int height, const std::vector<float>& values) {
    const h5::Dims dims{static_cast<hsize_t>(height), static_cast<hsize_t>(width)};
    good = good && h5::write_dataset(group, name, H5T_NATIVE_FLOAT, dims, values.data());
  }

  hid_t group;
  bool good = true;
};

// Limits well beyond any bench: squares and ratios of larger numbers would overflow in later computations.
constexpr double kMostKelvin = 1e4;
constexpr double kLeastAccuracy_k = 1e-6;
constexpr double kFarthest_px = 1e9;  // also per second, and per row
constexpr double kLeastPeriod_px = 1e-3;

bool is_within(double value, double most) { return std::abs(value) <= most; }

Status all_within(const char* name, std::span<const double> values, double most) {
  const auto bad = std::find_if(values.begin(), values.end(), [most](double v) { return !is_within(v, most); });
  if (bad == values.end()) return {};
  return bad_input(kGroup + "/" + name + ": value " + std::to_string(bad - values.begin()) + " (" + text(*bad) +
                   ") is not a finite number up to " + text(most));
}

Status same_length(const char* name, std::size_t length, const char* other, std::size_t other_length) {
  if (length == other_length) return {};
  return bad_input(kGroup + "/" + name + " has " + std::to_string(length) + " values but " + kGroup + "/" + other +
                   " has " + std::to_string(other_length) + "; they belong together");
}

Status absolute_temperature(const char* name, double kelvin) {
  if (kelvin > 0.0 && kelvin <= kMostKelvin) return {};
  return bad_input(kGroup + " attribute '" + name + "' is " + text(kelvin) + "; expected kelvin above 0, at most " +
                   text(kMostKelvin));
}

template <typename... Statuses>
Status first_error(Statuses... statuses) {
  Status out;
  ((out = out ? std::move(statuses) : out), ...);
  return out;
}

Status accuracy(double kelvin) {
  if (kelvin >= kLeastAccuracy_k && kelvin <= kMostKelvin) return {};
  return bad_input(kGroup + " attribute 'level_accuracy_k' is " + text(kelvin) + "; expected " +
                   text(kLeastAccuracy_k) + " to " + text(kMostKelvin) + " K");
}

Status check(const NoStimulus&) { return {}; }

Status check(const Uniform& u) {
  return first_error(absolute_temperature("temperature_k", u.temperature_k), accuracy(u.level_accuracy_k));
}

Status check(const Chopper& c) {
  Status good =
      first_error(absolute_temperature("cold_k", c.cold_k), all_within("on_s", c.on_s, kLastTime_s),
                  all_within("off_s", c.off_s, kLastTime_s), all_within("level_k", c.level_k, kMostKelvin),
                  same_length("off_s", c.off_s.size(), "on_s", c.on_s.size()),
                  same_length("level_k", c.level_k.size(), "on_s", c.on_s.size()), accuracy(c.level_accuracy_k));
  for (std::size_t i = 0; good && i < c.on_s.size(); ++i) {
    if (c.off_s[i] <= c.on_s[i]) {
      return bad_input(kGroup + "/off_s: value " + std::to_string(i) + " (" + text(c.off_s[i]) +
                       ") is not after on_s (" + text(c.on_s[i]) + ")");
    }
  }
  return good;
}

Status check(const BarTarget& b) {
  Status good = first_error(absolute_temperature("cold_k", b.cold_k), absolute_temperature("hot_k", b.hot_k),
                            accuracy(b.level_accuracy_k));
  if (!good) return good;
  if (!(b.period_px >= kLeastPeriod_px && b.period_px <= kFarthest_px)) {
    return bad_input(kGroup + " attribute 'period_px' is " + text(b.period_px) + "; expected " + text(kLeastPeriod_px) +
                     " to " + text(kFarthest_px) + " pixels");
  }
  if (!(b.bar_width_px > 0.0 && b.bar_width_px <= b.period_px)) {
    return bad_input(kGroup + " attribute 'bar_width_px' is " + text(b.bar_width_px) +
                     "; expected pixels above 0, at most period_px (" + text(b.period_px) + ")");
  }
  if (!is_within(b.slant_px_per_row, kFarthest_px) || !is_within(b.velocity_px_s, kFarthest_px)) {
    return bad_input(kGroup + " attributes 'slant_px_per_row' and 'velocity_px_s' must be finite, up to " +
                     text(kFarthest_px));
  }
  return {};
}

Status check(const SceneStimulus& s) {
  if (s.image_width < 1 || s.image_height < 1 ||
      s.image_k.size() != static_cast<std::size_t>(s.image_width) * static_cast<std::size_t>(s.image_height)) {
    return bad_input(kGroup + "/image_k has " + std::to_string(s.image_k.size()) + " values; expected " +
                     std::to_string(s.image_height) + " rows of " + std::to_string(s.image_width));
  }
  const auto bad = std::find_if(s.image_k.begin(), s.image_k.end(), [](float v) { return !is_within(v, kMostKelvin); });
  if (bad != s.image_k.end()) {
    return bad_input(kGroup + "/image_k: value " + std::to_string(bad - s.image_k.begin()) + " is not finite, up to " +
                     text(kMostKelvin));
  }
  if (s.t_s.empty()) return bad_input(kGroup + "/t_s is empty; expected the times of the trajectory");
  Status good =
      first_error(all_within("t_s", s.t_s, kLastTime_s), all_within("x_px", s.x_px, kFarthest_px),
                  all_within("y_px", s.y_px, kFarthest_px), same_length("x_px", s.x_px.size(), "t_s", s.t_s.size()),
                  same_length("y_px", s.y_px.size(), "t_s", s.t_s.size()));
  if (!good) return good;
  const auto fall = std::adjacent_find(s.t_s.begin(), s.t_s.end(), [](double a, double b) { return !(b > a); });
  if (fall != s.t_s.end()) {
    return bad_input(kGroup + "/t_s: value " + std::to_string(fall - s.t_s.begin() + 1) +
                     " is not above the one before; the times of the trajectory must rise");
  }
  return {};
}

template <typename Kind>
bool read_as(const std::string& kind, FieldReader& fields, Stimulus& stimulus) {
  if (kind != name_of(static_cast<Kind*>(nullptr))) return false;
  each_field(fields, stimulus.emplace<Kind>());
  return true;
}

bool write(hid_t, const NoStimulus&) { return true; }

template <typename Kind>
bool write(hid_t group, const Kind& kind) {
  FieldWriter fields{group, h5::write_attribute(group, "kind", std::string(name_of(&kind)))};
  each_field(fields, kind);
  return fields.good;
}

}  // namespace

Result<Stimulus> read_stimulus(hid_t file) {
  if (!h5::exists(file, kGroup)) return NoStimulus{};
  const h5::Handle group(H5Oopen(file, kGroup.c_str(), H5P_DEFAULT));
  if (!group || H5Iget_type(group.get()) != H5I_GROUP) return bad_input(kGroup + " is not a group");
  ASSIGN_OR_RETURN(const std::string kind, h5::string_attribute({group.get(), kGroup}, "kind"));

  FieldReader fields(file, group.get());
  Stimulus stimulus;
  const bool known = read_as<Uniform>(kind, fields, stimulus) || read_as<Chopper>(kind, fields, stimulus) ||
                     read_as<BarTarget>(kind, fields, stimulus) || read_as<SceneStimulus>(kind, fields, stimulus);
  if (!known) {
    return bad_input(kGroup + " attribute 'kind' is '" + kind + "'; expected uniform, chopper, bar_target or scene");
  }
  RETURN_IF_ERROR(fields.status());
  RETURN_IF_ERROR(check_stimulus(stimulus));
  return stimulus;
}

Status check_stimulus(const Stimulus& stimulus) {
  return std::visit([](const auto& kind) { return check(kind); }, stimulus);
}

Status write_stimulus(hid_t file, const Stimulus& stimulus) {
  if (std::holds_alternative<NoStimulus>(stimulus)) return {};
  const h5::Handle group(H5Gcreate2(file, kGroup.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  if (!group) return failed(kGroup + " cannot be created" + h5::because());
  const bool written = std::visit([&](const auto& kind) { return write(group.get(), kind); }, stimulus);
  if (!written) return failed(kGroup + " cannot be written" + h5::because());
  return {};
}

Result<StillImage> read_image(hid_t file, const std::string& path) {
  ASSIGN_OR_RETURN(h5::Handle dataset, h5::open_dataset(file, path));
  const h5::Dims dims = h5::shape(dataset.get());
  const std::size_t pixels = h5::product(dims).value_or(kMostImagePixels + 1);
  if (dims.size() != 2 || pixels == 0 || pixels > kMostImagePixels) {
    return bad_input(path + " has the shape " + text(dims) + "; expected an image (height, width)");
  }
  RETURN_IF_ERROR(h5::check_numbers(dataset.get(), path));
  StillImage image{static_cast<int>(dims[1]), static_cast<int>(dims[0]), std::vector<float>(pixels)};
  if (H5Dread(dataset.get(), H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, image.kelvin.data()) < 0) {
    return bad_input(path + " cannot be read" + h5::because());
  }
  return image;
}

}  // namespace bolo::capture
