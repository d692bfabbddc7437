#include <cmath>

#include "bolo/capture/capture.hpp"
#include "src/capture/contents.hpp"
#include "src/capture/open_file.hpp"
#include "src/capture/stimulus_io.hpp"

namespace bolo::capture {

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
  const h5::Quiet quiet;
  Result<h5::Handle> handle = open_hdf5(file);
  if (!handle) return at(file.string(), std::move(handle.error()));
  const bool unfinished = file.extension() == ".part";
  Result<Contents> contents = looks_like_matlab_capture(handle->get()) ? read_matlab_capture(handle->get())
                                                                       : read_bolo_capture(handle->get(), unfinished);
  if (!contents) return at(file.string(), std::move(contents.error()));
  return CaptureReader(std::make_unique<Impl>(Impl{file.string(), std::move(*handle), std::move(*contents)}));
}

const CaptureInfo& CaptureReader::info() const noexcept { return impl_->contents.info; }
FileFormat CaptureReader::file_format() const noexcept { return impl_->contents.file_format; }
const std::vector<double>& CaptureReader::t() const noexcept { return impl_->contents.t; }
const std::vector<std::uint64_t>& CaptureReader::frame_id() const noexcept { return impl_->contents.frame_id; }
const std::vector<Event>& CaptureReader::events() const noexcept { return impl_->contents.events; }
const std::vector<std::string>& CaptureReader::warnings() const noexcept { return impl_->contents.warnings; }
Result<Stimulus> CaptureReader::stimulus() const { return impl_->contents.stimulus; }

Result<std::vector<Attribute>> CaptureReader::attributes() const {
  const h5::Quiet quiet;
  return other_attributes(impl_->file.get());
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
