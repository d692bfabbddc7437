#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "src/capture/contents.hpp"

namespace bolo::capture {
namespace {

const std::string kPath = "/events";
constexpr hsize_t kChunk = 16;
constexpr std::size_t kLongestStoredKind = std::size_t{1} << 16;

struct FixedRow {
  double t_s;
  std::array<char, kLongestEventKind + 1> kind;
};

struct VariableRow {
  double t_s;
  char* kind;
};

h5::Handle row_type(hid_t kind_type, std::size_t size, std::size_t kind_offset) {
  h5::Handle type(H5Tcreate(H5T_COMPOUND, size));
  H5Tinsert(type.get(), "t", 0, H5T_NATIVE_DOUBLE);
  H5Tinsert(type.get(), "kind", kind_offset, kind_type);
  return type;
}

h5::Handle kind_of_fixed_length() {
  h5::Handle type(H5Tcopy(H5T_C_S1));
  H5Tset_size(type.get(), kLongestEventKind + 1);
  H5Tset_cset(type.get(), H5T_CSET_UTF8);
  return type;
}

h5::Handle member_type(hid_t compound, const char* name) {
  const int index = H5Tget_member_index(compound, name);
  return index < 0 ? h5::Handle() : h5::Handle(H5Tget_member_type(compound, static_cast<unsigned>(index)));
}

// HDF5 1.10 does not check this.
bool member_inside(hid_t compound, const char* name) {
  const int index = H5Tget_member_index(compound, name);
  const std::size_t offset = H5Tget_member_offset(compound, static_cast<unsigned>(index));
  const std::size_t size = H5Tget_size(member_type(compound, name).get());
  const std::size_t row = H5Tget_size(compound);
  return size <= row && offset <= row - size;
}

Status unreadable() { return bad_input(kPath + " cannot be read" + h5::because()); }

Status read_variable(hid_t dataset, hid_t kind_type, std::vector<Event>& events) {
  std::vector<VariableRow> rows(events.size());
  const h5::Handle type = row_type(kind_type, sizeof(VariableRow), offsetof(VariableRow, kind));
  if (H5Dread(dataset, type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, rows.data()) < 0) return unreadable();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    events[i] = {rows[i].t_s, rows[i].kind == nullptr ? "" : rows[i].kind};
  }
  const h5::Handle space(H5Dget_space(dataset));
  H5Dvlen_reclaim(type.get(), space.get(), H5P_DEFAULT, rows.data());
  return {};
}

Status read_fixed(hid_t dataset, hid_t kind_type, std::vector<Event>& events) {
  const std::size_t length = H5Tget_size(kind_type);
  const std::size_t stride = sizeof(double) + length;
  std::vector<char> rows(events.size() * stride);
  const h5::Handle type = row_type(kind_type, stride, sizeof(double));
  if (H5Dread(dataset, type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, rows.data()) < 0) return unreadable();
  for (std::size_t i = 0; i < events.size(); ++i) {
    const char* row = rows.data() + i * stride;
    std::memcpy(&events[i].t_s, row, sizeof(double));
    const char* kind = row + sizeof(double);
    events[i].kind = h5::fixed_string(kind, length, kind_type);
  }
  return {};
}

}  // namespace

Result<std::vector<Event>> read_events(hid_t file) {
  if (!h5::exists(file, kPath)) return std::vector<Event>{};
  ASSIGN_OR_RETURN(const h5::Handle dataset, h5::open_dataset(file, kPath));
  const h5::Handle type(H5Dget_type(dataset.get()));
  if (H5Tget_class(type.get()) != H5T_COMPOUND) {
    return bad_input(kPath + " is of type " + h5::type_text(type.get()) +
                     "; expected compound (t float64, kind string)");
  }
  const h5::Handle time = member_type(type.get(), "t");
  const h5::Handle kind = member_type(type.get(), "kind");
  if (!time || !h5::is_number(time.get()))
    return bad_input(kPath + " has no number member 't'; expected compound (t float64, kind string)");
  if (!kind || H5Tget_class(kind.get()) != H5T_STRING) {
    return bad_input(kPath + " has no string member 'kind'; expected compound (t float64, kind string)");
  }
  if (!member_inside(type.get(), "t") || !member_inside(type.get(), "kind")) {
    return bad_input(kPath + ": a member lies outside its row; the file is damaged");
  }
  if (H5Tget_size(kind.get()) > kLongestStoredKind) return bad_input(kPath + ": its kinds are longer than 64 KiB");
  const h5::Dims dims = h5::shape(dataset.get());
  if (dims.size() != 1) return bad_input(kPath + " has the shape " + h5::text(dims) + "; expected one dimension");
  RETURN_IF_ERROR(h5::check_rows(kPath, dims[0], sizeof(Event) + H5Tget_size(type.get())));

  std::vector<Event> events(dims[0]);
  if (events.empty()) return events;
  RETURN_IF_ERROR(H5Tis_variable_str(kind.get()) > 0 ? read_variable(dataset.get(), kind.get(), events)
                                                     : read_fixed(dataset.get(), kind.get(), events));
  for (std::size_t i = 0; i < events.size(); ++i) {
    events[i].kind.resize(std::min(events[i].kind.size(), kLongestEventKind));
    if (std::abs(events[i].t_s) <= kLastTime_s) continue;
    return bad_input(kPath + ": the time of event " + std::to_string(i) + " is not finite, or beyond " +
                     h5::text(kLastTime_s) + " s");
  }
  std::erase_if(events, [](const Event& event) { return event.kind.empty(); });
  return events;
}

bool append_events(hid_t file, const std::vector<Event>& events) {
  const h5::Handle kind = kind_of_fixed_length();
  const h5::Handle type = row_type(kind.get(), sizeof(FixedRow), offsetof(FixedRow, kind));
  const h5::Handle dataset(h5::exists(file, kPath) ? h5::Handle(H5Dopen2(file, kPath.c_str(), H5P_DEFAULT))
                                                   : h5::create_growing(file, kPath, type.get(), {kChunk}));
  if (!dataset) return false;
  std::vector<FixedRow> rows(events.size());
  for (std::size_t i = 0; i < events.size(); ++i) {
    rows[i].t_s = events[i].t_s;
    events[i].kind.copy(rows[i].kind.data(), kLongestEventKind);
  }
  return h5::write_rows(dataset.get(), type.get(), h5::shape(dataset.get()).at(0), rows.size(), rows.data());
}

}  // namespace bolo::capture
