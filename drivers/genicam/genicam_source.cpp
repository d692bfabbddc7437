#include "drivers/genicam/genicam_source.hpp"

#include <utility>

#include "drivers/genicam/connection_manager.hpp"

namespace bolo::genicam {

GenicamSource::GenicamSource(CameraOptions options)
    : manager_(std::make_shared<ConnectionManager>(std::move(options))) {}

GenicamSource::~GenicamSource() { stop(); }

Result<pipeline::SourceInfo> GenicamSource::open() { return manager_->open(); }
Status GenicamSource::start(pipeline::FrameInlet& inlet) { return manager_->start(inlet); }
void GenicamSource::stop() noexcept { manager_->stop(); }

const pipeline::SourceStatus* GenicamSource::status() const noexcept { return &manager_->status(); }
std::vector<std::string> GenicamSource::warnings() const { return manager_->warnings(); }
std::vector<pipeline::Notice> GenicamSource::take_notices() { return manager_->take_notices(); }
Status GenicamSource::trigger_nuc() { return manager_->trigger_nuc(); }
void GenicamSource::set_nuc(const NucOptions& nuc) { manager_->set_nuc(nuc); }

}  // namespace bolo::genicam
