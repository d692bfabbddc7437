// HDF5 identifiers that close themselves, errors as values, and checked reading of attributes and datasets.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::capture::h5 {

// Owns one identifier of any class (file, dataset, type, property list ...). Thread: any one at a time.
class Handle {
 public:
  Handle() = default;
  explicit Handle(hid_t id) noexcept : id_(id) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)) {}
  Handle& operator=(Handle other) noexcept {
    std::swap(id_, other.id_);
    return *this;
  }
  ~Handle() { close(); }

  hid_t get() const noexcept { return id_; }
  explicit operator bool() const noexcept { return id_ >= 0; }
  // False if closing failed, for example a file's last write. cause() stays that of an earlier failed call.
  bool close() noexcept;

 private:
  hid_t id_ = H5I_INVALID_HID;
};

// False: opening or creating a file would end the process, because HDF5 1.10 does not survive a failed allocation of
// its cache, 600 KB per file. Thread: any.
bool has_memory_for_a_file() noexcept;

// During its lifetime the library does not print its error stack in this thread: errors are returned as values. Declare
// it before the handles of a function, so that their closing is covered. Thread: any.
class Quiet {
 public:
  Quiet() noexcept;
  ~Quiet();
  Quiet(const Quiet&) = delete;
  Quiet& operator=(const Quiet&) = delete;

 private:
  H5E_auto2_t function_ = nullptr;
  void* data_ = nullptr;
};

// The innermost message of this thread's last failed call, in one line; empty if there is none. Thread: any.
std::string cause();

// ": cause()" or nothing, as the end of a message. Thread: any.
std::string because();

// "WHAT cannot be read: cause()", after a failed read: bad input, unless the system refused memory. Thread: any.
tl::unexpected<Error> not_read(const std::string& what);

using Dims = std::vector<hsize_t>;

std::string text(double value);      // shortest form with 9 digits
std::string text(const Dims& dims);  // "(30, 120, 640)", "()" for a scalar
std::string type_text(hid_t type);   // "uint16", "float64", "string" ...
bool is_number(hid_t type);
Status check_numbers(hid_t dataset, const std::string& path);
std::string fixed_string(const char* characters, std::size_t size, hid_t type);  // without its padding
std::optional<std::size_t> product(const Dims& dims);                            // nothing on overflow

// Group or dataset that has attributes; `name` is for messages ("root", "/stimulus").
struct Owner {
  hid_t id = H5I_INVALID_HID;
  std::string name;
};

// Limit of an attribute's size, bytes, in HDF5's oldest file format, which is written.
inline constexpr std::size_t kLongestString = 65'000;

// Attributes: any number or string type, scalar or one element. Errors (kBadInput) name them. Thread: any one at a
// time.
bool has_attribute(const Owner& owner, const std::string& name);
Result<double> number_attribute(const Owner& owner, const std::string& name);  // finite
Result<std::string> string_attribute(const Owner& owner, const std::string& name);

// Fails if the attribute exists already.
bool write_attribute(hid_t owner, const std::string& name, double value);
bool write_attribute(hid_t owner, const std::string& name, std::int64_t value);
bool write_attribute(hid_t owner, const std::string& name, const std::string& value);

// True if every group on the path and the item itself exist. `path` starts with "/". Thread: any one at a time.
bool exists(hid_t file, const std::string& path);

enum class Expect {
  kWhole,  // as much stored data as the shape needs, so that a forged shape cannot make a reader allocate at will
  kPart,   // the end may be missing; the caller checks before it reads
};

// The dataset, checked: a shape, available filters, data as `expect` demands. Thread: any one at a time.
Result<Handle> open_dataset(hid_t file, const std::string& path, Expect expect = Expect::kWhole);
Dims shape(hid_t dataset);

// Limit of rows that are read at once: a sparse file can have more than memory.
inline constexpr std::size_t kMostRowBytes = std::size_t{1} << 30;
Status check_rows(const std::string& path, std::size_t rows, std::size_t row_bytes);

// Reads `count` values along each axis from `start` on. False on failure. Thread: any one at a time.
bool read_block(hid_t dataset, hid_t memory_type, const Dims& start, const Dims& count, void* out);
// Writes `count` rows from row `begin` on; the dataset grows to hold them.
bool write_rows(hid_t dataset, hid_t memory_type, hsize_t begin, hsize_t count, const void* values);

// An empty growing dataset, and groups on its path; `chunk`: shape of its chunks. Thread: any one at a time.
Handle create_growing(hid_t file, const std::string& path, hid_t type, const Dims& chunk, int deflate_level = 0);
// Writes a new dataset in a file or group, with all its values. False on failure. Thread: any one at a time.
bool write_dataset(hid_t place, const char* name, hid_t type, const Dims& dims, const void* values);

// All values of a 1-dimensional dataset of numbers (also of a MATLAB row or column); with Expect::kPart as many as can
// be read. Thread: any one at a time.
Result<std::vector<double>> read_doubles(hid_t file, const std::string& path, Expect expect = Expect::kWhole);
Result<std::vector<std::uint64_t>> read_counts(hid_t file, const std::string& path, Expect expect = Expect::kWhole);

}  // namespace bolo::capture::h5
