#include "tools/demo/live_check.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "src/capture/capture.hpp"
#include "src/core/clock.hpp"
#include "src/core/loss.hpp"
#include "src/core/statistics.hpp"
#include "src/report/text.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using plot::format;
using plot::Hue;

constexpr double kPictureWidth = 1240.0;  // px
constexpr double kBetween = 26.0;         // px, between close-ups
constexpr std::array kSolverHues{Hue::kDeblurred, Hue::kGreen, Hue::kPurple};
constexpr double kSides = 70.0;  // px, part of a plane's width that its axis takes
constexpr int kCloseUpColumns = 128;
constexpr int kCloseUpRows = 64;

std::size_t at(Geometry g, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(x);
}

// Mean squared horizontal difference in a region, K^2: a measure of detail.
double detail_of(const std::vector<float>& image, Geometry g, Region r) {
  double sum = 0.0;
  for (int y = r.y; y < r.y + r.height; ++y) {
    for (int x = r.x; x + 1 < r.x + r.width; ++x) {
      const double d = static_cast<double>(image[at(g, x + 1, y)]) - static_cast<double>(image[at(g, x, y)]);
      sum += d * d;
    }
  }
  return sum / (static_cast<double>(r.width) * r.height);
}

// The region with most detail, on a coarse raster.
Region busiest(const std::vector<float>& truth, Geometry g) {
  const Region whole{0, 0, std::min(kCloseUpColumns, g.width), std::min(kCloseUpRows, g.height)};
  Region best = whole;
  double most = -1.0;
  for (int y = 0; y + whole.height <= g.height; y += 8) {
    for (int x = 0; x + whole.width <= g.width; x += 16) {
      const Region r{x, y, whole.width, whole.height};
      if (const double d = detail_of(truth, g, r); d > most) {
        most = d;
        best = r;
      }
    }
  }
  return best;
}

struct Range {
  double low = 0.0;
  double high = 1.0;
};

Range value_range_of(const std::vector<float>& values) {
  const std::vector<double> sorted(values.begin(), values.end());
  return {quantile(sorted, 0.005), quantile(sorted, 0.995)};
}

std::vector<float> part_of(const std::vector<float>& image, Geometry g, Region r) {
  std::vector<float> part;
  for (int y = r.y; y < r.y + r.height; ++y) {
    const auto row = image.begin() + static_cast<std::ptrdiff_t>(at(g, r.x, y));
    part.insert(part.end(), row, row + r.width);
  }
  return part;
}

plot::Plot plane(const std::vector<float>& image, Geometry g, Region region, Range range, double width) {
  return {.plane = {.width = region.width,
                    .height = region.height,
                    .values = part_of(image, g, region),
                    .ramp = plot::Ramp::kIron,
                    .low = range.low,
                    .high = range.high,
                    .unit = "K"},
          .width = width,
          .height = (width - kSides) * region.height / region.width};
}

// Outline of the region in the whole frame.
plot::Series frame_of(Region r) {
  const double left = r.x - 0.5;
  const double right = r.x + r.width - 0.5;
  const double top = r.y - 0.5;
  const double bottom = r.y + r.height - 0.5;
  return {
      .hue = Hue::kWhite, .x = {left, right, right, left, left}, .y = {top, top, bottom, bottom, top}, .width = 1.5};
}

struct Layer {
  const std::vector<float>* image;
  std::string title;
  std::string name;
  Hue hue;
};

int middle_row(Region region) { return region.y + region.height / 2; }

plot::Plot profile(const std::vector<Layer>& layers, Geometry g, Region region) {
  const int row = middle_row(region);
  plot::Plot out{.title = "Along the line in the close-ups",
                 .caption = "Where blurred climbs slowly and too late, deblurred should follow the truth.",
                 .x = {.name = "column", .unit = "px"},
                 .y = {.name = "temperature", .unit = "K"},
                 .width = kPictureWidth,
                 .height = 230.0};
  for (const Layer& layer : layers) {
    plot::Series series{.label = layer.name, .hue = layer.hue};
    for (int x = region.x; x < region.x + region.width; ++x) {
      series.x.push_back(x);
      series.y.push_back(static_cast<double>((*layer.image)[at(g, x, row)]));
    }
    out.series.push_back(std::move(series));
  }
  return out;
}

plot::Plot latency_plot(const LiveFigures& figures, const std::string& title, Hue hue) {
  plot::Plot out{
      .title = title,
      .caption = "First packet received to published. Below the period between two frames nothing queues up.",
      .x = {.name = "time", .unit = "s"},
      .y = {.name = "latency", .unit = "ms", .low = 0.0},
      .levels = {{quantile(figures.latency_ms, 0.5), "p50"},
                 {quantile(figures.latency_ms, 0.99), "p99"},
                 {1e3 * figures.period_s, "frame period"}},
      .width = kPictureWidth,
      .height = 150.0};
  plot::Series series{.hue = hue, .y = figures.latency_ms, .width = 1.2};
  for (std::size_t i = 0; i < figures.latency_ms.size(); ++i) {
    series.x.push_back(static_cast<double>(i) * figures.period_s);
  }
  out.series.push_back(std::move(series));
  return out;
}

constexpr int kReadTimeoutMs = 2000;

double kelvin(const bolo_shm_header& header, double count) { return header.scale * count + header.offset; }

// Adds the squared errors of one frame's planes, in kelvin, against its truth.
void add_errors(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth,
                ErrorSum& sum) {
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const double before = kelvin(header, frame.raw[i]) - static_cast<double>(truth[i]);
    const double after = kelvin(header, frame.deblurred[i]) - static_cast<double>(truth[i]);
    sum.before += before * before;
    sum.after += after * after;
  }
  sum.values += truth.size();
}

// Compares live frames with the truth; buffers are reused between frames.
class Judge {
 public:
  Judge(const capture::CaptureReader& reader, const bolo_shm_header& header)
      : reader_(reader),
        clock_(reader.t(), reader.info().format.frame_period_s),
        window_(header.window),
        raw_(reader.info().format.geometry.pixels()),
        truth_(reader.info().format.geometry.pixels()) {}

  Status judge(const bolo_shm_header& header, const shm::ReadFrame& frame, LiveOutcome& outcome) {
    const auto index = clock_.frame_at(frame.meta.camera_ns);
    if (!index) return {};
    if (reader_.info().format.type == PixelType::kUint16) {
      if (auto read = reader_.read_frame(*index, raw_.data()); !read) return read;
      if (raw_ != frame.raw) ++outcome.raw_differs;
    }
    // A window across the seam of two laps sees a jump that no camera would show: such frames are not judged.
    if (*index + 1 < window_ || (frame.meta.flags & kFlagWarmUp) != 0) return {};
    if (auto read = reader_.read_truth(*index, truth_.data()); !read) return read;
    add_errors(header, frame, truth_, outcome.error);
    ++outcome.frames_judged;
    constexpr std::uint32_t kSpared = BOLO_FLAG_REDUCED | BOLO_FLAG_INVERSE | BOLO_FLAG_RAW;
    if ((frame.meta.flags & kSpared) != 0) ++outcome.spared;
    outcome.shown.take(header, frame, truth_, *index);
    return {};
  }

 private:
  const capture::CaptureReader& reader_;
  TruthClock clock_;
  std::size_t window_;
  std::vector<std::uint16_t> raw_;
  std::vector<float> truth_;
};

// `longest_s`: how much longer than `seconds` to wait for the frame to show.
Status watch(shm::ShmReader& memory, Judge& judge, double seconds, double longest_s, LiveOutcome& outcome) {
  const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(seconds * kNsPerSecond);
  shm::ReadFrame frame;
  Progress progress("reading", static_cast<std::uint64_t>(seconds * 1000));
  std::uint64_t number = memory.published();
  outcome.first = memory.header();
  const std::int64_t last_ns = end_ns + static_cast<std::int64_t>(longest_s * kNsPerSecond);
  const auto goes_on = [&] { return monotonic_ns() < (outcome.shown.waits() ? last_ns : end_ns); };
  while (goes_on() && !interrupted()) {
    switch (memory.read(number, frame, kReadTimeoutMs)) {
      case shm::ShmReader::Outcome::kFrame:
        break;
      case shm::ShmReader::Outcome::kOverwritten: {
        const std::uint64_t newest = memory.published();
        outcome.overwritten += newest - number;
        number = newest;
        continue;
      }
      case shm::ShmReader::Outcome::kTimeout:
        return failed("no frame came for " + std::to_string(kReadTimeoutMs) +
                      " ms: look at 'bolo stat' for what the camera does");
      case shm::ShmReader::Outcome::kClosed:
        return failed("the daemon ended while its frames were read");
    }
    ++number;
    ++outcome.frames_read;
    outcome.latency_ms.push_back(static_cast<double>(frame.publish_ns - frame.meta.receive_ns) * kMsPerNs);
    if (auto judged = judge.judge(outcome.first, frame, outcome); !judged) return judged;
    progress.update(static_cast<std::uint64_t>((seconds - static_cast<double>(end_ns - monotonic_ns()) * 1e-9) * 1000));
  }
  outcome.last = memory.header();
  return {};
}

Status check_match(const capture::CaptureInfo& info, const bolo_shm_header& header) {
  if (!info.has_truth) return bad_input("the capture has no /truth: give the one that 'bolo simulate' wrote");
  const Geometry live{static_cast<int>(header.width), static_cast<int>(header.height)};
  if (info.format.geometry == live) return {};
  const Geometry& own = info.format.geometry;
  return bad_input(fmt::format(
      "the capture has {}x{} pixels, the daemon publishes {}x{}: give the capture that the fake camera replays",
      own.width, own.height, live.width, live.height));
}

}  // namespace

void FrameChoice::take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth,
                       std::size_t index) {
  if (only_ && index != *only_) return;
  const Geometry g{static_cast<int>(header.width), static_cast<int>(header.height)};
  const double detail = detail_of(truth, g, {0, 0, g.width, g.height});
  if (detail <= detail_) return;
  detail_ = detail;
  shown_ = {g, index, static_cast<double>(frame.meta.camera_ns) / kNsPerSecond, {}, {}, truth};
  const auto to_kelvin = [&](const std::vector<std::uint16_t>& counts, std::vector<float>& kelvin) {
    kelvin.resize(counts.size());
    std::transform(counts.begin(), counts.end(), kelvin.begin(),
                   [&](std::uint16_t c) { return static_cast<float>(header.scale * c + header.offset); });
  };
  to_kelvin(frame.raw, shown_.blurred);
  to_kelvin(frame.deblurred, shown_.deblurred);
}

plot::Sheet sheet_of(std::span<const LiveResult> results) {
  const ShownFrame& shown = *results.front().shown;
  const Geometry g = shown.geometry;
  const Range range = value_range_of(shown.truth);
  const Region close_up = busiest(shown.truth, g);
  std::vector<Layer> layers{
      {&shown.blurred,
       format("Blurred, as the camera sends it: RMSE %.2f K over the run", results.front().figures.rmse_before_k),
       "blurred", Hue::kBlurred}};
  for (std::size_t i = 0; i < results.size(); ++i) {
    const LiveFigures& figures = results[i].figures;
    const std::string what = results.size() > 1 ? "Deblurred by " + figures.name : "Deblurred";
    layers.push_back({&results[i].shown->deblurred,
                      what + format(", live: RMSE %.2f K over the run", figures.rmse_after_k), figures.name,
                      kSolverHues[i % kSolverHues.size()]});
  }
  layers.push_back({&shown.truth, "Truth: what a camera without thermal inertia would see", "truth", Hue::kTruth});
  const auto columns = static_cast<double>(layers.size());
  const double close_up_width = (kPictureWidth - (columns - 1.0) * kBetween) / columns;
  plot::Sheet sheet{.title = format("One frame of the live stream, camera time %.3f s", shown.camera_s)};
  std::vector<plot::Plot> close_ups;
  for (const Layer& layer : layers) {
    plot::Plot whole = plane(*layer.image, g, {0, 0, g.width, g.height}, range, kPictureWidth);
    whole.title = layer.title;
    whole.series.push_back(frame_of(close_up));
    sheet.rows.push_back({std::move(whole)});
    plot::Plot close = plane(*layer.image, g, close_up, range, close_up_width);
    close.title = "Close-up: " + layer.name;
    const auto row = static_cast<double>(middle_row(close_up) - close_up.y);
    close.series.push_back({.hue = Hue::kWhite, .x = {-0.5, close_up.width - 0.5}, .y = {row, row}, .width = 1.0});
    close_ups.push_back(std::move(close));
  }
  sheet.rows.push_back(std::move(close_ups));
  sheet.rows.push_back({profile(layers, g, close_up)});
  for (std::size_t i = 0; i < results.size(); ++i) {
    const std::string title = "Latency of each frame" + (results.size() > 1 ? ", " + results[i].figures.name : "");
    sheet.rows.push_back({latency_plot(results[i].figures, title, kSolverHues[i % kSolverHues.size()])});
  }
  return sheet;
}

TruthClock::TruthClock(const std::vector<double>& t, double period_s)
    : t_(t), period_s_(period_s), first_s_(t.front()), lap_s_(t.back() - t.front() + period_s) {
  for (double& time : t_) time -= first_s_;
}

std::optional<std::size_t> TruthClock::frame_at(std::int64_t camera_ns) const {
  const double since_first = static_cast<double>(camera_ns) / kNsPerSecond - first_s_;
  if (since_first < -period_s_ / 4) return std::nullopt;
  // A tolerance of a quarter period, so that rounding cannot move a lap's first frame to the end of the lap before.
  const double in_lap = std::fmod(since_first + period_s_ / 4, lap_s_) - period_s_ / 4;
  const auto after = std::lower_bound(t_.begin(), t_.end(), in_lap - period_s_ / 4);
  if (after == t_.end() || std::abs(*after - in_lap) > period_s_ / 4) return std::nullopt;
  return static_cast<std::size_t>(after - t_.begin());
}

Result<LiveOutcome> check_live(const std::string& name, const std::filesystem::path& truth, double seconds,
                               std::optional<std::size_t> shown) {
  ASSIGN_OR_RETURN(auto reader, capture::CaptureReader::open(truth));
  ASSIGN_OR_RETURN(auto memory, shm::ShmReader::open(name));
  const bolo_shm_header header = memory.header();
  if (auto match = check_match(reader.info(), header); !match) return at(truth.string(), match.error());
  LiveOutcome outcome;
  outcome.shown = FrameChoice(shown);
  Judge judge(reader, header);
  const double two_laps_s = 2.0 * (reader.t().back() - reader.t().front());
  RETURN_IF_ERROR(watch(memory, judge, seconds, two_laps_s, outcome));
  if (outcome.frames_judged == 0) {
    return failed(fmt::format(
        "none of {} frames could be matched with the truth in {}: is it the capture that the fake camera replays?",
        outcome.frames_read, truth.string()));
  }
  return outcome;
}

nlohmann::ordered_json to_json(const LiveOutcome& o) {
  const double deblurred = static_cast<double>(o.last.published - o.first.published);
  nlohmann::ordered_json lost;
  for (std::size_t c = 0; c < kLossCauses; ++c) {
    lost[std::string(name(static_cast<LossCause>(c)))] = o.last.lost[c];
  }
  return {{"frames_in", o.last.received - o.first.received},
          {"frames_out", o.last.published - o.first.published},
          {"frames_read", o.frames_read},
          {"frames_overwritten", o.overwritten},
          {"frames_judged", o.frames_judged},
          {"frames_spared", o.spared},
          {"raw_frames_not_exact", o.raw_differs},
          {"lost_since_start", lost},
          {"latency_ms",
           {{"p50", quantile(o.latency_ms, 0.5)},
            {"p99", quantile(o.latency_ms, 0.99)},
            {"max", quantile(o.latency_ms, 1.0)}}},
          {"deblur_ms_per_frame",
           deblurred > 0 ? static_cast<double>(o.last.deblur_ns - o.first.deblur_ns) * kMsPerNs / deblurred : 0.0},
          {"solver", std::string(o.last.solver)},
          {"rmse_before_k", o.error.rmse_before()},
          {"rmse_after_k", o.error.rmse_after()}};
}

void print_text(const nlohmann::ordered_json& j) {
  const auto count = [&](const char* key) { return j.at(key).get<unsigned long long>(); };
  std::printf("frames in            %llu   received whole from the camera while watching\n", count("frames_in"));
  std::printf("frames out           %llu   published to shared memory, %llu read by this process, %llu missed by it\n",
              count("frames_out"), count("frames_read"), count("frames_overwritten"));
  std::printf("lost, by cause      ");
  for (const auto& [cause, frames] : j.at("lost_since_start").items()) {
    std::printf(" %s %llu", cause.c_str(), frames.get<unsigned long long>());
  }
  std::printf("   since the daemon's start\n");
  std::printf("raw planes           %llu differ from the capture\n", count("raw_frames_not_exact"));
  const auto& latency = j.at("latency_ms");
  std::printf("latency, ms          p50 %.2f  p99 %.2f  max %.2f   first packet received to published\n",
              latency.at("p50").get<double>(), latency.at("p99").get<double>(), latency.at("max").get<double>());
  std::printf("deblurring           %.2f ms a frame   %s\n", j.at("deblur_ms_per_frame").get<double>(),
              j.at("solver").get<std::string>().c_str());
  std::printf("RMSE against truth   before %.3f K, after %.3f K   %llu frames, every pixel\n",
              j.at("rmse_before_k").get<double>(), j.at("rmse_after_k").get<double>(), count("frames_judged"));
  if (count("frames_spared") > 0) {
    std::printf("less spent on        %llu of these: the computer was too busy for this solver on every frame\n",
                count("frames_spared"));
  }
}

}  // namespace bolo::tools
