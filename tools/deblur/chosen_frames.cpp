#include "tools/deblur/chosen_frames.hpp"

#include <cmath>
#include <cstdint>
#include <string>

#include <fmt/format.h>

namespace bolo::tools {
namespace {

// float32 holds kelvin itself; anything else keeps the input's meaning.
LinearScale scale_of(const LinearScale& input, PixelType output) {
  if (input.unit == Unit::kKelvin && output == PixelType::kFloat32) return {Unit::kKelvin, 1.0, 0.0};
  return input;
}

double value_at(PixelType type, const void* plane, std::size_t i) {
  return type == PixelType::kUint16 ? static_cast<double>(static_cast<const std::uint16_t*>(plane)[i])
                                    : static_cast<double>(static_cast<const float*>(plane)[i]);
}

double square_error(PixelType type, const LinearScale& scale, const void* plane, const std::vector<float>& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const double error = scale.to_physical(value_at(type, plane, i)) - static_cast<double>(truth[i]);
    sum += error * error;
  }
  return sum;
}

}  // namespace

ChosenFrames::ChosenFrames(std::filesystem::path input_file, capture::CaptureReader input, PixelChoice choice)
    : input_file_(std::move(input_file)), input_(std::move(input)), choice_(std::move(choice)) {}

void ChosenFrames::open(const pipeline::SinkFormat& format) {
  format_ = format;
  const StreamFormat& in = format.source.format;
  written_ = input_.info();
  written_.format = in;
  written_.format.geometry = choice_.geometry();
  written_.format.type = format.deblurred_type;
  written_.format.scale = scale_of(in.scale, format.deblurred_type);
  if (written_.has_truth) {
    truth_.resize(written_.format.geometry.pixels());
    whole_truth_.resize(in.geometry.pixels());
  }
  raw_.resize(plane_bytes(written_.format.geometry, in.type));
  deblurred_.resize(plane_bytes(written_.format.geometry, format.deblurred_type));
}

Status ChosenFrames::take(const pipeline::PublishedFrame& frame) {
  choice_.take(frame.raw, bytes_of(format_.source.format.type), raw_.data());
  if (Status status = refuse_nan(frame); !status) return status;
  const std::vector<std::uint64_t>& ids = input_.frame_id();
  while (index_ < ids.size() && ids[index_] != frame.meta.frame_id) ++index_;
  sharp_ = (frame.meta.flags & kFlagWarmUp) == 0;
  if (sharp_) choice_.take_deblurred(frame.deblurred, bytes_of(format_.deblurred_type), deblurred_.data());
  return {};
}

Status ChosenFrames::refuse_nan(const pipeline::PublishedFrame& frame) const {
  if (format_.source.format.type != PixelType::kFloat32) return {};
  const auto* values = reinterpret_cast<const float*>(raw_.data());
  for (std::size_t i = 0; i < raw_.size() / sizeof(float); ++i) {
    if (std::isfinite(values[i])) continue;
    return bad_input(fmt::format(
        "{}: frame {}, column {}, row {} of /frames is {:f}; replace such pixels, or leave them out with --roi",
        input_file_.string(), frame.meta.frame_id, choice_.x_of(i), choice_.y_of(i), values[i]));
  }
  return {};
}

Result<const float*> ChosenFrames::truth(std::size_t index) {
  if (truth_.empty()) return nullptr;
  if (truth_of_ == index) return truth_.data();
  if (Status status = input_.read_truth(index, whole_truth_.data()); !status) return tl::unexpected(status.error());
  choice_.take(whole_truth_.data(), sizeof(float), truth_.data());
  truth_of_ = index;
  return truth_.data();
}

Result<SquareErrors> ChosenFrames::errors() {
  if (truth_.empty()) return SquareErrors{};
  const auto truth = this->truth(index_);
  if (!truth) return tl::unexpected(truth.error());
  const StreamFormat& in = format_.source.format;
  return SquareErrors{square_error(in.type, in.scale, raw_.data(), truth_),
                      square_error(written_.format.type, written_.format.scale, deblurred_.data(), truth_)};
}

}  // namespace bolo::tools
