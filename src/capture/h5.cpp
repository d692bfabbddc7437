#include "src/capture/h5.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>

namespace bolo::capture::h5 {
namespace {

// The best ratio of deflate is 1032; shuffle and scale-offset do not exceed it by much.
constexpr std::size_t kMostCompression = 2048;

// Before any other call of the library: at exit it would try to close objects of a damaged file that it could not open,
// and print errors. Everything written here is closed here.
[[maybe_unused]] const herr_t kLeftAlone = H5dont_atexit();

constexpr const char* kNoMemory = "not enough memory";

herr_t keep_first(unsigned, const H5E_error2_t* error, void* out) {
  auto& message = *static_cast<std::string*>(out);
  if (error->desc != nullptr) message = error->desc;
  if (error->maj_num == H5E_RESOURCE && error->min_num == H5E_NOSPACE) message = kNoMemory;
  return 1;  // stop: the innermost error comes first
}

// Numbers and strings may be stored as a scalar or as an array of one.
bool holds_one(hid_t attribute) {
  const Handle space(H5Aget_space(attribute));
  return space && H5Sget_simple_extent_npoints(space.get()) == 1;
}

std::string attribute_text(const Owner& owner, const std::string& name) {
  return owner.name + " attribute '" + name + "'";
}

Result<Handle> open_attribute(const Owner& owner, const std::string& name) {
  if (!has_attribute(owner, name)) return bad_input(attribute_text(owner, name) + " is missing");
  Handle attribute(H5Aopen(owner.id, name.c_str(), H5P_DEFAULT));
  if (!attribute) return bad_input(attribute_text(owner, name) + " cannot be read" + because());
  if (!holds_one(attribute.get())) return bad_input(attribute_text(owner, name) + " must hold one value");
  return attribute;
}

tl::unexpected<Error> too_long(const std::string& where) {
  return bad_input(where + " is longer than " + std::to_string(kLongestString) + " bytes");
}

Result<std::string> read_string(hid_t attribute, hid_t type, const std::string& where) {
  if (H5Tis_variable_str(type) > 0) {
    char* characters = nullptr;
    if (H5Aread(attribute, type, static_cast<void*>(&characters)) < 0) {
      return bad_input(where + " cannot be read" + because());
    }
    std::string value;
    if (characters != nullptr) value.assign(characters, strnlen(characters, kLongestString + 1));
    H5free_memory(characters);
    if (value.size() > kLongestString) return too_long(where);
    return value;
  }
  const std::size_t size = H5Tget_size(type);
  if (size > kLongestString) return too_long(where);
  std::vector<char> characters(size);
  if (H5Aread(attribute, type, characters.data()) < 0) return bad_input(where + " cannot be read" + because());
  return fixed_string(characters.data(), size, type);
}

Status check_filters(hid_t properties, const std::string& path) {
  const int filters = H5Pget_nfilters(properties);
  for (int i = 0; i < filters; ++i) {
    unsigned flags = 0;
    unsigned config = 0;
    std::size_t values = 0;
    std::array<char, 64> name{};
    const H5Z_filter_t id = H5Pget_filter2(properties, static_cast<unsigned>(i), &flags, &values, nullptr, name.size(),
                                           name.data(), &config);
    if (id < 0 || H5Zfilter_avail(id) <= 0) {
      return bad_input(path + " is compressed with filter " + std::to_string(id) + " ('" + name.data() +
                       "'), which is not installed; rewrite the file with h5repack -f GZIP=4");
    }
  }
  return {};
}

// Values must be in the file itself. Another place could be anything: a file that only this reader may read, a pipe
// that nobody feeds, or this same dataset, recursively.
Status check_place(hid_t properties, const std::string& path) {
  if (H5Pget_layout(properties) != H5D_VIRTUAL && H5Pget_external_count(properties) <= 0) return {};
  return bad_input(path + " has its values in other files, which are not read; write them into this one");
}

// Elements that storage is allocated for: whole chunks, or the shape itself.
std::optional<std::size_t> allocated_values(hid_t properties, const Dims& dims) {
  if (H5Pget_layout(properties) != H5D_CHUNKED || dims.empty()) return product(dims);
  Dims allocated(dims.size());
  const auto rank = static_cast<int>(dims.size());
  if (H5Pget_chunk(properties, rank, allocated.data()) != rank) return std::nullopt;
  for (std::size_t i = 0; i < dims.size(); ++i) {
    if (dims[i] > std::numeric_limits<hsize_t>::max() - allocated[i]) return std::nullopt;
    allocated[i] *= (dims[i] + allocated[i] - 1) / allocated[i];
  }
  return product(allocated);
}

// Refuses a shape whose data the file does not hold, and chunks of other sizes than stated: HDF5 1.10 trusts a damaged
// index, reads beyond its buffers or spends minutes on a chunk that does not exist.
Status check_stored(hid_t dataset, hid_t properties, const std::string& path) {
  const Dims dims = shape(dataset);
  const Handle type(H5Dget_type(dataset));
  const std::optional<std::size_t> values = product(dims);
  const std::optional<std::size_t> allocated = allocated_values(properties, dims);
  const std::size_t bytes = H5Tget_size(type.get());
  if (!values || !allocated || bytes == 0 || *allocated > std::numeric_limits<std::size_t>::max() / 2 / bytes) {
    return bad_input(path + " declares an impossible shape " + text(dims));
  }
  if (*values == 0) return {};
  const bool packed = H5Pget_nfilters(properties) > 0;
  const std::size_t stored = H5Dget_storage_size(dataset);
  const std::size_t least = packed ? *allocated * bytes / kMostCompression : *allocated * bytes;
  if (stored < least || stored == 0) {
    return bad_input(path + " declares " + text(dims) + " values but the file holds only " + std::to_string(stored) +
                     " bytes of them; it was cut off or never finished");
  }
  if (!packed && stored != least && is_number(type.get())) {  // strings of variable length are stored elsewhere
    return bad_input(path + " declares " + text(dims) + " values but the file holds " + std::to_string(stored) +
                     " bytes of them; it is damaged");
  }
  return {};
}

bool read_rows(hid_t dataset, hid_t memory_type, std::size_t rows, bool all, void* out) {
  if (rows == 0) return true;
  if (all) return H5Dread(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, out) >= 0;
  return read_block(dataset, memory_type, {0}, {rows}, out);
}

hsize_t series_chunk(hid_t dataset) {
  const Handle properties(H5Dget_create_plist(dataset));
  hsize_t chunk = 0;
  if (H5Pget_layout(properties.get()) != H5D_CHUNKED || H5Pget_chunk(properties.get(), 1, &chunk) != 1) return 0;
  return chunk;
}

// The values of the chunks that can be read, from the first on.
template <typename T>
std::vector<T> read_readable_part(hid_t dataset, hid_t memory_type, std::size_t values, std::size_t value_bytes) {
  const hsize_t chunk = series_chunk(dataset);
  const std::size_t stored = H5Dget_storage_size(dataset);
  if (chunk == 0 || stored % (chunk * value_bytes) != 0) return {};  // damaged, not just cut off
  std::size_t rows = std::min<std::size_t>({values, stored / value_bytes, kMostRowBytes / sizeof(T)});
  std::vector<T> out(rows);
  while (!read_rows(dataset, memory_type, rows, false, out.data())) rows = (rows - 1) / chunk * chunk;
  out.resize(rows);
  return out;
}

template <typename T>
Result<std::vector<T>> read_series(hid_t file, const std::string& path, Expect expect, hid_t memory_type) {
  ASSIGN_OR_RETURN(Handle dataset, open_dataset(file, path, expect));
  RETURN_IF_ERROR(check_numbers(dataset.get(), path));
  const Handle type(H5Dget_type(dataset.get()));
  const Dims dims = shape(dataset.get());
  const std::size_t values = product(dims).value_or(0);
  const bool vector_of_matlab = dims.size() == 2 && (dims[0] == 1 || dims[1] == 1);
  if (dims.size() != 1 && !vector_of_matlab) {
    return bad_input(path + " has the shape " + text(dims) + "; expected one dimension");
  }
  if (expect == Expect::kPart && dims.size() == 1) {
    return read_readable_part<T>(dataset.get(), memory_type, values, H5Tget_size(type.get()));
  }
  RETURN_IF_ERROR(check_rows(path, values, sizeof(T)));
  std::vector<T> out(values);
  if (!read_rows(dataset.get(), memory_type, values, true, out.data())) {
    return bad_input(path + " cannot be read" + because());
  }
  return out;
}

bool write_attribute_of(hid_t owner, const std::string& name, hid_t type, const void* value) {
  const Handle space(H5Screate(H5S_SCALAR));
  const Handle attribute(H5Acreate2(owner, name.c_str(), type, space.get(), H5P_DEFAULT, H5P_DEFAULT));
  return attribute && H5Awrite(attribute.get(), type, value) >= 0;
}

// The block as a selection in the dataset's space; nothing if it lies outside.
Handle selection(hid_t dataset, const Dims& start, const Dims& count) {
  Handle space(H5Dget_space(dataset));
  const bool good = H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr) >= 0;
  return good ? std::move(space) : Handle();
}

Handle simple_space(const Dims& dims) {
  return Handle(H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr));
}

}  // namespace

bool has_memory_for_a_file() noexcept {
  constexpr std::size_t kOfAFile = std::size_t{4} << 20;
  void* volatile memory = std::malloc(kOfAFile);  // volatile: otherwise the compiler removes both calls
  std::free(memory);
  return memory != nullptr;
}

// Every call of the library clears its errors, closing included.
bool Handle::close() noexcept {
  if (id_ < 0) return true;
  const hid_t id = std::exchange(id_, H5I_INVALID_HID);
  const hid_t errors = H5Eget_num(H5E_DEFAULT) > 0 ? H5Eget_current_stack() : H5I_INVALID_HID;
  const bool good = H5Idec_ref(id) >= 0;
  if (errors >= 0) H5Eset_current_stack(errors);
  return good;
}

Quiet::Quiet() noexcept {
  H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

Quiet::~Quiet() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }

std::string cause() {
  std::string message;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, keep_first, &message);
  for (char& c : message) {
    if (c == '\n' || c == '\r' || c == '\t') c = ' ';
  }
  return message;
}

std::string because() {
  const std::string message = cause();
  return message.empty() ? message : ": " + message;
}

tl::unexpected<Error> not_read(const std::string& what) {
  std::string message = cause();
  if (!has_memory_for_a_file()) message = kNoMemory;  // a filter does not say so, and errors themselves take memory
  const std::string line = what + " cannot be read" + (message.empty() ? "" : ": " + message);
  return message == kNoMemory ? failed(line) : bad_input(line);
}

std::string text(double value) {
  std::array<char, 32> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "%.9g", value);
  return buffer.data();
}

std::string text(const Dims& dims) {
  std::string out = "(";
  for (std::size_t i = 0; i < dims.size(); ++i) out += (i > 0 ? ", " : "") + std::to_string(dims[i]);
  return out + ")";
}

std::string type_text(hid_t type) {
  const std::string bits = std::to_string(8 * H5Tget_size(type));
  switch (H5Tget_class(type)) {
    case H5T_INTEGER:
      return (H5Tget_sign(type) == H5T_SGN_NONE ? "uint" : "int") + bits;
    case H5T_FLOAT:
      return "float" + bits;
    case H5T_STRING:
      return "string";
    case H5T_COMPOUND:
      return "compound";
    default:
      return "neither number nor string";
  }
}

std::string fixed_string(const char* characters, std::size_t size, hid_t type) {
  std::string value(characters, strnlen(characters, size));
  if (H5Tget_strpad(type) == H5T_STR_SPACEPAD) value.erase(value.find_last_not_of(' ') + 1);
  return value;
}

bool is_number(hid_t type) {
  const H5T_class_t kind = H5Tget_class(type);
  return kind == H5T_INTEGER || kind == H5T_FLOAT;
}

Status check_numbers(hid_t dataset, const std::string& path) {
  const Handle type(H5Dget_type(dataset));
  if (is_number(type.get())) return {};
  return bad_input(path + " is of type " + type_text(type.get()) + "; expected numbers");
}

std::optional<std::size_t> product(const Dims& dims) {
  std::size_t out = 1;
  for (const hsize_t size : dims) {
    if (size > 0 && out > std::numeric_limits<std::size_t>::max() / size) return std::nullopt;
    out *= size;
  }
  return out;
}

bool has_attribute(const Owner& owner, const std::string& name) { return H5Aexists(owner.id, name.c_str()) > 0; }

Result<double> number_attribute(const Owner& owner, const std::string& name) {
  ASSIGN_OR_RETURN(Handle attribute, open_attribute(owner, name));
  const Handle type(H5Aget_type(attribute.get()));
  if (!is_number(type.get())) {
    return bad_input(attribute_text(owner, name) + " is of type " + type_text(type.get()) + "; expected a number");
  }
  double value = 0.0;
  if (H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, &value) < 0) {
    return bad_input(attribute_text(owner, name) + " cannot be read" + because());
  }
  if (!std::isfinite(value)) return bad_input(attribute_text(owner, name) + " is not a finite number");
  return value;
}

Result<std::string> string_attribute(const Owner& owner, const std::string& name) {
  ASSIGN_OR_RETURN(Handle attribute, open_attribute(owner, name));
  const Handle type(H5Aget_type(attribute.get()));
  if (H5Tget_class(type.get()) != H5T_STRING) {
    return bad_input(attribute_text(owner, name) + " is of type " + type_text(type.get()) + "; expected a string");
  }
  return read_string(attribute.get(), type.get(), attribute_text(owner, name));
}

bool write_attribute(hid_t owner, const std::string& name, double value) {
  return write_attribute_of(owner, name, H5T_NATIVE_DOUBLE, &value);
}

bool write_attribute(hid_t owner, const std::string& name, std::int64_t value) {
  return write_attribute_of(owner, name, H5T_NATIVE_INT64, &value);
}

// Of fixed length, which MATLAB and every version of h5py read.
bool write_attribute(hid_t owner, const std::string& name, const std::string& value) {
  const Handle type(H5Tcopy(H5T_C_S1));
  H5Tset_size(type.get(), value.size() + 1);
  H5Tset_cset(type.get(), H5T_CSET_UTF8);
  return write_attribute_of(owner, name, type.get(), value.c_str());
}

bool exists(hid_t file, const std::string& path) {
  for (std::size_t slash = path.find('/', 1);; slash = path.find('/', slash + 1)) {
    if (H5Lexists(file, path.substr(0, slash).c_str(), H5P_DEFAULT) <= 0) return false;
    if (slash == std::string::npos) return H5Oexists_by_name(file, path.c_str(), H5P_DEFAULT) > 0;
  }
}

Result<Handle> open_dataset(hid_t file, const std::string& path, Expect expect) {
  if (!exists(file, path)) return bad_input("dataset " + path + " is missing");
  Handle object(H5Oopen(file, path.c_str(), H5P_DEFAULT));
  if (!object) return bad_input(path + " cannot be opened" + because());
  if (H5Iget_type(object.get()) != H5I_DATASET) return bad_input(path + " is not a dataset");
  const Handle space(H5Dget_space(object.get()));
  if (H5Sget_simple_extent_type(space.get()) == H5S_NULL) return bad_input(path + " is empty");
  const Handle properties(H5Dget_create_plist(object.get()));
  if (!properties) return bad_input(path + " cannot be opened" + because());
  RETURN_IF_ERROR(check_place(properties.get(), path));
  RETURN_IF_ERROR(check_filters(properties.get(), path));
  if (expect == Expect::kWhole) RETURN_IF_ERROR(check_stored(object.get(), properties.get(), path));
  return object;
}

Dims shape(hid_t dataset) {
  const Handle space(H5Dget_space(dataset));
  const int rank = H5Sget_simple_extent_ndims(space.get());
  Dims dims(static_cast<std::size_t>(rank > 0 ? rank : 0));
  if (!dims.empty()) H5Sget_simple_extent_dims(space.get(), dims.data(), nullptr);
  return dims;
}

Status check_rows(const std::string& path, std::size_t rows, std::size_t row_bytes) {
  if (rows <= kMostRowBytes / row_bytes) return {};
  return bad_input(path + " has " + std::to_string(rows) + " values, more than any recording");
}

bool read_block(hid_t dataset, hid_t memory_type, const Dims& start, const Dims& count, void* out) {
  const Handle from = selection(dataset, start, count);
  return from && H5Dread(dataset, memory_type, simple_space(count).get(), from.get(), H5P_DEFAULT, out) >= 0;
}

bool write_rows(hid_t dataset, hid_t memory_type, hsize_t begin, hsize_t count, const void* values) {
  Dims dims = shape(dataset);
  Dims start(dims.size(), 0);
  dims[0] = begin + count;
  start[0] = begin;
  if (H5Dset_extent(dataset, dims.data()) < 0) return false;
  dims[0] = count;
  const Handle to = selection(dataset, start, dims);
  return to && H5Dwrite(dataset, memory_type, simple_space(dims).get(), to.get(), H5P_DEFAULT, values) >= 0;
}

Handle create_growing(hid_t file, const std::string& path, hid_t type, const Dims& chunk, int deflate_level) {
  Dims none = chunk;
  Dims no_limit = chunk;
  none[0] = 0;
  no_limit[0] = H5S_UNLIMITED;
  const auto rank = static_cast<int>(chunk.size());
  const Handle space(H5Screate_simple(rank, none.data(), no_limit.data()));
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE));
  H5Pset_chunk(properties.get(), rank, chunk.data());
  H5Pset_fill_time(properties.get(), H5D_FILL_TIME_NEVER);  // every chunk is written whole
  H5Pset_obj_track_times(properties.get(), false);          // equal input gives equal files
  if (deflate_level > 0) {
    H5Pset_shuffle(properties.get());
    H5Pset_deflate(properties.get(), static_cast<unsigned>(deflate_level));
  }
  const Handle links(H5Pcreate(H5P_LINK_CREATE));
  H5Pset_create_intermediate_group(links.get(), 1);
  // Frames are whole chunks: in HDF5's cache they would later need disk space that was not reserved.
  const Handle access(H5Pcreate(H5P_DATASET_ACCESS));
  if (rank > 1) H5Pset_chunk_cache(access.get(), 0, 0, 1.0);
  return Handle(H5Dcreate2(file, path.c_str(), type, space.get(), links.get(), properties.get(), access.get()));
}

bool write_dataset(hid_t place, const char* name, hid_t type, const Dims& dims, const void* values) {
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE));
  H5Pset_obj_track_times(properties.get(), false);
  const Handle dataset(
      H5Dcreate2(place, name, type, simple_space(dims).get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT));
  return dataset && H5Dwrite(dataset.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0;
}

Result<std::vector<double>> read_doubles(hid_t file, const std::string& path, Expect expect) {
  return read_series<double>(file, path, expect, H5T_NATIVE_DOUBLE);
}

Result<std::vector<std::uint64_t>> read_counts(hid_t file, const std::string& path, Expect expect) {
  return read_series<std::uint64_t>(file, path, expect, H5T_NATIVE_UINT64);
}

}  // namespace bolo::capture::h5
