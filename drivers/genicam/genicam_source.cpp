#include "drivers/genicam/genicam_source.hpp"

#include <mutex>
#include <utility>

#include "drivers/genicam/connection_manager.hpp"
#include "drivers/genicam/session.hpp"

namespace bolo::genicam {

struct GenicamSource::Impl {
  explicit Impl(CameraOptions o) : options(std::move(o)) {}

  std::shared_ptr<ConnectionManager> current() const {
    const std::lock_guard lock(mutex);
    return manager;
  }

  CameraOptions options;  // once a camera was found, with its address
  const std::atomic<bool> never{false};
  // Shared with the connection manager, which may outlive this by a few seconds.
  const std::shared_ptr<pipeline::SourceStatus> status = std::make_shared<pipeline::SourceStatus>();
  pipeline::SourceInfo info;
  std::unique_ptr<Session> opened;             // from open() to start()
  mutable std::mutex mutex;                    // guards what follows; never taken by the acquire thread
  std::shared_ptr<ConnectionManager> manager;  // from start() on; stopped or not
  std::vector<std::string> warnings;
};

GenicamSource::GenicamSource(CameraOptions options) : impl_(std::make_unique<Impl>(std::move(options))) {}

GenicamSource::~GenicamSource() { stop(); }

Result<pipeline::SourceInfo> GenicamSource::open() {
  std::vector<std::string> found;
  ASSIGN_OR_RETURN(impl_->opened, Session::open(impl_->options, true, impl_->never, found));
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
    RETURN_IF_ERROR(open());
    if (before.format.geometry.pixels() > 0 && impl_->info.format != before.format) {
      return failed("the camera came back with another size, rate or unit than it was opened with");
    }
  }
  auto manager = std::make_shared<ConnectionManager>(impl_->options, impl_->info, inlet, impl_->status);
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->manager = manager;
  }
  return manager->start(std::move(impl_->opened));
}

void GenicamSource::stop() noexcept {
  if (const auto manager = impl_->current()) manager->stop();
}

const pipeline::SourceStatus* GenicamSource::status() const noexcept { return impl_->status.get(); }

TransportStats GenicamSource::transport_stats() const {
  const auto manager = impl_->current();
  return manager != nullptr ? manager->transport() : TransportStats{};
}

std::vector<std::string> GenicamSource::warnings() const {
  const auto manager = impl_->current();
  std::vector<std::string> all = manager != nullptr ? manager->warnings() : std::vector<std::string>{};
  const std::lock_guard lock(impl_->mutex);
  all.insert(all.begin(), impl_->warnings.begin(), impl_->warnings.end());
  return all;
}

std::vector<pipeline::Notice> GenicamSource::take_notices() {
  const auto manager = impl_->current();
  return manager != nullptr ? manager->take_notices() : std::vector<pipeline::Notice>{};
}

Status GenicamSource::trigger_nuc() {
  const auto manager = impl_->current();
  if (manager == nullptr) return failed("the camera is not started");
  return manager->trigger_nuc();
}

void GenicamSource::set_nuc(const NucOptions& nuc) {
  if (const auto manager = impl_->current(); manager != nullptr) manager->set_nuc(nuc);
}

}  // namespace bolo::genicam
