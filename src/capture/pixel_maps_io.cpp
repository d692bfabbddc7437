#include "src/capture/pixel_maps_io.hpp"

#include <cmath>
#include <string>

#include "src/capture/h5_driver.hpp"

namespace bolo::capture {
namespace {

constexpr int kMapsVersion = 1;
constexpr int kMostPixelsASide = 1 << 15;
constexpr double kLongestTau_s = 1.0;

bool good_tau(double v) { return v > 0.0 && v < kLongestTau_s; }
// False for NaN and infinities, and where frames would become such.
bool good_gain(double v) { return v > 0.0 && v <= 1e6; }
bool good_offset(double v) { return std::abs(v) <= 1e9; }
bool good_flag(double v) { return v == 0.0 || v == 1.0; }

// Valid values of a dataset. `good` is false for NaN.
struct Rule {
  const char* path;
  bool (*good)(double);
  const char* wanted;
};
constexpr Rule kTau{"/tau_s", good_tau, "above 0 and below 1 s"};
constexpr Rule kGain{"/gain", good_gain, "above 0 and at most 1e6"};
constexpr Rule kOffset{"/offset_k", good_offset, "a number from -1e9 to 1e9"};
constexpr Rule kDead{"/dead", good_flag, "0 or 1"};

template <typename T>
Status check_values(const Rule& rule, const std::vector<T>& values, Geometry geometry) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto value = static_cast<double>(values[i]);
    if (rule.good(value)) continue;
    const auto width = static_cast<std::size_t>(geometry.width);
    return bad_input(std::string(rule.path) + "[" + std::to_string(i / width) + ", " + std::to_string(i % width) +
                     "] is " + h5::text(value) + "; must be " + rule.wanted);
  }
  return {};
}

Status check_shape(hid_t dataset, const Rule& rule, Geometry geometry) {
  const h5::Dims wanted{static_cast<hsize_t>(geometry.height), static_cast<hsize_t>(geometry.width)};
  if (h5::shape(dataset) != wanted) {
    return bad_input(std::string(rule.path) + " has the shape " + h5::text(h5::shape(dataset)) + "; expected " +
                     h5::text(wanted) + ", as 'height' and 'width' say");
  }
  return h5::check_numbers(dataset, rule.path);
}

template <typename T>
Status read_map(hid_t file, const Rule& rule, hid_t memory_type, Geometry geometry, std::vector<T>& values) {
  if (H5Lexists(file, rule.path, H5P_DEFAULT) <= 0) return {};  // a dangling link is not a missing map
  ASSIGN_OR_RETURN(const h5::Handle dataset, h5::open_dataset(file, rule.path));
  if (Status good = check_shape(dataset.get(), rule, geometry); !good) return good;
  values.resize(geometry.pixels());
  if (H5Dread(dataset.get(), memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
    return bad_input(std::string(rule.path) + " cannot be read" + h5::because());
  }
  return check_values(rule, values, geometry);
}

Result<int> side(const h5::Owner& root, const char* name) {
  ASSIGN_OR_RETURN(const double value, h5::number_attribute(root, name));
  if (value < 1.0 || value > kMostPixelsASide || value != std::floor(value)) {
    return bad_input(std::string("root attribute '") + name + "' is " + h5::text(value) +
                     "; expected a whole number from 1 to " + std::to_string(kMostPixelsASide));
  }
  return static_cast<int>(value);
}

Result<Geometry> read_identity(hid_t file) {
  const h5::Handle group(H5Gopen2(file, "/", H5P_DEFAULT));
  const h5::Owner root{group.get(), "root"};
  const Result<std::string> format = h5::string_attribute(root, "format");
  if (!format) return bad_input(format.error().message + "; expected a \"bolo-maps\" file");
  if (*format != "bolo-maps")
    return bad_input("root attribute 'format' is \"" + *format + "\"; expected \"bolo-maps\"");
  ASSIGN_OR_RETURN(const double version, h5::number_attribute(root, "version"));
  if (version != kMapsVersion) {
    return bad_input("root attribute 'version' is " + h5::text(version) + "; this program reads version 1");
  }
  ASSIGN_OR_RETURN(const int width, side(root, "width"));
  ASSIGN_OR_RETURN(const int height, side(root, "height"));
  return Geometry{width, height};
}

// Calls each(rule, type in memory and in the file, values) for each map, up to the first error.
Status each_map(auto& maps, auto each) {
  Status good = each(kTau, H5T_NATIVE_FLOAT, maps.tau_s);
  if (good) good = each(kGain, H5T_NATIVE_FLOAT, maps.gain);
  if (good) good = each(kOffset, H5T_NATIVE_FLOAT, maps.offset);
  if (good) good = each(kDead, H5T_NATIVE_UINT8, maps.dead);
  return good;
}

Result<model::PixelMaps> read_all(hid_t file) {
  ASSIGN_OR_RETURN(const Geometry geometry, read_identity(file));
  model::PixelMaps maps;
  maps.geometry = geometry;
  RETURN_IF_ERROR(each_map(
      maps, [&](const Rule& rule, hid_t type, auto& values) { return read_map(file, rule, type, geometry, values); }));
  return maps;
}

template <typename T>
Status write_map(hid_t file, const Rule& rule, hid_t type, Geometry geometry, const std::vector<T>& values) {
  if (values.empty()) return {};
  if (values.size() != geometry.pixels()) {
    return bad_input(std::string(rule.path) + " would have " + std::to_string(values.size()) + " values for " +
                     std::to_string(geometry.pixels()) + " pixels");
  }
  if (Status good = check_values(rule, values, geometry); !good) return good;
  const h5::Dims dims{static_cast<hsize_t>(geometry.height), static_cast<hsize_t>(geometry.width)};
  if (h5::write_dataset(file, rule.path, type, dims, values.data())) return {};
  return failed(std::string(rule.path) + " cannot be written" + h5::because());
}

Status write_maps(hid_t file, const model::PixelMaps& maps) {
  const h5::Handle root(H5Gopen2(file, "/", H5P_DEFAULT));
  const bool named = h5::write_attribute(root.get(), "format", std::string("bolo-maps")) &&
                     h5::write_attribute(root.get(), "version", std::int64_t{kMapsVersion}) &&
                     h5::write_attribute(root.get(), "width", std::int64_t{maps.geometry.width}) &&
                     h5::write_attribute(root.get(), "height", std::int64_t{maps.geometry.height});
  if (!named) return failed("the root attributes cannot be written" + h5::because());
  return each_map(maps, [&](const Rule& rule, hid_t type, const auto& values) {
    return write_map(file, rule, type, maps.geometry, values);
  });
}

// Built in memory, because HDF5 does not survive a full disk.
Result<std::string> to_bytes(const model::PixelMaps& maps) {
  constexpr std::size_t kStep = std::size_t{1} << 20;
  if (!h5::has_memory_for_a_file()) return failed("cannot be made in memory: not enough memory");
  const h5::Handle access(H5Pcreate(H5P_FILE_ACCESS));
  if (H5Pset_fapl_core(access.get(), kStep, 0) < 0) return failed("cannot be made in memory" + h5::because());
  const h5::Handle file(H5Fcreate("bolo-maps in memory", H5F_ACC_TRUNC, H5P_DEFAULT, access.get()));
  if (!file) return failed("cannot be made in memory" + h5::because());
  RETURN_IF_ERROR(write_maps(file.get(), maps));
  const ssize_t size = H5Fflush(file.get(), H5F_SCOPE_LOCAL) < 0 ? -1 : H5Fget_file_image(file.get(), nullptr, 0);
  std::string bytes(size > 0 ? static_cast<std::size_t>(size) : 0, '\0');
  if (size > 0 && H5Fget_file_image(file.get(), bytes.data(), bytes.size()) == size) return bytes;
  return failed("cannot be made in memory" + h5::because());
}

}  // namespace

Result<model::PixelMaps> read_pixel_maps(const std::filesystem::path& file) {
  const h5::Quiet quiet;
  ASSIGN_OR_RETURN(const h5::Handle handle, at(file.string(), open_hdf5(file)));
  ASSIGN_OR_RETURN(model::PixelMaps maps, at(file.string(), read_all(handle.get())));
  RETURN_IF_ERROR(at(file.string(), check_reads(handle.get())));
  return maps;
}

Status write_pixel_maps(const OutputFile& file, const model::PixelMaps& maps) {
  const h5::Quiet quiet;
  const Geometry g = maps.geometry;
  if (g.width < 1 || g.height < 1) return bad_input(file.path.string() + ": maps without a size cannot be stored");
  const Result<std::string> bytes = to_bytes(maps);
  return bytes ? write_file(file, *bytes) : at(file.path.string(), bytes.error());
}

Result<model::PixelMaps> read_profile_maps(const model::CameraProfile& profile) {
  model::PixelMaps maps;
  if (!profile.maps.empty()) {
    ASSIGN_OR_RETURN(maps, read_pixel_maps(profile.maps));
  }
  maps.row_delay_s = profile.row_delay_s;
  return maps;
}

std::filesystem::path maps_beside(const std::filesystem::path& profile) {
  std::filesystem::path maps = profile;
  maps.replace_filename(profile.stem().string() + "-maps.h5");
  return maps;
}

Status write_profile_files(const OutputFile& file, const std::filesystem::path& maps_file,
                           model::CameraProfile& profile, const model::PixelMaps& maps, const model::Origins& origins) {
  if (!maps.tau_s.empty() || !maps.gain.empty() || !maps.offset.empty() || !maps.dead.empty()) {
    if (Status written = write_pixel_maps({maps_file, file.replace}, maps); !written) return written;
    std::error_code ignored;
    const auto relative =
        std::filesystem::proximate(maps_file, std::filesystem::absolute(file.path).parent_path(), ignored);
    profile.maps = relative.empty() ? maps_file : relative;
  }
  return write_file(file, model::document_profile(profile, origins));
}

}  // namespace bolo::capture
