#include "tools/verbs/deblur_sink.hpp"

#include <cmath>
#include <system_error>
#include <utility>

namespace bolo::tools {
namespace {

std::filesystem::path part_of(std::filesystem::path file) { return file += ".part"; }

// float32 holds kelvin itself; anything else keeps the input's meaning.
LinearScale scale_of(const LinearScale& input, PixelType output) {
  if (input.unit == Unit::kKelvin && output == PixelType::kFloat32) return {Unit::kKelvin, 1.0, 0.0};
  return input;
}

double value_at(PixelType type, const void* plane, std::size_t i) {
  return type == PixelType::kUint16 ? static_cast<double>(static_cast<const std::uint16_t*>(plane)[i])
                                    : static_cast<double>(static_cast<const float*>(plane)[i]);
}

// The sum over a plane of (value - truth)^2, K^2.
double square_error(PixelType type, const LinearScale& scale, const void* plane, const std::vector<float>& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const double error = scale.to_physical(value_at(type, plane, i)) - static_cast<double>(truth[i]);
    sum += error * error;
  }
  return sum;
}

// What the chosen pixels see. Through a region the still's pixel (0, 0) is another one of the frame; points have no
// picture, only what is the same everywhere.
capture::Stimulus seen_through(capture::Stimulus stimulus, const PixelChoice& choice) {
  const bool picture =
      std::holds_alternative<capture::SceneStimulus>(stimulus) || std::holds_alternative<capture::BarTarget>(stimulus);
  if (!choice.points().empty() && picture) return capture::NoStimulus{};
  const Region& region = choice.region();
  if (auto* scene = std::get_if<capture::SceneStimulus>(&stimulus)) {
    for (double& x : scene->x_px) x += region.x;
    for (double& y : scene->y_px) y += region.y;
  }
  return stimulus;
}

}  // namespace

DeblurSink::DeblurSink(std::filesystem::path input_file, capture::CaptureReader input, std::filesystem::path output,
                       PixelChoice choice)
    : input_file_(std::move(input_file)),
      input_(std::move(input)),
      output_(std::move(output)),
      choice_(std::move(choice)),
      progress_("deblur", input_.info().frames) {}

DeblurSink::~DeblurSink() {
  if (!writer_ || finished_) return;
  writer_.reset();
  std::error_code ignored;
  std::filesystem::remove(part_of(output_), ignored);
}

Status DeblurSink::open(const pipeline::SinkFormat& format) {
  format_ = format;
  const StreamFormat& in = format.source.format;
  output_scale_ = scale_of(in.scale, format.deblurred_type);
  capture::CaptureInfo info = input_.info();
  info.format = in;
  info.format.geometry = choice_.geometry();
  info.format.type = format.deblurred_type;
  info.format.scale = output_scale_;
  if (info.has_truth) {
    truth_.resize(info.format.geometry.pixels());
    whole_truth_.resize(in.geometry.pixels());
  }
  raw_.resize(plane_bytes(info.format.geometry, in.type));
  deblurred_.resize(plane_bytes(info.format.geometry, format.deblurred_type));
  auto writer = capture::CaptureWriter::create(output_, info, {.truth = info.has_truth});
  if (!writer) return tl::unexpected(writer.error());
  writer_.emplace(std::move(*writer));
  if (choice_.points().empty()) return {};
  std::vector<capture::Point> points;
  for (std::size_t i = 0; i < choice_.points().size(); ++i) points.push_back({choice_.x_of(i), choice_.y_of(i)});
  return writer_->write_points(points);
}

void DeblurSink::publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& /*stats*/) noexcept {
  progress_.update(++frames_in_);
  if (status_) status_ = take(frame);
  if (!status_ || interrupted().load(std::memory_order_relaxed)) {
    stop_requested_.store(true, std::memory_order_relaxed);
  }
}

Status DeblurSink::take(const pipeline::PublishedFrame& frame) {
  choice_.take(frame.raw, bytes_of(format_.source.format.type), raw_.data());
  if (Status status = refuse_nan(frame); !status) return status;
  if ((frame.meta.flags & kFlagWarmUp) != 0) return {};
  const std::vector<std::uint64_t>& ids = input_.frame_id();
  while (index_ < ids.size() && ids[index_] != frame.meta.frame_id) ++index_;
  choice_.take_deblurred(frame.deblurred, bytes_of(format_.deblurred_type), deblurred_.data());
  if (!truth_.empty()) {
    if (Status status = read_truth(index_); !status) return status;
    judge();
  }
  ++frames_out_;
  return writer_->append(input_.t()[index_], frame.meta.frame_id, deblurred_.data(),
                         truth_.empty() ? nullptr : truth_.data());
}

Status DeblurSink::refuse_nan(const pipeline::PublishedFrame& frame) const {
  if (format_.source.format.type != PixelType::kFloat32) return {};
  const auto* values = reinterpret_cast<const float*>(raw_.data());
  for (std::size_t i = 0; i < raw_.size() / sizeof(float); ++i) {
    if (std::isfinite(values[i])) continue;
    return bad_input(input_file_.string() + ": frame " + std::to_string(frame.meta.frame_id) + ", column " +
                     std::to_string(choice_.x_of(i)) + ", row " + std::to_string(choice_.y_of(i)) + " of /frames is " +
                     std::to_string(values[i]) + "; replace such pixels, or leave them out with --roi");
  }
  return {};
}

Status DeblurSink::read_truth(std::size_t index) {
  if (Status status = input_.read_truth(index, whole_truth_.data()); !status) return status;
  choice_.take(whole_truth_.data(), sizeof(float), truth_.data());
  return {};
}

void DeblurSink::judge() {
  const StreamFormat& in = format_.source.format;
  blurred_square_ += square_error(in.type, in.scale, raw_.data(), truth_);
  deblurred_square_ += square_error(format_.deblurred_type, output_scale_, deblurred_.data(), truth_);
}

std::optional<Rmse> DeblurSink::rmse() const {
  if (truth_.empty() || frames_out_ == 0 || output_scale_.unit != Unit::kKelvin) return std::nullopt;
  const double values = static_cast<double>(frames_out_) * static_cast<double>(truth_.size());
  return Rmse{std::sqrt(blurred_square_ / values), std::sqrt(deblurred_square_ / values)};
}

Status DeblurSink::finish(std::string_view isa, const std::vector<std::pair<std::string, std::string>>& files) {
  auto whole = input_.stimulus();
  if (!whole) return tl::unexpected(whole.error());
  const capture::Stimulus stimulus = seen_through(std::move(*whole), choice_);
  Status status;
  const auto then = [&status](auto&& step) {
    if (status) status = step();
  };
  const auto number = [&](const char* name, double value) {
    then([&] { return writer_->write_attribute(name, value); });
  };
  const auto text = [&](const char* name, std::string_view value) {
    then([&] { return writer_->write_attribute(name, std::string(value)); });
  };
  const deblur::Settings& settings = format_.deblur;
  if (!std::holds_alternative<capture::NoStimulus>(stimulus)) {
    then([&] { return writer_->write_stimulus(stimulus); });
  }
  for (const capture::Event& event : input_.events()) then([&] { return writer_->add_event(event); });
  text("solver", deblur::name(settings.method));
  text("isa", isa);
  if (choice_.points().empty()) text("roi", in_words(choice_.region()));
  for (const auto& [name, value] : files) text(name.c_str(), value);
  number("tau_s", settings.tau_s);
  number("kappa", settings.kappa);
  number("lambda", settings.lambda);
  number("iterations", settings.iterations);
  number("window", settings.window);
  number("levels", settings.levels);
  number("lookahead", settings.lookahead);
  then([&] { return writer_->close(); });
  finished_ = status.has_value();
  return status;
}

}  // namespace bolo::tools
