// The request to `bolo deblur`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <cxxopts.hpp>

#include "src/capture/capture.hpp"
#include "src/core/gyro.hpp"
#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/pipeline.hpp"

namespace bolo::tools {

// --- Several processes started on the same captures share them: each does every N-th, without communication.

struct Share {
  std::size_t index = 0;
  std::size_t count = 1;
  std::string from;  // the option or variables that set it; empty: no sharing

  bool has(std::size_t capture) const { return capture % count == index; }
};

// Parses "I/N", I counting from 0 or from 1: N/N is the same as 0/N. kBadInput for anything else. Thread: any.
Result<Share> share_named(const std::string& text);

// Looks up an environment variable; null if it is not set.
using Environment = std::function<const char*(const char*)>;

// The share by a scheduler: this process among the ranks of mpirun (Open MPI, MPICH, others with PMI's variables) or
// srun, times this task of a Slurm array. All without one. kBadInput for contradictory variables. Thread: any.
Result<Share> share_of(const Environment& environment);

// Processors for this process: Slurm's assignment, else `processors` over ranks on this host. At least 1. Thread: any.
int threads_of(const Environment& environment, int processors);

// --- A gyro's samples from a CSV file, on the clock of a capture.

// Lines t_s,x_rad_s,y_rad_s,z_rad_s with rising times, after an optional header line of these names; empty lines and
// those that begin with # are skipped. Errors name file and line. Thread: setup.
Result<std::vector<GyroSample>> read_gyro(const std::filesystem::path& file);

// Sample times are on the clock of the capture's /t_host if it has that, else of its /t.
class GyroOfCapture final : public Gyro {
 public:
  GyroOfCapture(std::shared_ptr<const std::vector<GyroSample>> samples,
                std::shared_ptr<const capture::CaptureReader> reader)
      : samples_(std::move(samples)), reader_(std::move(reader)) {}
  std::span<const GyroSample> samples() noexcept override { return *samples_; }
  std::int64_t time_of(const FrameMeta& frame) const noexcept override;

 private:
  std::shared_ptr<const std::vector<GyroSample>> samples_;
  std::shared_ptr<const capture::CaptureReader> reader_;
};

struct DeblurFile {
  std::filesystem::path input;
  std::filesystem::path output;
};

struct DeblurRequest {
  std::vector<DeblurFile> files;
  std::filesystem::path output;  // as given: a file, or a folder for several captures
  std::filesystem::path points_file;
  std::filesystem::path profile_file;
  std::filesystem::path maps_file;
  std::filesystem::path gyro_file;
  std::map<std::string, std::uint64_t> sums;            // checksums of profile, maps and gyro, as they were read
  std::shared_ptr<const std::vector<GyroSample>> gyro;  // of gyro_file; null: none
  pipeline::PipelineOptions options;                    // without points, which depend on the capture (points_of)
  Replace replace = Replace::kNothing;
  bool isa_given = false;
  bool json = false;
  bool into_folder = false;            // outputs that are up to date are not made again
  std::optional<OutputFolder> folder;  // folder created for the outputs
  Share share;                         // of the files
};

cxxopts::Options deblur_command_line();

// Parses the command line; captures are only checked to exist. Errors name the option. Thread: setup.
Result<DeblurRequest> read_deblur_request(const cxxopts::ParseResult& args);

// Checks a capture before any work. Thread: setup.
Status check_capture(const DeblurRequest& request, const std::filesystem::path& file, const capture::CaptureInfo& info);

// The pixels of --points in this frame; empty without that option. Thread: setup.
Result<std::vector<std::uint32_t>> points_of(const DeblurRequest& request, Geometry frame);

// Further root attributes of the output: the files it was made from.
std::vector<std::pair<std::string, std::string>> files_behind(const DeblurRequest& request);

}  // namespace bolo::tools
