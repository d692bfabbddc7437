#include "tools/deblur/block_planes.hpp"

#include <utility>

#include <zlib.h>

namespace bolo::tools {

std::uint32_t crc_of(std::string_view bytes, std::uint32_t before) {
  return static_cast<std::uint32_t>(crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

BlockPlanes::BlockPlanes(std::vector<Source> sources, std::size_t plane_size, std::function<void(std::size_t)> damaged)
    : sources_(std::move(sources)), plane_(plane_size), damaged_(std::move(damaged)) {}

Result<std::optional<CaptureRun::Plane>> BlockPlanes::next() {
  while (at_ < sources_.size()) {
    if (planes_ == 0) open_block();
    if (!indices_.empty()) return plane();
    in_.close();
    if (crc_ != sources_[at_].record.at("crc").get<std::uint32_t>()) return tl::unexpected(damage().error());
    ++at_;
    planes_ = 0;
  }
  return std::nullopt;
}

void BlockPlanes::open_block() {
  in_.open(sources_[at_].file, std::ios::binary);
  crc_ = 0;
  for (const auto& run : sources_[at_].record.at("written")) {
    for (auto i = run[0].get<std::size_t>(); i < run[1].get<std::size_t>(); ++i) indices_.push_back(i);
  }
}

Result<std::optional<CaptureRun::Plane>> BlockPlanes::plane() {
  in_.read(plane_.data(), static_cast<std::streamsize>(plane_.size()));
  if (!in_) return tl::unexpected(damage().error());
  crc_ = crc_of({plane_.data(), plane_.size()}, crc_);
  CaptureRun::Plane plane{indices_.front(), plane_.data(), {}};
  indices_.pop_front();
  const nlohmann::json& record = sources_[at_].record;
  if (record.contains("errors")) {
    const auto& errors = record.at("errors")[planes_];
    plane.errors = {errors[0].get<double>(), errors[1].get<double>()};
  }
  ++planes_;
  return plane;
}

Status BlockPlanes::damage() {
  in_.close();
  damaged_(at_);
  return failed(sources_[at_].file.string() + ": was damaged after it had been written; the block is done again");
}

}  // namespace bolo::tools
