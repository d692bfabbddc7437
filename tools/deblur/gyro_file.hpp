// A gyro's samples from a CSV file, on the clock of a capture.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/gyro.hpp"
#include "src/core/result.hpp"

namespace bolo::tools {

// Lines t_s,x_rad_s,y_rad_s,z_rad_s, times rising, below a header line of these names that may be left out; empty ones
// and those that begin with # are passed over. Errors name file and line. Thread: setup.
Result<std::vector<GyroSample>> read_gyro(const std::filesystem::path& file);

// The samples' times are those of the capture's /t_host where it has them, else of its /t.
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

}  // namespace bolo::tools
