#include "src/diagnose/session.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>

#include "src/capture/capture.hpp"

namespace bolo::diagnose {
namespace {

constexpr int kMaxRows = 48;
constexpr int kMaxColumns = 64;
constexpr double kSaturatedShare = 0.5;

Kind kind_of(const capture::Stimulus& stimulus) {
  if (std::holds_alternative<capture::Uniform>(stimulus)) return Kind::kUniform;
  if (std::holds_alternative<capture::Chopper>(stimulus)) return Kind::kChopper;
  if (const auto* bars = std::get_if<capture::BarTarget>(&stimulus)) {
    return bars->velocity_px_s == 0.0 ? Kind::kStillBars : Kind::kMovingBars;
  }
  return std::holds_alternative<capture::SceneStimulus>(stimulus) ? Kind::kScene : Kind::kField;
}

// What is wrong with the numbers of a stimulus, or nothing.
std::string fault(const capture::Stimulus& stimulus) {
  if (const auto* bars = std::get_if<capture::BarTarget>(&stimulus)) {
    if (!(bars->period_px > 0.0 && bars->bar_width_px > 0.0 && bars->bar_width_px < bars->period_px)) {
      return "bar_width_px must lie between 0 and period_px";
    }
    if (!(bars->hot_k > bars->cold_k)) return "hot_k must be above cold_k";
  }
  if (const auto* chopper = std::get_if<capture::Chopper>(&stimulus)) {
    if (chopper->on_s.empty()) return "the chopper has no pulse";
  }
  return {};
}

struct Frames {
  Series values;  // of the grid
  FrameStatistics statistics;
  double saturated = 0.0;  // share of the values at the limits of 16 bits
  bool numbers = true;     // every value is one
};

Result<Frames> read_frames(const capture::CaptureReader& reader, const Grid& grid) {
  const StreamFormat& format = reader.info().format;
  const std::size_t pixels = format.geometry.pixels();
  const auto width = static_cast<std::size_t>(format.geometry.width);
  std::vector<std::byte> plane(plane_bytes(format.geometry, format.type));
  std::vector<float> frame(pixels);
  Frames out{Series(static_cast<Eigen::Index>(reader.info().frames), grid.pixels()), {}, 0.0, true};
  FrameStatisticsSum statistics(format.geometry.width, format.geometry.height);
  const auto* counts = reinterpret_cast<const std::uint16_t*>(plane.data());
  const auto* kelvin = reinterpret_cast<const float*>(plane.data());
  std::size_t clipped = 0;
  for (std::size_t k = 0; k < reader.info().frames; ++k) {
    if (Status status = reader.read_frame(k, plane.data()); !status) return tl::unexpected(status.error());
    for (std::size_t i = 0; i < pixels; ++i) {
      const double raw =
          format.type == PixelType::kUint16 ? static_cast<double>(counts[i]) : static_cast<double>(kelvin[i]);
      frame[i] = static_cast<float>(format.scale.to_physical(raw));
      if (format.type == PixelType::kUint16) clipped += counts[i] == 0 || counts[i] == 65535 ? 1 : 0;
    }
    out.numbers = Eigen::Map<const Eigen::ArrayXf>(frame.data(), static_cast<Eigen::Index>(pixels)).allFinite();
    if (!out.numbers) return out;
    statistics.add(frame);
    Eigen::Index at = 0;
    for (const int row : grid.rows) {
      for (const int column : grid.columns) {
        out.values(static_cast<Eigen::Index>(k), at++) =
            frame[static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column)];
      }
    }
  }
  out.statistics = statistics.statistics();
  out.saturated =
      static_cast<double>(clipped) / static_cast<double>(pixels * std::max<std::size_t>(1, reader.info().frames));
  return out;
}

// One recording, or the reason why it can't be used.
Result<Recording> read_recording(const std::filesystem::path& file, Session& session, std::string& camera) {
  auto reader = capture::CaptureReader::open(file);
  if (!reader) return tl::unexpected(reader.error());
  const capture::CaptureInfo& info = reader->info();
  const auto refuse = [&](const std::string& what) { return bad_input(file.filename().string() + ": " + what); };
  if (info.frames < kMinFrames) {
    return refuse("has " + std::to_string(info.frames) + " frames, at least " + std::to_string(kMinFrames) +
                  " are needed; left out");
  }
  const Geometry g = info.format.geometry;
  const std::string identity = info.camera_model + "/" + info.camera_serial;
  if (session.recordings.empty()) {
    session.width = g.width;
    session.height = g.height;
    session.row_step = info.format.row_step;
    session.period_s = info.format.frame_period_s;
    session.grid = {spread_over(g.height, kMaxRows), spread_over(g.width, kMaxColumns)};
    session.good.assign(static_cast<std::size_t>(session.grid.pixels()), 1);
    camera = identity;
  }
  if (g != Geometry{session.width, session.height}) {
    return refuse("is " + std::to_string(g.width) + "x" + std::to_string(g.height) + ", the first capture " +
                  std::to_string(session.width) + "x" + std::to_string(session.height) +
                  "; left out, diagnose it by itself");
  }
  if (identity != camera) {
    return refuse("comes from the camera " + identity + ", the first capture from " + camera +
                  "; left out, diagnose it by itself");
  }
  if (std::abs(info.format.frame_period_s / session.period_s - 1.0) > 0.01) {
    return refuse("has another frame period than the first capture; left out, diagnose it by itself");
  }
  auto stimulus = reader->stimulus();
  if (!stimulus) return tl::unexpected(stimulus.error());
  if (const std::string what = fault(*stimulus); !what.empty()) return refuse("/stimulus: " + what + "; left out");
  Recording recording;
  recording.name = file.filename().string();
  recording.kind = kind_of(*stimulus);
  recording.stimulus = std::move(*stimulus);
  recording.kelvin = info.format.scale.unit == Unit::kKelvin;
  if (info.format.type == PixelType::kUint16) recording.step = recording.kelvin ? info.format.scale.scale : 1.0;
  recording.start_s = reader->t().front();
  for (const double t : reader->t()) recording.t.push_back(t - recording.start_s);
  auto frames = read_frames(*reader, session.grid);
  if (!frames) return tl::unexpected(frames.error());
  if (frames->saturated > kSaturatedShare) return refuse("most of its values are at the limit of 16 bits; left out");
  if (!frames->numbers) return refuse("/frames has values that are no numbers; left out");
  recording.values = std::move(frames->values);
  recording.statistics = std::move(frames->statistics);
  recording.used.assign(static_cast<std::size_t>(recording.frames()), 1);
  return recording;
}

}  // namespace

Result<Session> read_session(const std::vector<std::filesystem::path>& files, const Progress& progress) {
  Session session;
  std::string camera;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (!progress("reading", static_cast<double>(i) / static_cast<double>(files.size()))) return failed("interrupted");
    auto recording = read_recording(files[i], session, camera);
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

std::vector<int> Grid::all() const {
  std::vector<int> pixels_of_it(static_cast<std::size_t>(pixels()));
  std::iota(pixels_of_it.begin(), pixels_of_it.end(), 0);
  return pixels_of_it;
}

std::string_view name_of(Kind kind) {
  switch (kind) {
    case Kind::kUniform:
      return "uniform";
    case Kind::kChopper:
      return "chopper";
    case Kind::kMovingBars:
    case Kind::kStillBars:
      return "bar_target";
    case Kind::kScene:
      return "scene";
    case Kind::kField:
      break;
  }
  return "field";
}

}  // namespace bolo::diagnose
