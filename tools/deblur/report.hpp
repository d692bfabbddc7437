// Report of `bolo deblur`, as text and JSON.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// A capture that was deblurred.
struct CaptureSummary {
  DeblurFile file;
  std::uint64_t frames_in = 0;
  std::size_t points = 0;
  RunFacts facts;
};

struct FailedCapture {
  std::filesystem::path file;
  Error error;
};

// Captures that go into a folder: of this process' share.
struct FolderSummary {
  std::vector<CaptureSummary> captures;
  std::vector<FailedCapture> failed;
  std::vector<std::filesystem::path> skipped;    // outputs that were there
  std::vector<std::filesystem::path> elsewhere;  // outputs that another process is writing
  double seconds = 0.0;
};

void print_capture(const DeblurRequest& request, const CaptureSummary& capture, double seconds);
void print_folder(const DeblurRequest& request, const FolderSummary& summary);

}  // namespace bolo::tools
