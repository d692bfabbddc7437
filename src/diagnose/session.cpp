#include "src/diagnose/session.hpp"

#include <functional>

namespace bolo::diagnose {
namespace {

constexpr double kSaturatedShare = 0.5;

constexpr std::size_t kSortedPixels = 20000;  // enough for quartiles accurate to a hundredth of a sigma
constexpr double kTrim = 0.1;                 // of the sorted changes, at either end
constexpr double kTrimmedSigma = 0.6616;      // standard deviation of a unit Gaussian trimmed by kTrim at both ends

// Describes the error in a stimulus' numbers; empty: none.
std::string fault(const capture::Stimulus& stimulus) {
  if (const auto* bars = std::get_if<capture::BarTarget>(&stimulus)) {
    if (!(bars->period_px > 0.0 && bars->bar_width_px > 0.0 && bars->bar_width_px < bars->period_px)) {
      return "bar_width_px must lie between 0 and period_px";
    }
    if (!(bars->hot_k > bars->cold_k)) return "hot_k must be above cold_k";
  }
  const auto* chopper = std::get_if<capture::Chopper>(&stimulus);
  return chopper != nullptr && chopper->on_s.empty() ? "the chopper has no pulse" : "";
}

// Told the share that is read; false stops the reading.
using Going = std::function<bool(double)>;

// Reads all frames into `recording`. Returns the fault in their values; empty: none.
Result<std::string> read_frames(FrameReader& reader, const Grid& grid, Recording& recording, const Going& going) {
  const Geometry geometry = reader.format().geometry;
  std::vector<float> frame(geometry.pixels());
  recording.values.resize(static_cast<Index>(reader.capture().info().frames), grid.pixels());
  FrameStatisticsSum statistics(geometry.width, geometry.height, !has_model(recording));
  std::size_t clipped = 0;
  for (Index k = 0; k < recording.values.rows(); ++k) {
    if (!going(static_cast<double>(k) / static_cast<double>(recording.values.rows()))) return failed("interrupted");
    ASSIGN_OR_RETURN(const auto at_limits, reader.read(static_cast<std::size_t>(k), 0, frame));
    clipped += at_limits;
    if (!std::ranges::all_of(frame, [](float v) { return std::isfinite(v); })) {
      return "/frames has values that are no numbers";
    }
    statistics.add(frame);
    grid.take(frame, geometry.width, k, recording.values);
  }
  recording.statistics = statistics.statistics();
  const auto values = static_cast<double>(frame.size() * std::max<std::size_t>(1, reader.capture().info().frames));
  const bool saturated = static_cast<double>(clipped) / values > kSaturatedShare;
  return saturated ? "most of its values are at the limit of 16 bits" : "";
}

// Describes how camera or mode differ from the session's first capture; empty: not at all.
std::string difference(const capture::CaptureInfo& info, const Session& session, const std::string& camera) {
  const Geometry g = info.format.geometry;
  const std::string identity = info.camera_model + "/" + info.camera_serial;
  if (g != Geometry{session.width, session.height}) {
    return "is " + std::to_string(g.width) + "x" + std::to_string(g.height) + ", the first capture " +
           std::to_string(session.width) + "x" + std::to_string(session.height);
  }
  if (identity != camera) return "comes from the camera " + identity + ", the first capture from " + camera;
  const bool same_period = std::abs(info.format.frame_period_s / session.period_s - 1.0) <= 0.01;
  return same_period ? "" : "has another frame period than the first capture";
}

// Reads one recording, or says why it cannot be used.
Result<Recording> read_recording(const std::filesystem::path& file, Session& session, std::string& camera,
                                 const Going& going) {
  ASSIGN_OR_RETURN(auto reader, FrameReader::open(file, session.known));
  const capture::CaptureInfo& info = reader.capture().info();
  Recording recording;
  recording.file = file;
  recording.name = file.filename().string();
  const auto refuse = [&](const std::string& what) { return bad_input(recording.name + ": " + what); };
  if (info.frames < kMinFrames) {
    return refuse("has " + std::to_string(info.frames) + " frames, at least " + std::to_string(kMinFrames) +
                  " are needed; left out");
  }
  if (session.recordings.empty()) {
    session.width = info.format.geometry.width;
    session.height = info.format.geometry.height;
    session.row_step = info.format.row_step;
    session.period_s = info.format.frame_period_s;
    session.grid = {spread_over(session.height, kGridRows), spread_over(session.width, kGridColumns)};
    session.good.assign(static_cast<std::size_t>(session.grid.pixels()), 1);
    camera = info.camera_model + "/" + info.camera_serial;
  }
  if (const std::string what = difference(info, session, camera); !what.empty()) {
    return refuse(what + "; left out, diagnose it by itself");
  }
  ASSIGN_OR_RETURN(recording.stimulus, reader.capture().stimulus());
  if (const std::string what = fault(recording.stimulus); !what.empty()) {
    return refuse("/stimulus: " + what + "; left out");
  }
  recording.kind = kind_of(recording.stimulus);
  recording.kelvin = info.format.scale.unit == Unit::kKelvin;
  if (info.format.type == PixelType::kUint16) recording.step = recording.kelvin ? info.format.scale.scale : 1.0;
  recording.start_s = reader.capture().t().front();
  recording.t = mapped(reader.capture().t(), [&](double t) { return t - recording.start_s; });
  ASSIGN_OR_RETURN(const auto what, read_frames(reader, session.grid, recording, going));
  if (!what.empty()) return refuse(what + "; left out");
  recording.used.assign(recording.t.size(), 1);
  return recording;
}

using Plane = Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// FrameStatistics::likeness of a frame's changes. Row and column means are removed, because flicker, jumps and stripes
// are common to frames, rows or columns; outliers are clipped.
double likeness_of(Plane changes) {
  constexpr float kFarChange = 2.5F;  // standard deviations
  changes.colwise() -= changes.rowwise().mean().eval();
  changes.rowwise() -= changes.colwise().mean().eval();
  const float most = kFarChange * std::sqrt(changes.square().mean());
  changes = changes.cwiseMax(-most).cwiseMin(most).eval();
  const float power = changes.square().mean();
  const Index down = changes.rows() - 1;
  const Index across = changes.cols() - 1;
  if (!(power > 0.0F) || down == 0 || across == 0) return 0.0;
  const float beside = (changes.leftCols(across) * changes.rightCols(across)).mean();
  const float below = (changes.topRows(down) * changes.bottomRows(down)).mean();
  return static_cast<double>((beside + below) / 2.0F / power);
}

std::vector<float> to_vector(const ArrayXd& values) {
  const ArrayXf single = values.cast<float>();
  return {single.begin(), single.end()};
}

}  // namespace

Kind kind_of(const capture::Stimulus& stimulus) {
  if (std::holds_alternative<capture::Uniform>(stimulus)) return Kind::kUniform;
  if (std::holds_alternative<capture::Chopper>(stimulus)) return Kind::kChopper;
  if (const auto* bars = std::get_if<capture::BarTarget>(&stimulus)) {
    return bars->velocity_px_s == 0.0 ? Kind::kStillBars : Kind::kMovingBars;
  }
  return std::holds_alternative<capture::SceneStimulus>(stimulus) ? Kind::kScene : Kind::kField;
}

bool has_model(const Recording& recording) {
  return recording.kelvin && recording.kind != Kind::kScene && recording.kind != Kind::kField;
}

Result<FrameReader> FrameReader::open(const std::filesystem::path& file, const model::PixelMaps& known) {
  ASSIGN_OR_RETURN(auto capture, capture::CaptureReader::open(file));
  model::PixelMaps maps = known;
  maps.tau_s.clear();
  auto correction = corrections::PixelCorrection::create({}, capture.info().format, maps);
  if (!correction) return bad_input(file.filename().string() + ": " + correction.error().message);
  return FrameReader(std::move(capture), std::move(*correction));
}

FrameReader::FrameReader(capture::CaptureReader capture, corrections::PixelCorrection correction)
    : capture_(std::move(capture)),
      correction_(std::move(correction)),
      raw_(plane_bytes(capture_.info().format.geometry, capture_.info().format.type)),
      plane_(plane_bytes(format().geometry, format().type)) {}

StreamFormat FrameReader::format() const {
  StreamFormat format = capture_.info().format;
  if (correction_.changes_samples()) format.type = PixelType::kFloat32;
  return format;
}

Result<std::size_t> FrameReader::read_plane(std::size_t frame, std::byte* plane) {
  const PixelType type = capture_.info().format.type;
  const bool corrected = correction_.changes_samples();
  std::byte* const raw = corrected ? raw_.data() : plane;
  RETURN_IF_ERROR(capture_.read_frame(frame, raw));
  const PixelRange all{0, capture_.info().format.geometry.pixels()};
  const auto* counts = reinterpret_cast<const std::uint16_t*>(raw);
  const auto clipped = type == PixelType::kUint16
                           ? std::count_if(counts, counts + all.end, [](auto v) { return v == 0 || v == 65535; })
                           : 0;
  if (corrected) {
    auto* values = reinterpret_cast<float*>(plane);
    corrections::to_float(raw, type, values, all);
    correction_.apply(values, all);
    correction_.finish(values);
  }
  return static_cast<std::size_t>(clipped);
}

Result<std::size_t> FrameReader::read(std::size_t frame, std::size_t first, std::span<float> out) {
  ASSIGN_OR_RETURN(const auto clipped, read_plane(frame, plane_.data()));
  const StreamFormat stored = format();
  corrections::to_float(plane_.data() + first * bytes_of(stored.type), stored.type, out.data(), {0, out.size()});
  for (float& value : out) value = static_cast<float>(stored.scale.to_physical(static_cast<double>(value)));
  return clipped;
}

Result<FrameReader> open_again(const Recording& recording, const model::PixelMaps& known) {
  auto reader = FrameReader::open(recording.file, known);
  const FrameStatistics& read = recording.statistics;
  const auto same_time = [&](double t, double before) { return t - recording.start_s == before; };
  if (reader && reader->format().geometry == Geometry{read.width, read.height} &&
      std::ranges::equal(reader->capture().t(), recording.t, same_time)) {
    return reader;
  }
  return failed(recording.file.string() + " changed while it was diagnosed; start again");
}

Result<Session> read_session(const std::vector<std::filesystem::path>& files, const Progress& progress,
                             model::PixelMaps known) {
  Session session;
  session.known = std::move(known);
  std::string camera;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const Going going = [&](double share) {
      return progress("reading", (static_cast<double>(i) + share) / static_cast<double>(files.size()));
    };
    auto recording = read_recording(files[i], session, camera, going);
    if (!going(1.0)) return failed("interrupted");
    if (recording) {
      session.recordings.push_back(std::move(*recording));
    } else {
      session.warnings.push_back(recording.error().message);
    }
  }
  if (session.recordings.empty()) {
    return bad_input(session.warnings.empty() ? "no captures; name at least one" : session.warnings.front());
  }
  return session;
}

std::vector<int> spread_over(int count, int limit) {
  std::vector<int> chosen(static_cast<std::size_t>(std::min(count, limit)));
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    chosen[i] = static_cast<int>((static_cast<double>(i) + 0.5) * count / static_cast<double>(chosen.size()));
  }
  return chosen;
}

double step_variance(const ArrayXd& x) { return (x.tail(x.size() - 1) - x.head(x.size() - 1)).square().mean() / 2.0; }

double wander(const ArrayXd& x) { return (x - x.mean()).square().mean() / std::max(1e-12, step_variance(x)); }

double usual_scatter(const std::vector<double>& values) {
  const double middle = median(values);
  return kSigmaOfMad * median(mapped(values, [middle](double v) { return std::abs(v - middle); }));
}

void Grid::take(std::span<const float> frame, int width, Index k, Series& values) const {
  for (Index p = 0; p < pixels(); ++p) values(k, p) = frame[static_cast<std::size_t>(row_of(p) * width + column_of(p))];
}

std::string_view name_of(Kind kind) {
  constexpr std::string_view kNames[] = {"uniform", "chopper", "bar_target", "bar_target", "scene", "field"};
  return kNames[static_cast<std::size_t>(kind)];
}

std::size_t FrameStatistics::distinct_frames() const {
  return static_cast<std::size_t>(std::ranges::count(repeated, 0));
}

std::vector<double> FrameStatistics::of_new_frames(const std::vector<double>& values) const {
  std::vector<double> all;
  for (std::size_t k = 1; k < frames(); ++k) {
    if (repeated[k] == 0) all.push_back(values[k]);
  }
  return all;
}

FrameStatisticsSum::FrameStatisticsSum(int width, int height, bool likeness) : likeness_(likeness) {
  result_.width = width;
  result_.height = height;
  const auto pixels = static_cast<Index>(width) * height;
  stride_ = std::max<std::size_t>(1, static_cast<std::size_t>(pixels) / kSortedPixels);
  // Were the stride not coprime to the width, the same few columns would be sampled in every row.
  while (std::gcd(stride_, static_cast<std::size_t>(width)) > 1) ++stride_;
  sum_ = about_ = about2_ = step2_ = ArrayXd::Zero(pixels);
}

void FrameStatisticsSum::compare(std::span<const float> frame) {
  sorted_.clear();
  for (std::size_t p = 0; p < frame.size(); p += stride_) sorted_.push_back(frame[p] - last_[static_cast<Index>(p)]);
  std::ranges::sort(sorted_);
  const std::size_t n = sorted_.size();
  const auto mean_square = [&](double trim, double about) {
    const auto cut = static_cast<std::size_t>(trim * static_cast<double>(n));
    double sum = 0.0;
    double squares = 0.0;
    for (const float value : std::span(sorted_).subspan(cut, n - 2 * cut)) {
      const double d = value - about;
      sum += d;
      squares += d * d;
    }
    const auto count = static_cast<double>(n - 2 * cut);
    return std::pair{sum / count, squares / count};
  };
  const double change = mean_square(0.25, 0.0).first;
  const auto [off, square] = mean_square(kTrim, change);
  const auto agreeing = std::ranges::count_if(sorted_, [change](float d) { return d * change > 0.0; });
  result_.change.back() = change;
  result_.scatter.back() = std::sqrt(std::max(0.0, square - off * off)) / kTrimmedSigma;
  result_.agreement.back() = static_cast<double>(agreeing) / static_cast<double>(n);
  if (!likeness_) return;
  const auto plane_of = [this](const float* values) {
    return Eigen::Map<const Plane>(values, result_.height, result_.width);
  };
  result_.likeness.back() = likeness_of(plane_of(frame.data()) - plane_of(last_.data()));
}

void FrameStatisticsSum::add(std::span<const float> frame) {
  const Eigen::Map<const ArrayXf> values(frame.data(), static_cast<Index>(frame.size()));
  const bool first = result_.repeated.empty();
  const bool repeated = !first && (values == last_).all();
  for (std::vector<double>* list : {&result_.change, &result_.scatter, &result_.agreement, &result_.likeness})
    list->push_back(0.0);
  result_.repeated.push_back(repeated ? 1 : 0);
  if (repeated) return;
  if (!first) compare(frame);
  sorted_.clear();
  for (std::size_t p = 0; p < frame.size(); p += stride_) sorted_.push_back(frame[p]);
  const auto middle = sorted_.begin() + static_cast<std::ptrdiff_t>(sorted_.size() / 2);
  std::nth_element(sorted_.begin(), middle, sorted_.end());
  const ArrayXd about = (values - *middle).cast<double>();
  if (first) {
    low_ = high_ = values;
  } else {
    low_ = low_.min(values);
    high_ = high_.max(values);
    step2_ += ((values - *middle) - (last_ - centre_)).cast<double>().square();
  }
  sum_ += values.cast<double>();
  about_ += about;
  about2_ += about.square();
  count_ += 1.0;
  last_ = values;
  centre_ = *middle;
}

FrameStatistics FrameStatisticsSum::statistics() const {
  FrameStatistics s = result_;
  if (count_ == 0.0) return s;
  s.mean = to_vector(sum_ / count_);
  const ArrayXf range = high_ - low_;
  s.range = {range.begin(), range.end()};
  const ArrayXd variance = (about2_ / count_ - (about_ / count_).square()).max(0.0);
  s.sigma = to_vector(variance.sqrt());
  const ArrayXd steps = step2_ / std::max(1.0, count_ - 1.0);
  s.roughness = to_vector((variance > 0.0).select(steps / variance, 0.0));
  return s;
}

}  // namespace bolo::diagnose
