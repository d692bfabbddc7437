#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::testing {
namespace {

std::unique_ptr<const sim::Field> field_of(const capture::Stimulus& stimulus) {
  if (const auto* uniform = std::get_if<capture::Uniform>(&stimulus)) return sim::make_uniform(uniform->temperature_k);
  if (const auto* chopper = std::get_if<capture::Chopper>(&stimulus)) return sim::make_chopper(*chopper);
  return sim::make_bars(std::get<capture::BarTarget>(stimulus));
}

Kind kind_of(const capture::Stimulus& stimulus) {
  if (std::holds_alternative<capture::Uniform>(stimulus)) return Kind::kUniform;
  if (std::holds_alternative<capture::Chopper>(stimulus)) return Kind::kChopper;
  return std::get<capture::BarTarget>(stimulus).velocity_px_s == 0.0 ? Kind::kStillBars : Kind::kMovingBars;
}

Recording blank(const capture::Stimulus& stimulus, int frames) {
  Recording r;
  r.kind = kind_of(stimulus);
  r.step = 0.01;
  r.stimulus = stimulus;
  for (int k = 0; k < frames; ++k) r.t.push_back(k * kPeriodS);
  r.values.resize(frames, kWidth * kHeight);
  r.used.assign(static_cast<std::size_t>(frames), 1);
  return r;
}

}  // namespace

sim::CameraSettings ideal_camera() {
  sim::CameraSettings camera;
  camera.geometry = {kWidth, kHeight};
  camera.readout.noise_k = 0.0;
  camera.readout.quantisation_k = 0.0;
  camera.readout.type = PixelType::kFloat32;
  camera.threads = 1;
  return camera;
}

sim::CameraSettings noisy_camera(std::uint64_t seed) {
  sim::CameraSettings camera = ideal_camera();
  camera.readout.noise_k = 0.03;
  camera.readout.quantisation_k = 0.01;
  camera.readout.seed = seed;
  return camera;
}

capture::Chopper odd_chopper() {
  capture::Chopper chopper;
  chopper.cold_k = 295.0;
  double on_s = 0.0837;
  for (const double level_k : {305.0, 320.0}) {
    for (const double pulse_s : {0.012, 0.0313, 0.06, 0.1201}) {
      chopper.on_s.push_back(on_s);
      chopper.off_s.push_back(on_s + pulse_s);
      chopper.level_k.push_back(level_k);
      on_s += pulse_s + 0.0837;
    }
  }
  return chopper;
}

capture::BarTarget slanted_bars(double velocity_px_s) { return {290.0, 315.0, 20.0, 10.0, 0.25, velocity_px_s}; }

Recording record(const sim::CameraSettings& camera, const capture::Stimulus& stimulus, int frames,
                 const sim::StimulusError& error) {
  Recording r = blank(stimulus, frames);
  auto field = must(sim::with_errors(field_of(stimulus), error, camera.geometry));
  auto simulator = must(sim::Simulator::create(camera, std::move(*field)));
  for (int k = 0; simulator && k < frames; ++k) (*simulator)->next(r.values.row(k).data(), nullptr);
  return r;
}

Session session_of(std::vector<Recording> recordings) {
  Session session;
  session.width = kWidth;
  session.height = kHeight;
  session.period_s = kPeriodS;
  session.grid.rows.resize(kHeight);
  session.grid.columns.resize(kWidth);
  std::iota(session.grid.rows.begin(), session.grid.rows.end(), 0);
  std::iota(session.grid.columns.begin(), session.grid.columns.end(), 0);
  session.good.assign(static_cast<std::size_t>(session.grid.pixels()), 1);
  session.recordings = std::move(recordings);
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    session.recordings[i].name = "recording-" + std::to_string(i + 1);
  }
  measure(session);
  return session;
}

void measure(Session& session) {
  for (Recording& r : session.recordings) {
    FrameStatisticsSum sum(session.width, session.height);
    for (Eigen::Index k = 0; k < r.values.rows(); ++k) {
      sum.add({r.values.row(k).data(), static_cast<std::size_t>(r.values.cols())});
    }
    r.statistics = sum.statistics();
  }
}

Recording empty_shutter(int frames) { return blank(capture::Uniform{300.0}, frames); }

std::filesystem::path write(const Recording& recording, const std::filesystem::path& file, const std::string& model) {
  const auto fill = [&recording](int k, std::vector<std::uint16_t>& counts) {
    for (std::size_t p = 0; p < counts.size(); ++p) {
      const double count = std::round(static_cast<double>(recording.values(k, static_cast<Eigen::Index>(p))) / 0.01);
      counts[p] = static_cast<std::uint16_t>(std::clamp(count, 0.0, 65535.0));
    }
  };
  return write_capture<std::uint16_t>(file, {kWidth, kHeight}, recording.frames(), fill, recording.stimulus, kPeriodS,
                                      model);
}

Report diagnosed(const std::vector<std::filesystem::path>& files, const Options& options) {
  return *must(diagnose(files, options, go_on));
}

bool has(const Report& report, const std::string& effect) {
  return std::ranges::count(report.effects, effect, &FoundEffect::name) != 0;
}

std::string told(const Report& report) {
  std::string all = report.verdict + ":";
  for (const FoundEffect& effect : report.effects) all += ' ' + effect.name;
  return all;
}

}  // namespace bolo::diagnose::testing
