#include <algorithm>
#include <cmath>

#include "src/capture/capture.hpp"
#include "src/capture/contents.hpp"
#include "src/capture/open_file.hpp"
#include "src/capture/stimulus_io.hpp"

namespace bolo::capture {
namespace {

constexpr double kMostPlaces = 1 << 20;  // columns or rows of any camera

}  // namespace

struct CaptureReader::Impl {
  std::string name;
  h5::Handle file;  // closed last: the stores hold datasets in it
  Contents contents;
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
  Result<h5::Handle> handle = open_hdf5(file, trust == Trust::kDamaged ? FileUse::kSalvage : FileUse::kRead);
  if (!handle) return at(file.string(), std::move(handle.error()));
  Result<Contents> contents = looks_like_matlab_capture(handle->get()) ? read_matlab_capture(handle->get())
                                                                       : read_bolo_capture(handle->get(), trust);
  if (!contents) return at(file.string(), std::move(contents.error()));
  return CaptureReader(std::make_unique<Impl>(Impl{file.string(), std::move(*handle), std::move(*contents)}));
}

const CaptureInfo& CaptureReader::info() const noexcept { return impl_->contents.info; }
FileFormat CaptureReader::file_format() const noexcept { return impl_->contents.file_format; }
const std::vector<double>& CaptureReader::t() const noexcept { return impl_->contents.t; }
const std::vector<std::uint64_t>& CaptureReader::frame_id() const noexcept { return impl_->contents.frame_id; }
const std::vector<Event>& CaptureReader::events() const noexcept { return impl_->contents.events; }
const std::vector<std::string>& CaptureReader::warnings() const noexcept { return impl_->contents.warnings; }
Result<Stimulus> CaptureReader::stimulus() const {
  const Result<Stimulus>& stimulus = impl_->contents.stimulus;
  return stimulus ? stimulus : at(impl_->name, stimulus.error());
}

Result<std::vector<Attribute>> CaptureReader::attributes() const {
  const h5::Quiet quiet;
  return other_attributes(impl_->file.get());
}

Result<std::vector<Point>> CaptureReader::points() const {
  const h5::Quiet quiet;
  std::vector<Point> points;
  if (!h5::exists(impl_->file.get(), "/points")) return points;
  const Result<std::vector<double>> x = h5::read_doubles(impl_->file.get(), "/points/x");
  if (!x) return at(impl_->name, x.error());
  const Result<std::vector<double>> y = h5::read_doubles(impl_->file.get(), "/points/y");
  if (!y) return at(impl_->name, y.error());
  const std::size_t pixels = impl_->contents.info.format.geometry.pixels();
  if (x->size() != pixels || y->size() != pixels) {
    return bad_input(impl_->name + ": /points has " + std::to_string(x->size()) + " x and " +
                     std::to_string(y->size()) + " y for frames of " + std::to_string(pixels) + " pixels");
  }
  const auto off = [](double v) { return !(v >= 0.0 && v < kMostPlaces); };
  if (std::any_of(x->begin(), x->end(), off) || std::any_of(y->begin(), y->end(), off)) {
    return bad_input(impl_->name + ": /points has values that are no column or row");
  }
  for (std::size_t i = 0; i < pixels; ++i) points.push_back({static_cast<int>((*x)[i]), static_cast<int>((*y)[i])});
  return points;
}

Status CaptureReader::read_frame(std::size_t index, void* out) const {
  const h5::Quiet quiet;
  Status status = impl_->contents.frames->read(index, out);
  if (!status) return at(impl_->name, std::move(status.error()));
  return status;
}

Status CaptureReader::read_truth(std::size_t index, float* out) const {
  const h5::Quiet quiet;
  if (!impl_->contents.truth) return bad_input(impl_->name + ": there is no /truth/frames in this capture");
  Status status = impl_->contents.truth->read(index, out);
  if (!status) return at(impl_->name, std::move(status.error()));
  return status;
}

Status CaptureReader::read_motion(std::size_t index, BlockMotion* out) const {
  const h5::Quiet quiet;
  if (!impl_->contents.motion) return bad_input(impl_->name + ": there is no /motion in this capture");
  Status status = impl_->contents.motion->read(index, out);
  if (!status) return at(impl_->name, std::move(status.error()));
  return status;
}

Result<StillImage> read_still(const std::filesystem::path& file) {
  const h5::Quiet quiet;
  const Result<h5::Handle> handle = open_hdf5(file);
  if (!handle) return at(file.string(), handle.error());
  Result<Image> image = read_image(handle->get(), "/image_k");
  if (!image) return at(file.string(), std::move(image.error()));
  for (std::size_t i = 0; i < image->values.size(); ++i) {
    if (std::isfinite(image->values[i])) continue;
    const auto width = static_cast<std::size_t>(image->width);
    return bad_input(file.string() + ": /image_k: the value at column " + std::to_string(i % width) + ", row " +
                     std::to_string(i / width) + " is not finite");
  }
  return StillImage{image->width, image->height, std::move(image->values)};
}

}  // namespace bolo::capture
