#include "tools/deblur/capture_run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <system_error>

#include <fmt/format.h>

#include "drivers/replay/replay_source.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tools/cli/cli.hpp"
#include "tools/deblur/made_from.hpp"

namespace bolo::tools {
namespace {

constexpr float kLargestInput = 1e9F;  // beyond any temperature or count; sums of squares overflow for larger values

// float32 holds kelvin; other types keep the input's scale.
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

// The stimulus for the chosen pixels. A region shifts a still's origin; points keep only what all pixels see alike.
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

// The run combines data of two readers of one file, so both must have found the same frames.
bool same_frames(const capture::CaptureReader& a, const capture::CaptureReader& b) {
  return a.info().format.geometry == b.info().format.geometry && a.info().format.type == b.info().format.type &&
         a.info().has_truth == b.info().has_truth && a.info().has_times == b.info().has_times && a.t() == b.t() &&
         a.frame_id() == b.frame_id();
}

// The error that says how much was solved before the interruption.
Error interruption(DeblurSink& sink, const pipeline::Pipeline& pipeline, const DeblurRequest& request,
                   const std::filesystem::path& output) {
  if (sink.frames_out() == 0) {
    return {ErrorKind::kFailed, "interrupted before any frame was solved; " + output.string() + " was not written"};
  }
  if (const Status kept = sink.keep_part(pipeline.isa(), files_behind(request)); !kept) return kept.error();
  return interrupted_after(sink.frames_out(), output);
}

}  // namespace

DeblurSink::DeblurSink(std::filesystem::path input_file, capture::CaptureReader input, PixelChoice choice,
                       OutputFile output, FrameCallback on_frame)
    : input_file_(std::move(input_file)),
      input_(std::move(input)),
      choice_(std::move(choice)),
      output_(std::move(output)),
      on_frame_(std::move(on_frame)) {}

DeblurSink::~DeblurSink() {
  if (!writer_ || kept_) return;
  static_cast<void>(tried([this] {
    writer_->discard();
    return Status{};
  }));
}

Status DeblurSink::open(const pipeline::SinkFormat& format) {
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
  capture::WriterOptions how;
  how.truth = written_.has_truth;
  how.times = written_.has_times;
  how.motion = format.motion && choice_.points().empty();
  how.replace = output_.replace;
  ASSIGN_OR_RETURN(auto writer, capture::CaptureWriter::create(output_.path, written_, how));
  writer_.emplace(std::move(writer));
  if (choice_.points().empty()) return {};
  std::vector<capture::Point> points;
  for (std::size_t i = 0; i < choice_.points().size(); ++i) points.push_back({choice_.x_of(i), choice_.y_of(i)});
  return writer_->write_points(points);
}

void DeblurSink::publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& /*stats*/) noexcept {
  ++frames_in_;
  if (status_) status_ = tried([&] { return take(frame); });
  if (!status_) stop_requested_.store(true, std::memory_order_relaxed);
  on_frame_(frames_in_, status_ && sharp_);
}

Status DeblurSink::refuse_nan(const pipeline::PublishedFrame& frame) const {
  if (format_.source.format.type != PixelType::kFloat32) return {};
  const auto* values = reinterpret_cast<const float*>(raw_.data());
  for (std::size_t i = 0; i < raw_.size() / sizeof(float); ++i) {
    if (std::abs(values[i]) < kLargestInput) continue;
    return bad_input(fmt::format(
        "{}: frame {}, column {}, row {} of /frames is {:g}; replace such pixels, or leave them out with --roi",
        input_file_.string(), frame.meta.frame_id, choice_.x_of(i), choice_.y_of(i), values[i]));
  }
  return {};
}

Status DeblurSink::take(const pipeline::PublishedFrame& frame) {
  const StreamFormat& in = format_.source.format;
  choice_.take(frame.raw, bytes_of(in.type), raw_.data());
  RETURN_IF_ERROR(refuse_nan(frame));
  const std::vector<std::uint64_t>& ids = input_.frame_id();
  while (index_ < ids.size() && ids[index_] != frame.meta.frame_id) ++index_;
  sharp_ = (frame.meta.flags & kFlagWarmUp) == 0;
  if (!sharp_) return {};
  choice_.take_deblurred(frame.deblurred, bytes_of(format_.deblurred_type), deblurred_.data());
  if (written_.has_truth) {
    RETURN_IF_ERROR(input_.read_truth(index_, whole_truth_.data()));
    choice_.take(whole_truth_.data(), sizeof(float), truth_.data());
    blurred_squares_ += square_error(in.type, in.scale, raw_.data(), truth_);
    deblurred_squares_ += square_error(written_.format.type, written_.format.scale, deblurred_.data(), truth_);
  }
  ++frames_out_;
  const std::optional<capture::FrameTimes> times = capture::times_of(input_, index_);
  return writer_->append(input_.t()[index_], ids[index_], deblurred_.data(),
                         written_.has_truth ? truth_.data() : nullptr, motion_of(frame), times ? &*times : nullptr);
}

// The frame's blocks of motion, or those at the places of a region's blocks; null: unknown, or for points.
const BlockMotion* DeblurSink::motion_of(const pipeline::PublishedFrame& frame) {
  if (frame.motion == nullptr || !choice_.points().empty()) return nullptr;
  const Region& region = choice_.region();
  const Geometry blocks = motion_blocks(written_.format.geometry);
  motion_.clear();
  for (int row = 0; row < blocks.height; ++row) {
    for (int column = 0; column < blocks.width; ++column) {
      const auto place = [](int begin, int block, int most) {
        return std::min((begin + block * kMotionBlock + kMotionBlock / 2) / kMotionBlock, most - 1);
      };
      const int x = place(region.x, column, frame.motion->size.width);
      const int y = place(region.y, row, frame.motion->size.height);
      motion_.push_back(frame.motion->blocks[static_cast<std::size_t>(y * frame.motion->size.width + x)]);
    }
  }
  return motion_.data();
}

std::optional<Rmse> DeblurSink::rmse() const {
  if (!written_.has_truth || frames_out_ == 0 || written_.format.scale.unit != Unit::kKelvin) return std::nullopt;
  const double values = static_cast<double>(frames_out_) * static_cast<double>(written_.format.geometry.pixels());
  return Rmse{std::sqrt(blurred_squares_ / values), std::sqrt(deblurred_squares_ / values)};
}

Status DeblurSink::write_settings(std::string_view isa, const Files& files) {
  // A faulty stimulus is left out; it was reported when the input was opened.
  const capture::Stimulus stimulus = seen_through(input_.stimulus().value_or(capture::NoStimulus{}), choice_);
  if (!std::holds_alternative<capture::NoStimulus>(stimulus)) {
    RETURN_IF_ERROR(writer_->write_stimulus(stimulus));
  }
  for (const capture::Event& event : input_.events()) RETURN_IF_ERROR(writer_->add_event(event));
  std::vector<capture::Attribute> attributes;
  if (written_.has_times) {
    attributes = input_.attributes().value_or(attributes);
    std::erase_if(attributes, [](const capture::Attribute& one) { return one.name != "utc_uncertainty_s"; });
  }
  const deblur::Settings& s = format_.deblur;
  attributes.push_back({"solver", std::string(deblur::name(s.method))});
  attributes.push_back({"isa", std::string(isa)});
  if (choice_.points().empty()) attributes.push_back({"roi", describe_region(choice_.region())});
  for (const auto& [name, value] : files) attributes.push_back({name, value});
  for (const auto& [name, value] : {std::pair<const char*, double>{"tau_s", s.tau_s},
                                    {"kappa", s.kappa},
                                    {"lambda", s.lambda},
                                    {"iterations", s.iterations},
                                    {"window", s.window},
                                    {"levels", s.levels},
                                    {"lookahead", s.lookahead}}) {
    attributes.push_back({name, value});
  }
  return writer_->write_attributes(attributes);
}

Status DeblurSink::finish(std::string_view isa, const Files& files, const std::string& made_from) {
  Status status = write_settings(isa, files);
  if (status && !made_from.empty()) status = writer_->write_attribute(kMadeFrom, made_from);
  if (status) status = writer_->close();
  // If another program created the output meanwhile, the ".part" is kept, to which the message refers.
  std::error_code ignored;
  kept_ = status || (output_.replace == Replace::kNothing && std::filesystem::exists(output_.path, ignored));
  return status;
}

Status DeblurSink::keep_part(std::string_view isa, const Files& files) {
  kept_ = true;
  RETURN_IF_ERROR(write_settings(isa, files));
  return writer_->complete();
}

CaptureRun::CaptureRun(const DeblurRequest& request, std::filesystem::path file,
                       std::shared_ptr<const capture::CaptureReader> reader, pipeline::PipelineOptions options)
    : request_(&request), file_(std::move(file)), reader_(std::move(reader)), options_(std::move(options)) {
  if (request.gyro != nullptr) gyro_ = std::make_unique<GyroOfCapture>(request.gyro, reader_);
  options_.deblur.gyro = gyro_.get();
}

Result<CaptureRun> CaptureRun::open(const DeblurRequest& request, const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(auto reader, capture::CaptureReader::open(file));
  RETURN_IF_ERROR(check_capture(request, file, reader.info()));
  for (const std::string& line : reader.warnings()) {
    std::fprintf(stderr, "bolo deblur: %s\n", printable(file.string() + ": " + line).c_str());
  }
  pipeline::PipelineOptions options = request.options;
  ASSIGN_OR_RETURN(options.points, points_of(request, reader.info().format.geometry));
  return CaptureRun(request, file, std::make_shared<const capture::CaptureReader>(std::move(reader)),
                    std::move(options));
}

Result<RunFacts> CaptureRun::run(const OutputFile& output, const std::string& made_from,
                                 const DeblurSink::FrameCallback& on_frame) {
  ASSIGN_OR_RETURN(auto own_reader, capture::CaptureReader::open(file_));
  if (!same_frames(own_reader, *reader_)) {
    return bad_input(file_.string() + ": was replaced by another program meanwhile; start again");
  }
  PixelChoice choice(info().format.geometry, options_.region, options_.points);
  DeblurSink sink(file_, std::move(own_reader), std::move(choice), output, on_frame);
  const bool drops = options_.undo.drop_repeated;
  auto source = std::make_unique<replay::ReplaySource>(reader_, replay::Pace::kAsFastAsPossible, replay::Laps::kOne,
                                                       replay::Values::kAsStored,
                                                       drops ? replay::Repeats::kDropped : replay::Repeats::kFrames);
  const replay::ReplaySource& replayed = *source;
  ASSIGN_OR_RETURN(const auto pipeline, pipeline::Pipeline::create(std::move(source), {&sink}, options_));
  const double period_s = pipeline->settings().period_s;
  if (const double stated_s = info().format.frame_period_s; period_s != stated_s && options_.warn) {
    options_.warn(
        fmt::format("{}: {}frames come every {:.5g} ms by /t, not every {:.5g} as frame_period_s says, and are "
                    "solved so",
                    file_.string(), drops ? "new " : "", period_s * 1e3, stated_s * 1e3));
  }
  RETURN_IF_ERROR(pipeline->run(sink.stop_requested()));
  RETURN_IF_ERROR(replayed.result());
  RETURN_IF_ERROR(sink.status());
  if (options_.give_up != nullptr && options_.give_up->load(std::memory_order_relaxed)) {
    return tl::unexpected(interruption(sink, *pipeline, *request_, output.path));
  }
  if (sink.frames_out() == 0) {
    return bad_input(file_.string() + ": no full window of " + std::to_string(options_.deblur.window) +
                     " frames between its breaks (events, jumps in time); give a smaller --window");
  }
  for (const std::string& line : pipeline->take_doubts()) {
    if (options_.warn) options_.warn(file_.string() + ": " + line);
  }
  RETURN_IF_ERROR(sink.finish(pipeline->isa(), files_behind(*request_), made_from));
  const pipeline::PipelineStats& stats = pipeline->stats();
  RunFacts facts{
      sink.frames_out(),    stats.inlet.losses().total(), static_cast<double>(stats.deblur_ns.value()) * kMsPerNs,
      pipeline->settings(), std::string(pipeline->isa()), pipeline->solver_text(),
      sink.rmse()};
  for (std::size_t i = 0; i < kGyroUses; ++i) facts.gyro[i] = stats.gyro[i].value();
  return facts;
}

}  // namespace bolo::tools
