// Still fields, and the calibration from all captures together.
#include "src/diagnose/calibrate.hpp"

#include "src/diagnose/session.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kNoisy = 4.0;    // times the median noise
constexpr double kFrozen = 0.1;   // of the median noise
constexpr double kStill = 3.0;    // scatter of frame means, in units of a pixel's noise
constexpr double kSlow = 1.5;     // slow changes of a pixel, in units of its noise
constexpr double kUneven = 3.0;   // times the median noise: if over 5 % of the pixels exceed it, the scene moves
constexpr double kFarOff = 12.0;  // outlier limit, in scatters of the fixed pattern

// Sums over time. `rough`: of squared differences between neighbouring frames, without what all pixels share.
struct Moments {
  std::vector<float> base;
  std::vector<double> y, yy, rough;
  std::vector<double> frame_mean;  // less the first frame's
};

Result<Moments> moments_of(const FrameSeries& frames, const Progress& progress) {
  const std::size_t pixels = frames.geometry.pixels();
  Moments m;
  m.y = m.yy = m.rough = std::vector<double>(pixels, 0.0);
  std::vector<float> last;
  std::vector<double> change(pixels);
  RETURN_IF_ERROR(frames.for_each("still field", progress, [&](std::size_t k, std::span<const float> frame) {
    if (k == 0) m.base = last = {frame.begin(), frame.end()};
    double sum = 0.0;
    for (std::size_t p = 0; p < pixels; ++p) {
      const double y = static_cast<double>(frame[p]) - m.base[p];
      m.y[p] += y;
      m.yy[p] += y * y;
      change[p] = static_cast<double>(frame[p]) - last[p];
      sum += y;
    }
    const double shared = median(change);
    for (std::size_t p = 0; p < pixels; ++p) m.rough[p] += (change[p] - shared) * (change[p] - shared);
    m.frame_mean.push_back(sum / static_cast<double>(pixels));
    std::ranges::copy(frame, last.begin());
  }));
  return m;
}

// True if the scene changed: the frames' mean or single pixels change slowly, or some pixels scatter far more than
// most. Variances: of each pixel over time, of its steps between frames (`own`), and of the frames' means.
bool moves(const std::vector<double>& variance, const std::vector<double>& own, double of_means, double least) {
  const double usual = std::max(median(own), least * least);
  const double slow = median(variance) - usual - of_means;
  return of_means > kStill * kStill * usual || slow > kSlow * kSlow * usual ||
         quantile(own, 0.95) > kUneven * kUneven * usual;
}

double mean_over(const std::vector<double>& values, const std::vector<std::size_t>& pixels) {
  return sum_of(pixels, [&](std::size_t p) { return values[p]; }) / std::max(1.0, static_cast<double>(pixels.size()));
}

constexpr std::size_t kKeptBytes = std::size_t{512} << 20U;  // larger recordings are read again from the file

Result<FrameSeries> open_series(const std::filesystem::path& file, FrameReader& reader, const Progress& progress) {
  const StreamFormat format = reader.format();
  FrameSeries series;
  series.name = file.string();
  series.geometry = format.geometry;
  series.t_s = reader.capture().t();
  const bool counts = format.type == PixelType::kUint16;
  series.step = counts ? (format.scale.unit == Unit::kKelvin ? std::abs(format.scale.scale) : 1.0) : 0.0;
  series.sixteen_bits = counts;
  series.lowest = std::min(format.scale.to_physical(0.0), format.scale.to_physical(65535.0));
  series.highest = std::max(format.scale.to_physical(0.0), format.scale.to_physical(65535.0));
  series.read = [&reader](std::size_t k, std::span<float> out) -> Status {
    RETURN_IF_ERROR(reader.read(k, 0, out));
    return {};
  };
  const std::size_t pixels = format.geometry.pixels();
  if (series.t_s.size() * pixels > kKeptBytes / sizeof(float)) return series;
  auto all = std::make_shared<std::vector<float>>(series.t_s.size() * pixels);
  RETURN_IF_ERROR(series.for_each("reading", progress, [&](std::size_t k, std::span<const float> frame) {
    std::ranges::copy(frame, all->begin() + static_cast<std::ptrdiff_t>(k * pixels));
  }));
  series.read = [all, pixels](std::size_t k, std::span<float> out) -> Status {
    std::copy_n(all->data() + k * pixels, pixels, out.begin());
    return {};
  };
  return series;
}

struct Source {
  std::filesystem::path file;
  FrameReader reader;
  bool still = false;  // by its /stimulus; without one, any capture but the first
};

Result<std::vector<Source>> open_sources(const std::vector<std::filesystem::path>& files) {
  std::vector<Source> sources;
  for (const auto& file : files) {
    ASSIGN_OR_RETURN(auto reader, FrameReader::open(file));
    ASSIGN_OR_RETURN(const auto stimulus, reader.capture().stimulus());
    const bool chopper = std::holds_alternative<capture::Chopper>(stimulus);
    const bool uniform = std::holds_alternative<capture::Uniform>(stimulus);
    sources.push_back({file, std::move(reader), uniform || (!chopper && !sources.empty())});
    const capture::CaptureInfo& first = sources.front().reader.capture().info();
    const capture::CaptureInfo& info = sources.back().reader.capture().info();
    const auto differs = [&](const std::string& what) {
      return bad_input(file.string() + ": " + what + " than in " + sources.front().file.string() +
                       "; give captures of one camera in one mode");
    };
    if (info.format.geometry != first.format.geometry) return differs("another size of frames");
    if (info.camera_model != first.camera_model || info.camera_serial != first.camera_serial) {
      return differs("another camera");
    }
    if (info.format.scale.unit != first.format.scale.unit) return differs("another unit");
  }
  return sources;
}

// Merges still fields: noise as rms, offsets as their mean; a pixel dead in any of them is dead.
void merge(StillFit& all, const StillFit& more, double before) {
  const auto blend = [before](double a, double b) { return (a * before + b) / (before + 1.0); };
  for (double StillFit::*const rms : {&StillFit::noise_k, &StillFit::pixel_noise_k, &StillFit::offset_rms_k}) {
    all.*rms = std::sqrt(blend(all.*rms * all.*rms, more.*rms * more.*rms));
  }
  if (all.offset_k.empty() && !more.offset_k.empty()) all.offset_k.assign(all.dead.size(), 0.0F);
  for (std::size_t p = 0; p < all.dead.size(); ++p) {
    if (!all.offset_k.empty()) {
      all.offset_k[p] = static_cast<float>(blend(all.offset_k[p], more.offset_k.empty() ? 0.0 : more.offset_k[p]));
    }
    if (all.dead[p] == DeadPixel::kGood) all.dead[p] = more.dead[p];
  }
}

void fill_profile(const capture::CaptureInfo& info, const FrameSeries& frames, Calibration& result) {
  model::CameraProfile& profile = result.profile;
  profile.tau_s = result.fit.tau_s.value;
  profile.maps.clear();
  if (!info.camera_model.empty()) profile.model = info.camera_model;
  if (!info.camera_serial.empty()) profile.serial = info.camera_serial;
  profile.frame_period_s = info.format.frame_period_s;
  result.unit = info.format.scale.unit;
  if (info.format.scale.unit == Unit::kKelvin) {
    profile.noise_k = result.noise_k;
    if (frames.step > 0.0) profile.quantisation_k = frames.step;
  } else {
    result.warnings.emplace_back("the captures have counts and no kelvin: the profile keeps its noise_k");
  }
  result.maps.geometry = frames.geometry;
  result.maps.tau_s = result.fit.tau_map_s;
  if (result.still) result.maps.offset = result.still->offset_k;
  result.dead = result.fit.dead;
  for (std::size_t p = 0; result.still && p < result.dead.size(); ++p) {
    if (result.still->dead[p] != DeadPixel::kGood) result.dead[p] = result.still->dead[p];
  }
  auto dead = mapped(result.dead, [](DeadPixel pixel) -> std::uint8_t { return pixel == DeadPixel::kGood ? 0 : 1; });
  result.dead_pixels = static_cast<std::size_t>(std::ranges::count(dead, std::uint8_t{1}));
  if (result.dead_pixels > 0) result.maps.dead = std::move(dead);
}

}  // namespace

Status FrameSeries::for_each(const char* doing, const Progress& progress, const Work& work, std::size_t first,
                             std::size_t end) const {
  std::vector<float> frame(geometry.pixels());
  for (std::size_t k = first; k < std::min(end, t_s.size()); ++k) {
    if (!progress(doing, static_cast<double>(k) / static_cast<double>(t_s.size()))) return failed("interrupted");
    RETURN_IF_ERROR(read(k, frame));
    if (!std::ranges::all_of(frame, [](float v) { return std::isfinite(v); })) {
      return bad_input(name + ": /frames has values that are no numbers");
    }
    work(k, frame);
  }
  return {};
}

Result<StillFit> fit_still(const FrameSeries& frames, const Progress& progress) {
  if (frames.t_s.size() < kFewestFrames) {
    return bad_input(frames.name + ": has " + std::to_string(frames.t_s.size()) + " frames; at least " +
                     std::to_string(kFewestFrames) + " are needed");
  }
  ASSIGN_OR_RETURN(const auto moments, moments_of(frames, progress));
  const auto n = static_cast<double>(frames.t_s.size());
  const std::size_t pixels = frames.geometry.pixels();
  std::vector<double> variance(pixels);
  std::vector<double> own(pixels);
  std::vector<double> level(pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    const double mean = moments.y[p] / n;
    variance[p] = std::max(0.0, moments.yy[p] / n - mean * mean) * n / (n - 1.0);
    own[p] = moments.rough[p] / (2.0 * (n - 1.0));
    level[p] = moments.base[p] + mean;
  }
  StillFit fit;
  const std::vector<double> noise = mapped(variance, [](double v) { return std::sqrt(v); });
  const double usual = median(noise);
  const double centre = median(level);
  const std::vector<double> away = mapped(level, [centre](double v) { return std::abs(v - centre); });
  const double scatter = median(away) / kMadOfSigma + usual;
  fit.dead.assign(pixels, DeadPixel::kGood);
  for (std::size_t p = 0; p < pixels; ++p) {
    if (noise[p] > kNoisy * usual && usual > 0.0) fit.dead[p] = DeadPixel::kNoisy;
    if (away[p] > kFarOff * scatter && usual > 0.0) fit.dead[p] = DeadPixel::kSilent;
    if (noise[p] < kFrozen * usual) fit.dead[p] = DeadPixel::kFrozen;
  }
  const auto pixels_left = places_where(pixels, [&](std::size_t p) { return fit.dead[p] == DeadPixel::kGood; });
  const auto good = static_cast<double>(pixels_left.size());
  fit.noise_k = std::sqrt(mean_over(variance, pixels_left));
  fit.pixel_noise_k = std::sqrt(mean_over(own, pixels_left));
  const double drift = sum_of(moments.frame_mean, [n](double v) { return v / n; });
  const double of_means = sum_of(moments.frame_mean, [=](double v) { return (v - drift) * (v - drift) / n; });
  if (moves(variance, own, of_means, 0.5 * frames.step)) {
    return bad_input(frames.name +
                     ": is no still field: it changes by more than noise does; give a closed shutter or a flat black "
                     "body");
  }
  const double mean = mean_over(level, pixels_left);
  const double pattern2 = sum_of(
      pixels_left, [&](std::size_t p) { return (level[p] - mean) * (level[p] - mean) / std::max(1.0, good - 1.0); });
  const double error2 = std::pow(fit.pixel_noise_k, 2) / n;
  const double own2 = std::max(0.0, pattern2 - error2);
  fit.offset_rms_k = std::sqrt(own2);
  // The pattern is real if the scatter of the levels is significant.
  if (own2 > 4.0 * error2 * std::sqrt(2.0 / std::max(1.0, good)) + 1e-12) {
    const double reliability = own2 / (own2 + error2);
    fit.offset_k.assign(pixels, 0.0F);
    for (const std::size_t p : pixels_left) fit.offset_k[p] = static_cast<float>(-reliability * (level[p] - mean));
  }
  return fit;
}

Result<Calibration> calibrate(const std::vector<std::filesystem::path>& captures, const model::CameraProfile& known,
                              const Progress& progress) {
  if (captures.empty()) return bad_input("no captures; name one with pulses first");
  ASSIGN_OR_RETURN(auto sources, open_sources(captures));
  const auto pulses = std::ranges::find(sources, false, &Source::still);
  if (pulses == sources.end()) {
    return bad_input(captures.front().string() +
                     ": no capture with pulses is given; name a recording of a chopper or a switched board");
  }
  Calibration result;
  result.profile = known;
  ASSIGN_OR_RETURN(const auto frames, open_series(pulses->file, pulses->reader, progress));
  ASSIGN_OR_RETURN(result.fit, fit_pulses(frames, progress));
  result.pulses.push_back(pulses->file.string());

  for (Source& source : sources) {
    if (&source == &*pulses) continue;
    if (!source.still) {
      result.warnings.push_back(source.file.string() + ": not used: one capture with pulses is enough");
      continue;
    }
    ASSIGN_OR_RETURN(const auto still, open_series(source.file, source.reader, progress));
    ASSIGN_OR_RETURN(auto found, fit_still(still, progress));
    if (result.still) {
      merge(*result.still, found, static_cast<double>(result.stills.size()));
    } else {
      result.still = std::move(found);
    }
    result.stills.push_back(source.file.string());
  }
  result.noise_k = result.still ? result.still->noise_k : result.fit.noise_k;
  result.gap = result.noise_k > 0.0 ? result.fit.rmse_k / result.noise_k : result.fit.gap;
  fill_profile(pulses->reader.capture().info(), frames, result);
  return result;
}

}  // namespace bolo::diagnose
