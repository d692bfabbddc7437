#include "tools/deblur/block_sink.hpp"

#include <cerrno>
#include <cstring>
#include <utility>

#include <zlib.h>

namespace bolo::tools {

BlockSink::BlockSink(ChosenFrames chosen, replay::FrameRange frames, std::filesystem::path file, DeblurSink::Beat beat)
    : chosen_(std::move(chosen)), frames_(frames), file_(std::move(file)), beat_(std::move(beat)) {}

Status BlockSink::open(const pipeline::SinkFormat& format) {
  chosen_.open(format);
  out_.reset(std::fopen(file_.c_str(), "wb"));
  if (!out_) return failed(file_.string() + ": cannot be written: " + std::strerror(errno));
  return {};
}

void BlockSink::publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& /*stats*/) noexcept {
  if (status_) status_ = take(frame);
  if (!status_ || chosen_.index() + 1 >= frames_.end) stop_requested_.store(true, std::memory_order_relaxed);
  beat();
}

void BlockSink::idle(const pipeline::PipelineStats& /*stats*/) noexcept { beat(); }

void BlockSink::beat() noexcept {
  if (!status_ || beat_(frames_in_)) return;
  status_ = failed("told to end");
  stop_requested_.store(true, std::memory_order_relaxed);
}

Status BlockSink::take(const pipeline::PublishedFrame& frame) {
  if (Status status = chosen_.take(frame); !status) return status;
  const std::size_t index = chosen_.index();
  if (index < frames_.first || index >= frames_.end) return {};
  ++frames_in_;
  if (!chosen_.sharp()) return {};
  const auto errors = chosen_.errors();
  if (!errors) return tl::unexpected(errors.error());
  if (std::fwrite(chosen_.deblurred(), 1, chosen_.bytes(), out_.get()) != chosen_.bytes()) {
    return failed(file_.string() + ": cannot be written: " + std::strerror(errno));
  }
  block_.crc =
      static_cast<std::uint32_t>(crc32_z(block_.crc, static_cast<const Bytef*>(chosen_.deblurred()), chosen_.bytes()));
  if (block_.written.empty() || block_.written.back().end != index) block_.written.push_back({index, index});
  block_.written.back().end = index + 1;
  if (chosen_.written().has_truth) block_.errors.push_back(*errors);
  return {};
}

Status BlockSink::finish() {
  if (std::fclose(out_.release()) == 0) return {};
  return failed(file_.string() + ": cannot be written: " + std::strerror(errno));
}

}  // namespace bolo::tools
