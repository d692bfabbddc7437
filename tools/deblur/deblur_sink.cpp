#include "tools/deblur/deblur_sink.hpp"

#include <cmath>
#include <system_error>
#include <utility>

namespace bolo::tools {
namespace {

std::filesystem::path part_of(std::filesystem::path file) { return file += ".part"; }

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

DeblurSink::DeblurSink(ChosenFrames frames, OutputFile output, Beat beat)
    : frames_(std::move(frames)), output_(std::move(output)), beat_(std::move(beat)) {}

DeblurSink::~DeblurSink() {
  if (!writer_ || finished_) return;
  writer_.reset();
  std::error_code ignored;
  std::filesystem::remove(part_of(output_.path), ignored);
}

Status DeblurSink::open(const pipeline::SinkFormat& format) {
  frames_.open(format);
  const capture::CaptureInfo& info = frames_.written();
  capture::WriterOptions how;
  how.truth = info.has_truth;
  how.replace = output_.replace;
  auto writer = capture::CaptureWriter::create(output_.path, info, how);
  if (!writer) return tl::unexpected(writer.error());
  writer_.emplace(std::move(*writer));
  const PixelChoice& choice = frames_.choice();
  if (choice.points().empty()) return {};
  std::vector<capture::Point> points;
  for (std::size_t i = 0; i < choice.points().size(); ++i) points.push_back({choice.x_of(i), choice.y_of(i)});
  return writer_->write_points(points);
}

void DeblurSink::publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& /*stats*/) noexcept {
  ++frames_in_;
  if (status_) status_ = take(frame);
  if (!status_) stop_requested_.store(true, std::memory_order_relaxed);
  beat();
}

void DeblurSink::idle(const pipeline::PipelineStats& /*stats*/) noexcept { beat(); }

void DeblurSink::beat() noexcept {
  if (!beat_(frames_in_)) stop_requested_.store(true, std::memory_order_relaxed);
}

Status DeblurSink::take(const pipeline::PublishedFrame& frame) {
  if (Status status = frames_.take(frame); !status || !frames_.sharp()) return status;
  const auto errors = frames_.errors();
  if (!errors) return tl::unexpected(errors.error());
  return write(frames_.index(), frames_.deblurred(), *errors);
}

Status DeblurSink::write(std::size_t index, const void* plane, const SquareErrors& errors) {
  const auto truth = frames_.truth(index);
  if (!truth) return tl::unexpected(truth.error());
  squares_.blurred += errors.blurred;
  squares_.deblurred += errors.deblurred;
  ++frames_out_;
  const capture::CaptureReader& input = frames_.input();
  return writer_->append(input.t()[index], input.frame_id()[index], plane, *truth);
}

std::optional<Rmse> DeblurSink::rmse() const {
  const capture::CaptureInfo& info = frames_.written();
  if (!info.has_truth || frames_out_ == 0 || info.format.scale.unit != Unit::kKelvin) return std::nullopt;
  const double values = static_cast<double>(frames_out_) * static_cast<double>(info.format.geometry.pixels());
  return Rmse{std::sqrt(squares_.blurred / values), std::sqrt(squares_.deblurred / values)};
}

Status DeblurSink::finish(std::string_view isa, const std::vector<std::pair<std::string, std::string>>& files) {
  const PixelChoice& choice = frames_.choice();
  // A stimulus that is wrong is left out; opening the input has said so.
  const capture::Stimulus stimulus = seen_through(frames_.input().stimulus().value_or(capture::NoStimulus{}), choice);
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
  const deblur::Settings& settings = frames_.format().deblur;
  if (!std::holds_alternative<capture::NoStimulus>(stimulus)) {
    then([&] { return writer_->write_stimulus(stimulus); });
  }
  for (const capture::Event& event : frames_.input().events()) then([&] { return writer_->add_event(event); });
  text("solver", deblur::name(settings.method));
  text("isa", isa);
  if (choice.points().empty()) text("roi", in_words(choice.region()));
  for (const auto& [name, value] : files) text(name.c_str(), value);
  number("tau_s", settings.tau_s);
  number("kappa", settings.kappa);
  number("lambda", settings.lambda);
  number("iterations", settings.iterations);
  number("window", settings.window);
  number("levels", settings.levels);
  number("lookahead", settings.lookahead);
  if (!status) return status;
  finished_ = true;  // whole: where it cannot get its name, it stays under that of the ".part"
  return writer_->close();
}

}  // namespace bolo::tools
