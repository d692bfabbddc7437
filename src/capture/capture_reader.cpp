#include <algorithm>
#include <cmath>

#include "src/capture/capture.hpp"
#include "src/capture/contents.hpp"
#include "src/capture/h5_driver.hpp"

namespace bolo::capture {
namespace {

constexpr double kMostPlaces = 1 << 20;  // columns or rows of any camera

// MATLAB files have no frame counter: whole periods missing in t are lost frames.
std::vector<std::uint64_t> ids_from_times(const std::vector<double>& t, double period_s) {
  constexpr double kMostPeriods = 1e15;  // keeps the rounding in range, whatever t contains
  std::vector<std::uint64_t> id(t.size());
  for (std::size_t i = 1; i < t.size(); ++i) {
    const double periods = std::clamp(std::round((t[i] - t[i - 1]) / period_s), 1.0, kMostPeriods);
    id[i] = id[i - 1] + static_cast<std::uint64_t>(periods);
  }
  return id;
}

// The authors' `.mat` version 7.3 (HDF5 after 512 bytes of MATLAB's own): in MATLAB `t` is 1 x n (s), `frames` n x
// width x height (kelvin); HDF5 lists dimensions in reverse, so `/frames` is (height, width, n) here.
bool is_matlab_capture(hid_t file) {
  const h5::Handle group(H5Gopen2(file, "/", H5P_DEFAULT));
  return !h5::has_attribute({group.get(), "root"}, "format") && !h5::exists(file, "/frame_id") &&
         h5::exists(file, "/frames") && h5::exists(file, "/t");
}

Result<Contents> read_matlab_capture(hid_t file) {
  Contents contents;
  contents.file_format = FileFormat::kMatlab;
  ASSIGN_OR_RETURN(FrameStore frames, FrameStore::open(file, "/frames", FrameOrder::kMatlab));
  ASSIGN_OR_RETURN(std::vector<double> t, h5::read_doubles(file, "/t"));
  if (t.size() != frames.frames()) {
    return bad_input("t has " + std::to_string(t.size()) +
                     " values but frames, in MATLAB's order n x width x height, is " + std::to_string(frames.frames()) +
                     " x " + std::to_string(frames.geometry().width) + " x " +
                     std::to_string(frames.geometry().height));
  }
  if (t.size() < 2) return bad_input("t has a single value; the frame period needs at least two frames");
  RETURN_IF_ERROR(check_times(t));

  const double period_s = median_step(t);
  contents.info.format = {frames.geometry(), frames.type(), LinearScale{Unit::kKelvin, 1.0, 0.0}, period_s, 1};
  contents.info.frames = frames.frames();
  contents.frame_id = ids_from_times(t, period_s);
  contents.t = std::move(t);
  contents.frames = std::move(frames);
  check_plausible(contents);
  return contents;
}

}  // namespace

struct CaptureReader::Impl {
  std::string name;
  h5::Handle file;  // closed last: the stores hold its datasets
  Contents contents;
  Trust trust;

  Status check_whole() const { return trust == Trust::kDamaged ? Status{} : at(name, check_reads(file.get())); }
  Status read(std::optional<FrameStore>& planes, const char* path, std::size_t index, void* out) {
    const h5::Quiet quiet;
    if (!planes) return bad_input(name + ": there is no " + path + " in this capture");
    return at(name, planes->read(index, out));
  }
};

CaptureReader::CaptureReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CaptureReader::CaptureReader(CaptureReader&&) noexcept = default;
CaptureReader& CaptureReader::operator=(CaptureReader&&) noexcept = default;

CaptureReader::~CaptureReader() {
  const h5::Quiet quiet;
  impl_.reset();
}

Result<CaptureReader> CaptureReader::open(const std::filesystem::path& file) {
  return open_as(file, file.extension() == ".part" ? Trust::kUnfinished : Trust::kWhole);
}

Result<CaptureReader> CaptureReader::salvage(const std::filesystem::path& file) {
  return open_as(file, Trust::kDamaged);
}

Result<CaptureReader> CaptureReader::open_as(const std::filesystem::path& file, Trust trust) {
  const h5::Quiet quiet;
  ASSIGN_OR_RETURN(h5::Handle handle, at(file.string(), open_hdf5(file, trust == Trust::kDamaged)));
  ASSIGN_OR_RETURN(Contents contents,
                   at(file.string(), is_matlab_capture(handle.get()) ? read_matlab_capture(handle.get())
                                                                     : read_bolo_capture(handle.get(), trust)));
  if (Status whole = check_reads(handle.get()); !whole) {
    if (trust != Trust::kDamaged) return at(file.string(), std::move(whole.error()));
    contents.warnings.push_back(whole.error().message);
  }
  return CaptureReader(std::make_unique<Impl>(Impl{file.string(), std::move(handle), std::move(contents), trust}));
}

const CaptureInfo& CaptureReader::info() const noexcept { return impl_->contents.info; }
FileFormat CaptureReader::file_format() const noexcept { return impl_->contents.file_format; }
const std::vector<double>& CaptureReader::t() const noexcept { return impl_->contents.t; }
const std::vector<std::uint64_t>& CaptureReader::frame_id() const noexcept { return impl_->contents.frame_id; }
const std::vector<double>& CaptureReader::t_host() const noexcept { return impl_->contents.t_host; }
const std::vector<double>& CaptureReader::t_utc() const noexcept { return impl_->contents.t_utc; }
const std::vector<Event>& CaptureReader::events() const noexcept { return impl_->contents.events; }
const std::vector<std::string>& CaptureReader::warnings() const noexcept { return impl_->contents.warnings; }
Result<Stimulus> CaptureReader::stimulus() const {
  const Result<Stimulus>& read = impl_->contents.stimulus;
  if (!read) return at(impl_->name, read.error());
  return *read;  // copying the Result itself is noexcept: lack of memory would end the process
}

Result<std::vector<Attribute>> CaptureReader::attributes() const {
  const h5::Quiet quiet;
  auto attributes = other_attributes(impl_->file.get());
  RETURN_IF_ERROR(impl_->check_whole());
  return attributes;
}

Result<std::vector<Point>> CaptureReader::points() const {
  const h5::Quiet quiet;
  std::vector<Point> points;
  if (!h5::exists(impl_->file.get(), "/points")) {
    RETURN_IF_ERROR(impl_->check_whole());
    return points;
  }
  ASSIGN_OR_RETURN(const std::vector<double> x, at(impl_->name, h5::read_doubles(impl_->file.get(), "/points/x")));
  ASSIGN_OR_RETURN(const std::vector<double> y, at(impl_->name, h5::read_doubles(impl_->file.get(), "/points/y")));
  const std::size_t pixels = impl_->contents.info.format.geometry.pixels();
  if (x.size() != pixels || y.size() != pixels) {
    return bad_input(impl_->name + ": /points has " + std::to_string(x.size()) + " x and " + std::to_string(y.size()) +
                     " y for frames of " + std::to_string(pixels) + " pixels");
  }
  const auto off = [](double v) { return !(v >= 0.0 && v < kMostPlaces); };
  if (std::any_of(x.begin(), x.end(), off) || std::any_of(y.begin(), y.end(), off)) {
    return bad_input(impl_->name + ": /points has values that are no column or row");
  }
  for (std::size_t i = 0; i < pixels; ++i) points.push_back({static_cast<int>(x[i]), static_cast<int>(y[i])});
  return points;
}

Status CaptureReader::read_frame(std::size_t index, void* out) const {
  return impl_->read(impl_->contents.frames, "/frames", index, out);
}

Status CaptureReader::read_truth(std::size_t index, float* out) const {
  return impl_->read(impl_->contents.truth, "/truth/frames", index, out);
}

Status CaptureReader::read_motion(std::size_t index, BlockMotion* out) const {
  return impl_->read(impl_->contents.motion, "/motion", index, out);
}

Result<StillImage> read_still(const std::filesystem::path& file) {
  const h5::Quiet quiet;
  ASSIGN_OR_RETURN(const h5::Handle handle, at(file.string(), open_hdf5(file)));
  ASSIGN_OR_RETURN(StillImage image, at(file.string(), read_image(handle.get(), "/image_k")));
  for (std::size_t i = 0; i < image.kelvin.size(); ++i) {
    if (std::isfinite(image.kelvin[i])) continue;
    const auto width = static_cast<std::size_t>(image.width);
    return bad_input(file.string() + ": /image_k: the value at column " + std::to_string(i % width) + ", row " +
                     std::to_string(i / width) + " is not finite");
  }
  return image;
}

}  // namespace bolo::capture
