// Plain HDF5 calls that create and corrupt files, independent of the code under test.
#pragma once

#include <hdf5.h>

#include "tests/test.hpp"

namespace bolo::capture::testing {

inline void edit(const std::filesystem::path& file, const std::function<void(hid_t)>& change) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  ASSERT_GE(id, 0);
  change(id);
  EXPECT_EQ(H5Fget_obj_count(id, H5F_OBJ_ALL), 1) << "a handle was left open";
  H5Fclose(id);
}

inline void drop_attribute(hid_t file, const char* owner, const char* name) {
  ASSERT_GE(H5Adelete_by_name(file, owner, name, H5P_DEFAULT), 0) << name;
}

// Writes an attribute of `type` from `value` in `memory_type`, replacing one of that name. Empty dims: a scalar.
inline void set_attribute(hid_t file, const char* owner, const char* name, hid_t type, hid_t memory_type,
                          const void* value, const std::vector<hsize_t>& dims = {}) {
  if (H5Aexists_by_name(file, owner, name, H5P_DEFAULT) > 0) drop_attribute(file, owner, name);
  const hid_t space =
      dims.empty() ? H5Screate(H5S_SCALAR) : H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr);
  const hid_t id = H5Acreate_by_name(file, owner, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  ASSERT_GE(id, 0) << name;
  ASSERT_GE(H5Awrite(id, memory_type, value), 0) << name;
  H5Aclose(id);
  H5Sclose(space);
}

inline void set_number(hid_t file, const char* owner, const char* name, double value, hid_t type = H5T_NATIVE_DOUBLE) {
  set_attribute(file, owner, name, type, H5T_NATIVE_DOUBLE, &value);
}

inline void set_string(hid_t file, const char* owner, const char* name, const std::string& value,
                       H5T_str_t padding = H5T_STR_NULLTERM) {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, value.size() + 3);
  H5Tset_strpad(type, padding);
  std::string stored = value;
  stored.resize(value.size() + 3, padding == H5T_STR_SPACEPAD ? ' ' : '\0');
  set_attribute(file, owner, name, type, type, stored.data());
  H5Tclose(type);
}

// A UTF-8 string of variable length, as h5py writes strings.
inline void set_variable_string(hid_t file, const char* owner, const char* name, const char* value,
                                const std::vector<hsize_t>& dims = {}) {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  set_attribute(file, owner, name, type, type, &value, dims);
  H5Tclose(type);
}

inline void drop(hid_t file, const char* path) { ASSERT_GE(H5Ldelete(file, path, H5P_DEFAULT), 0) << path; }

inline void add_group(hid_t file, const char* path) { H5Gclose(H5Gcreate2(file, path, 0, 0, 0)); }

// Writes a dataset of `type` from values of `memory_type`, replacing one of that name. Empty `chunk`: contiguous.
inline void set_dataset(hid_t file, const char* path, hid_t type, const std::vector<hsize_t>& dims, hid_t memory_type,
                        const void* values, const std::vector<hsize_t>& chunk = {}, unsigned deflate = 0) {
  if (H5Lexists(file, path, H5P_DEFAULT) > 0) drop(file, path);
  const hid_t space = H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  if (!chunk.empty()) H5Pset_chunk(properties, static_cast<int>(chunk.size()), chunk.data());
  if (deflate > 0) H5Pset_deflate(properties, deflate);
  const hid_t id = H5Dcreate2(file, path, type, space, H5P_DEFAULT, properties, H5P_DEFAULT);
  ASSERT_GE(id, 0) << path;
  const bool written = values == nullptr || H5Dwrite(id, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0;
  ASSERT_TRUE(written) << path;
  H5Dclose(id);
  H5Pclose(properties);
  H5Sclose(space);
}

inline void set_doubles(hid_t file, const char* path, const std::vector<double>& values,
                        hid_t type = H5T_NATIVE_DOUBLE) {
  set_dataset(file, path, type, {values.size()}, H5T_NATIVE_DOUBLE, values.data());
}

// Row type of /events: seconds, then a kind of `letters` characters or of variable length. The caller closes it.
inline hid_t event_type(std::size_t letters, std::size_t row_bytes) {
  const hid_t text = H5Tcopy(H5T_C_S1);
  H5Tset_size(text, letters);
  if (letters == H5T_VARIABLE) H5Tset_cset(text, H5T_CSET_UTF8);
  const hid_t type = H5Tcreate(H5T_COMPOUND, row_bytes);
  H5Tinsert(type, "t", 0, H5T_NATIVE_DOUBLE);
  H5Tinsert(type, "kind", sizeof(double), text);
  H5Tclose(text);
  return type;
}
inline void set_events(hid_t file, std::size_t letters, std::size_t row_bytes, hsize_t count, const void* rows) {
  const hid_t type = event_type(letters, row_bytes);
  set_dataset(file, "/events", type, {count}, type, rows);
  H5Tclose(type);
}

// Changes of an open file for edit(); attributes are those of the root.
using Change = std::function<void(hid_t)>;
inline auto without(const char* name) {
  return [name](hid_t f) { drop_attribute(f, "/", name); };
}
inline auto with(const char* name, double value, hid_t type = H5T_NATIVE_DOUBLE) {
  return [=](hid_t f) { set_number(f, "/", name, value, type); };
}
inline auto with_text(const char* name, const char* value, H5T_str_t padding = H5T_STR_NULLTERM) {
  return [=](hid_t f) { set_string(f, "/", name, value, padding); };
}
inline auto without_item(const char* path) {
  return [path](hid_t f) { drop(f, path); };
}
// `values` first, the rest 0.
inline auto with_dataset(const char* path, hid_t type, std::vector<hsize_t> dims, std::vector<double> values = {}) {
  std::size_t size = 1;
  for (const hsize_t one : dims) size *= one;
  values.resize(size);
  return [=](hid_t f) { set_dataset(f, path, type, dims, H5T_NATIVE_DOUBLE, values.data()); };
}
inline auto with_doubles(const char* path, std::vector<double> values, hid_t type = H5T_NATIVE_DOUBLE) {
  return [=](hid_t f) { set_doubles(f, path, values, type); };
}

}  // namespace bolo::capture::testing
