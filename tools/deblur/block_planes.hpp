// The planes that blocks have left, one block after the other, with a look whether they are still what was written.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/result.hpp"
#include "tools/deblur/capture_run.hpp"

namespace bolo::tools {

// CRC-32 of bytes that follow others. Thread: any.
std::uint32_t crc_of(std::string_view bytes, std::uint32_t before = 0);

// Thread: any one at a time.
class BlockPlanes {
 public:
  struct Source {
    std::filesystem::path file;
    nlohmann::json record;  // "written": [[first, end], ...], "crc", "errors": of each plane, where there is a truth
  };
  // `damaged` is told the place of a block that is not what it was.
  BlockPlanes(std::vector<Source> sources, std::size_t plane_size, std::function<void(std::size_t)> damaged);

  // Nothing: there are no more. The values are valid until the next call. kFailed for a damaged block, at its end at
  // the latest.
  Result<std::optional<CaptureRun::Plane>> next();

 private:
  void open_block();
  Result<std::optional<CaptureRun::Plane>> plane();
  Status damage();

  std::vector<Source> sources_;
  std::vector<char> plane_;
  std::function<void(std::size_t)> damaged_;
  std::size_t at_ = 0;
  std::size_t planes_ = 0;           // of the block at at_, so far
  std::deque<std::size_t> indices_;  // of those to come
  std::ifstream in_;
  std::uint32_t crc_ = 0;
};

}  // namespace bolo::tools
