#include "tools/lab/recording.hpp"

#include <cstring>

#include "src/core/clock.hpp"
#include "src/sim/field.hpp"

namespace bolo::tools {
Result<Recording> record_street(const sim::CameraSettings& camera, const StreetPass& pass) {
  const auto street = sim::make_street(camera.geometry, pass.street);
  const sim::Path path = sim::steady_pan(pass.speed_px_s);
  const double from_s = -sim::history_s(camera);
  const double to_s = static_cast<double>(pass.frames + pass.more_frames) / camera.rate_hz;
  const sim::Position origin = sim::centred_origin(*street, path, camera.geometry, from_s, to_s);
  ASSIGN_OR_RETURN(auto field, sim::pan_over(*street, path, origin, camera.geometry, from_s, to_s));
  ASSIGN_OR_RETURN(const auto simulator, sim::Simulator::create(camera, std::move(field)));
  Recording recording;
  recording.format = simulator->format();
  for (std::size_t k = 0; k < pass.frames; ++k) {
    recording.planes.emplace_back(plane_bytes(recording.format.geometry, recording.format.type));
    recording.truth.emplace_back(recording.format.geometry.pixels());
    simulator->next(recording.planes.back().data(), recording.truth.back().data());
  }
  return recording;
}

Status RecordingSource::start(pipeline::FrameInlet& inlet) {
  thread_ = std::thread([this, &inlet] { feed(inlet); });
  return {};
}

void RecordingSource::stop() noexcept {
  stop_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) thread_.join();
}

void RecordingSource::feed(pipeline::FrameInlet& inlet) noexcept {
  for (std::size_t k = 0; k < recording_.planes.size(); ++k) {
    rt::FrameSlot* const slot = inlet.borrow_wait(stop_);
    if (slot == nullptr) break;
    std::memcpy(slot->data, recording_.planes[k].data(), recording_.planes[k].size());
    slot->meta.frame_id = k;
    slot->meta.camera_ns = to_ns(static_cast<double>(k) * recording_.format.frame_period_s);
    slot->meta.receive_ns = monotonic_ns();
    inlet.commit(*slot);
  }
  inlet.finish();
}

}  // namespace bolo::tools
