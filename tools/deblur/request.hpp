// The request to `bolo deblur`.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <cxxopts.hpp>

#include "src/capture/capture.hpp"
#include "src/core/gyro.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tools/deblur/share.hpp"

namespace bolo::tools {

// A capture and what it becomes.
struct DeblurFile {
  std::filesystem::path input;
  std::filesystem::path output;
};

struct DeblurRequest {
  std::vector<DeblurFile> files;
  std::filesystem::path output;  // as it was given: a file, or a folder for several captures
  std::filesystem::path points_file;
  std::filesystem::path profile_file;
  std::filesystem::path maps_file;
  std::filesystem::path gyro_file;
  std::shared_ptr<const std::vector<GyroSample>> gyro;  // of gyro_file; null: none
  pipeline::PipelineOptions options;                    // points are of a capture (points_of)
  Replace replace = Replace::kNothing;
  bool isa_given = false;
  bool json = false;
  bool into_folder = false;  // what is done there already is not done again
  Share share;               // of the files
};

cxxopts::Options deblur_command_line();

// Settings and files as the words say; of captures only that they are there is looked at. Errors name the option.
// Thread: setup.
Result<DeblurRequest> read_deblur_request(const cxxopts::ParseResult& args);

// Checks a capture before any work. Thread: setup.
Status check_capture(const DeblurRequest& request, const std::filesystem::path& file, const capture::CaptureInfo& info);

// The pixels of --points in this frame; none without it. Thread: setup.
Result<std::vector<std::uint32_t>> points_of(const DeblurRequest& request, Geometry frame);

// Root attributes of the output beyond the settings: which files they came from.
std::vector<std::pair<std::string, std::string>> files_behind(const DeblurRequest& request);

}  // namespace bolo::tools
