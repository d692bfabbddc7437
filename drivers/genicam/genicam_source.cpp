#include "drivers/genicam/genicam_source.hpp"

#include <mutex>
#include <utility>

#include "drivers/genicam/keeper.hpp"
#include "drivers/genicam/session.hpp"

namespace bolo::genicam {

struct GenicamSource::Impl {
  explicit Impl(CameraOptions o) : options(std::move(o)) {}

  std::shared_ptr<Keeper> present() const {
    const std::lock_guard lock(mutex);
    return keeper;
  }

  CameraOptions options;  // once a camera was found, with its address
  const std::atomic<bool> never{false};
  // Shared with the keeper, which may outlive this by a few seconds.
  const std::shared_ptr<pipeline::SourceStatus> status = std::make_shared<pipeline::SourceStatus>();
  pipeline::SourceInfo info;
  std::unique_ptr<Session> opened;  // from open() to start()
  mutable std::mutex mutex;         // guards what follows; never taken by the acquire thread
  std::shared_ptr<Keeper> keeper;   // from start() on; stopped or not
  std::vector<std::string> warnings;
};

GenicamSource::GenicamSource(CameraOptions options) : impl_(std::make_unique<Impl>(std::move(options))) {}

GenicamSource::~GenicamSource() { stop(); }

Result<pipeline::SourceInfo> GenicamSource::open() {
  std::vector<std::string> found;
  auto session = Session::open(impl_->options, true, impl_->never, found);
  if (!session) return tl::unexpected<Error>(std::move(session.error()));
  impl_->opened = std::move(*session);
  impl_->info = impl_->opened->info();
  if (!impl_->opened->address().empty()) impl_->options.address = impl_->opened->address();
  if (impl_->options.serial.empty()) impl_->options.serial = impl_->info.camera_serial;
  const std::lock_guard lock(impl_->mutex);
  impl_->warnings = std::move(found);
  return impl_->info;
}

Status GenicamSource::start(pipeline::FrameInlet& inlet) {
  stop();
  if (impl_->opened == nullptr) {
    const pipeline::SourceInfo before = impl_->info;
    if (auto again = open(); !again) return tl::unexpected<Error>(std::move(again.error()));
    if (before.format.geometry.pixels() > 0 && impl_->info.format != before.format) {
      return failed("the camera came back with another size, rate or unit than it was opened with");
    }
  }
  auto keeper = std::make_shared<Keeper>(impl_->options, impl_->info, inlet, impl_->status);
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->keeper = keeper;
  }
  return keeper->start(std::move(impl_->opened));
}

void GenicamSource::stop() noexcept {
  if (const auto keeper = impl_->present()) keeper->stop();
}

const pipeline::SourceStatus* GenicamSource::status() const noexcept { return impl_->status.get(); }

TransportStats GenicamSource::transport_stats() const {
  const auto keeper = impl_->present();
  return keeper != nullptr ? keeper->transport() : TransportStats{};
}

std::vector<std::string> GenicamSource::warnings() const {
  const auto keeper = impl_->present();
  std::vector<std::string> all = keeper != nullptr ? keeper->warnings() : std::vector<std::string>{};
  const std::lock_guard lock(impl_->mutex);
  all.insert(all.begin(), impl_->warnings.begin(), impl_->warnings.end());
  return all;
}

std::vector<pipeline::Notice> GenicamSource::take_notices() {
  const auto keeper = impl_->present();
  return keeper != nullptr ? keeper->take_notices() : std::vector<pipeline::Notice>{};
}

Status GenicamSource::correct() {
  const auto keeper = impl_->present();
  if (keeper == nullptr) return failed("the camera is not started");
  return keeper->correct();
}

void GenicamSource::set_nuc(const NucOptions& nuc) {
  if (const auto keeper = impl_->present(); keeper != nullptr) keeper->set_nuc(nuc);
}

const rt::LatencyHistogram& GenicamSource::receive_latency() const noexcept {
  static const rt::LatencyHistogram kNone;
  const auto keeper = impl_->present();
  return keeper != nullptr ? keeper->latency() : kNone;
}

}  // namespace bolo::genicam
