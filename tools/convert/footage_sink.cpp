#include "tools/convert/footage.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>
#include <sstream>
#include <utility>

#include <fmt/format.h>

#include "src/core/statistics.hpp"
#include "src/core/unique_fd.hpp"
#include "tools/cli/process.hpp"

namespace bolo::tools {
namespace {

std::string scale_text(const LinearScale& scale) {
  if (scale.unit == Unit::kCount) return "counts of the camera";
  return fmt::format("kelvin = {:.9g} * value + {:.9g}", scale.scale, scale.offset);
}

std::string eye_meaning(const StreamFormat& format, const EyeRange& range, const char* without) {
  if (!range) return fmt::format("8 bit for the eye: {}", without);
  return fmt::format("8 bit for the eye: black at {:g}, white at {:g} {}", range->first, range->second,
                     format.scale.unit == Unit::kKelvin ? "K" : "counts");
}

// 8-bit grey pictures for the eye. Without a given range, the darkest and the brightest percent of the pixels are black
// and white; these levels follow the scene slowly, so that a film does not flicker.
class Preview {
 public:
  Preview(const StreamFormat& format, const EyeRange& range) : format_(format), fixed_(range.has_value()) {
    if (!range) return;
    low_ = (range->first - format.scale.offset) / format.scale.scale;
    high_ = (range->second - format.scale.offset) / format.scale.scale;
  }
  // The levels of one frame, row-major; valid until the next call.
  const std::vector<std::uint8_t>& levels(const Frame& frame) {
    if (format_.type == PixelType::kUint16) {
      values_.assign(frame.u16.begin(), frame.u16.end());
    } else {
      values_ = frame.f32;
    }
    if (!fixed_) follow_scene();
    // With a negative scale, hot is a low count, and still white.
    const double span = high_ - low_;
    const double gain = 255.0 / (fixed_ ? span : std::max(span, kLeastSpan));
    levels_.resize(values_.size());
    std::transform(values_.begin(), values_.end(), levels_.begin(), [&](float v) {
      const double level = (v - low_) * gain;
      return level > 0.0 ? static_cast<std::uint8_t>(std::min(level, 255.0)) : std::uint8_t{0};  // NaN: black
    });
    return levels_;
  }

 private:
  static constexpr double kShare = 0.01;      // of the pixels that are black, and that are white
  static constexpr double kFollow_s = 0.5;    // time constant of the levels
  static constexpr double kLeastSpan = 1e-6;  // for a scene without contrast

  void follow_scene() {
    sample_ = values_;
    std::erase_if(sample_, [](float v) { return !std::isfinite(v); });
    if (sample_.empty()) return;
    const double low = quantile(sample_, kShare);
    follow(low, quantile(sample_, 1.0 - kShare));
  }

  void follow(double low, double high) {
    const double weight = begun_ ? 1.0 - std::exp(-format_.frame_period_s / kFollow_s) : 1.0;
    low_ += weight * (low - low_);
    high_ += weight * (high - high_);
    begun_ = true;
  }

  StreamFormat format_;
  bool fixed_;
  std::vector<float> values_;
  std::vector<float> sample_;
  std::vector<std::uint8_t> levels_;
  double low_ = 0.0;
  double high_ = 0.0;
  bool begun_ = false;
};

Status write_extras(const Extras& extras, capture::CaptureWriter& writer) {
  for (const capture::Event& event : extras.events) RETURN_IF_ERROR(writer.add_event(event));
  RETURN_IF_ERROR(writer.write_attributes(extras.attributes));
  if (std::holds_alternative<capture::NoStimulus>(extras.stimulus)) return {};
  return writer.write_stimulus(extras.stimulus);
}

class CaptureSink final : public FootageSink {
 public:
  static Result<std::unique_ptr<FootageSink>> open(const Target& target, const Footage& footage) {
    capture::CaptureInfo info = footage.info();
    info.has_truth = false;
    capture::WriterOptions how;
    how.replace = target.file.replace;
    how.times = info.has_times;
    ASSIGN_OR_RETURN(auto writer, capture::CaptureWriter::create(target.file.path, info, how));
    ASSIGN_OR_RETURN(const Extras extras, footage.extras());
    RETURN_IF_ERROR(write_extras(extras, writer));
    return std::make_unique<CaptureSink>(std::move(writer));
  }
  explicit CaptureSink(capture::CaptureWriter writer) : writer_(std::move(writer)) {}
  ~CaptureSink() override {
    if (!finished_) writer_.discard();  // the input is still there
  }
  Status write(const Frame& frame) override {
    return writer_.append(frame.t_s, frame.id, frame.data(), nullptr, nullptr, frame.times ? &*frame.times : nullptr);
  }
  Status finish() override {
    RETURN_IF_ERROR(writer_.close());
    finished_ = true;
    return {};
  }

 private:
  capture::CaptureWriter writer_;
  bool finished_ = false;
};

// One file per frame: NAME_000000.png ..., or NAME.png if there is only one.
class PngSink final : public FootageSink {
 public:
  // Refuses if any frame's file may not be written.
  static Result<std::unique_ptr<FootageSink>> open(const Target& target, const Footage& footage) {
    auto sink = std::make_unique<PngSink>(target, footage.info());
    Files files;
    for (std::size_t i = 0; i < footage.info().frames; ++i) files.push_back(sink->file_of(i).path);
    RETURN_IF_ERROR(check_outputs(files, target.inputs, target.file.replace));
    return sink;
  }
  PngSink(Target target, const capture::CaptureInfo& info)
      : target_(std::move(target)), info_(info), preview_(info.format, target_.range) {}

  Status write(const Frame& frame) override {
    const OutputFile output = file_of(written_++);
    ASSIGN_OR_RETURN(FileBeside file, FileBeside::create(output));
    const Geometry geometry = info_.format.geometry;
    const Status good = target_.preview ? write_png8(file.opened(), geometry, preview_.levels(frame).data())
                                        : write_png16(file.opened(), geometry, values(frame));
    return good ? file.publish() : at(output.path.string(), good.error());
  }
  Status finish() override { return {}; }

  std::string files() const override {
    if (info_.frames == 1) return {};
    return fmt::format("{} files, {} to {}", info_.frames, file_of(0).path.string(),
                       file_of(info_.frames - 1).path.filename().string());
  }

  std::string meaning() const override {
    if (target_.preview) return eye_meaning(info_.format, target_.range, "the scale changes from frame to frame");
    return scale_text(is_float() ? target_.picture_scale : info_.format.scale);
  }

 private:
  bool is_float() const { return info_.format.type == PixelType::kFloat32; }

  OutputFile file_of(std::size_t frame) const {
    if (info_.frames == 1) return target_.file;
    const std::filesystem::path& given = target_.file.path;
    return {given.parent_path() / fmt::format("{}_{:06}.png", given.stem().string(), frame), target_.file.replace};
  }

  // Clamps to the range of 16 bits; NaN becomes 0.
  const std::uint16_t* values(const Frame& frame) {
    if (!is_float()) return frame.u16.data();
    const LinearScale& from = info_.format.scale;
    const LinearScale& to = target_.picture_scale;
    constexpr double kMost = std::numeric_limits<std::uint16_t>::max();
    levels_.clear();
    for (const float v : frame.f32) {
      const double level = std::round((from.to_physical(v) - to.offset) / to.scale);
      levels_.push_back(level > 0.0 ? static_cast<std::uint16_t>(std::min(level, kMost)) : std::uint16_t{0});
    }
    return levels_.data();
  }

  Target target_;
  capture::CaptureInfo info_;
  Preview preview_;
  std::vector<std::uint16_t> levels_;
  std::size_t written_ = 0;
};

class TiffSink final : public FootageSink {
 public:
  static Result<std::unique_ptr<FootageSink>> open(const Target& target, const Footage& footage) {
    ASSIGN_OR_RETURN(FileBeside file, FileBeside::create(target.file));
    ASSIGN_OR_RETURN(TiffWriter writer, at(target.file.path.string(), TiffWriter::create(file.opened())));
    return std::make_unique<TiffSink>(std::move(file), std::move(writer), target.file.path.string(),
                                      footage.info().format);
  }
  TiffSink(FileBeside file, TiffWriter writer, std::string name, StreamFormat format)
      : file_(std::move(file)), writer_(std::move(writer)), name_(std::move(name)), format_(format) {}

  // In kelvin if these are known: TIFF has no scale that other programs would read.
  Status write(const Frame& frame) override {
    return named(format_.scale.unit == Unit::kKelvin
                     ? writer_.write(format_.geometry, PixelType::kFloat32, kelvin(frame))
                     : writer_.write(format_.geometry, format_.type, frame.data()));
  }
  Status finish() override {
    const Status closed = named(writer_.close());
    return closed ? file_.publish() : closed;
  }
  std::string meaning() const override {
    return format_.scale.unit == Unit::kKelvin ? "float32, kelvin" : "counts of the camera";
  }

 private:
  Status named(Status status) const { return at(name_, std::move(status)); }

  const float* kelvin(const Frame& frame) {
    const bool is_float = format_.type == PixelType::kFloat32;
    kelvin_.resize(format_.geometry.pixels());
    for (std::size_t i = 0; i < kelvin_.size(); ++i) {
      const double value = is_float ? static_cast<double>(frame.f32[i]) : static_cast<double>(frame.u16[i]);
      kelvin_[i] = static_cast<float>(format_.scale.to_physical(value));
    }
    return kelvin_.data();
  }

  FileBeside file_;
  TiffWriter writer_;  // must close before the file is removed
  std::string name_;
  StreamFormat format_;
  std::vector<float> kelvin_;
};

class FilmSink final : public FootageSink {
 public:
  static Result<std::unique_ptr<FootageSink>> open(const Target& target, const Footage& footage) {
    const StreamFormat& format = footage.info().format;
    ASSIGN_OR_RETURN(FileBeside file, FileBeside::create(target.file));
    std::vector<std::string> words{"ffmpeg"};
    std::istringstream options(
        fmt::format("-v error -xerror -nostdin -y -f rawvideo -pix_fmt gray -s {}x{} -r {:.6g} "
                    "-i pipe:0 -vf pad=ceil(iw/2)*2:ceil(ih/2)*2 -pix_fmt yuv420p -c:v libx264 "  // even sides
                    "-movflags +faststart -f mp4",
                    format.geometry.width, format.geometry.height, 1.0 / format.frame_period_s));
    for (std::string word; options >> word;) words.push_back(word);
    words.push_back("file:" + file.opened().string());
    ASSIGN_OR_RETURN(ScratchFolder folder, ScratchFolder::make());
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) return failed(std::string("no pipe: ") + std::strerror(errno));
    const UniqueFd output(ends[0]);
    UniqueFd input(ends[1]);
    Command command{std::move(words), folder.path() / "log"};
    command.input = output.get();
    ASSIGN_OR_RETURN(Process ffmpeg, start_foreign(std::move(command), "ffmpeg"));
    return std::unique_ptr<FootageSink>(
        new FilmSink(std::move(file), std::move(folder), std::move(input), std::move(ffmpeg), format, target.range));
  }
  // Requires that SIGPIPE is ignored.
  Status write(const Frame& frame) override {
    for (std::span<const std::uint8_t> left = preview_.levels(frame); !left.empty();) {
      const ssize_t done = ::write(input_.get(), left.data(), left.size());
      if (done < 0 && errno == EINTR) continue;
      if (done < 0) {  // it ended, or will have to: its messages say why
        input_ = UniqueFd();
        RETURN_IF_ERROR(ended_well(ffmpeg_, "ffmpeg"));
        return failed("ffmpeg ended before its input did");
      }
      left = left.subspan(static_cast<std::size_t>(done));
    }
    return {};
  }
  Status finish() override {
    input_ = UniqueFd();
    Status ended = ended_well(ffmpeg_, "ffmpeg");
    return ended ? file_.publish() : ended;
  }
  std::string meaning() const override { return meaning_; }

 private:
  FilmSink(FileBeside file, ScratchFolder folder, UniqueFd input, Process ffmpeg, const StreamFormat& format,
           const EyeRange& range)
      : file_(std::move(file)),
        folder_(std::move(folder)),
        input_(std::move(input)),
        ffmpeg_(std::move(ffmpeg)),
        preview_(format, range),
        meaning_(eye_meaning(format, range, "the scale follows the scene")) {}

  FileBeside file_;
  ScratchFolder folder_;  // holds ffmpeg's messages
  UniqueFd input_;
  Process ffmpeg_;  // must end before the file is removed
  Preview preview_;
  std::string meaning_;
};

}  // namespace

Result<std::unique_ptr<FootageSink>> open_sink(const Target& target, const Footage& footage) {
  const std::string extension = target.file.path.extension().string();
  if (footage.parts().size() > 1 && extension != ".mcap") {
    return bad_input("several captures go together into an .mcap only; " + target.file.path.string() + " is none");
  }
  if (extension == ".mcap") return open_mcap_sink(target, footage);
  if (extension == ".h5") return CaptureSink::open(target, footage);
  if (extension == ".tif" || extension == ".tiff") return TiffSink::open(target, footage);
  if (extension == ".mp4") return FilmSink::open(target, footage);
  if (extension == ".png") return PngSink::open(target, footage);
  return bad_input(target.file.path.string() +
                   ": what is it to be? its name must end in .h5, .mcap, .png, .tif, .tiff or .mp4");
}

}  // namespace bolo::tools
