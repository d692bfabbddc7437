// What `bolo deblur` says in the end, for people and for programs.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "src/deblur/settings.hpp"
#include "tools/cluster/job_run.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/deblur_work.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// A capture that is done.
struct CaptureSummary {
  DeblurFile file;
  std::uint64_t frames_in = 0;
  RunFacts facts;
};

// One capture, at once.
void print_capture(const DeblurRequest& request, const CaptureSummary& capture, std::size_t points, double seconds);

struct FailedCapture {
  std::filesystem::path file;
  std::string piece;
  Error error;
};

// Captures in blocks.
struct JobSummary {
  std::vector<CaptureSummary> captures;  // those that are done
  std::size_t planned = 0;               // captures
  std::size_t points = 0;
  cluster::JobResult run;
  std::vector<FailedCapture> failed;
};

// From the records of what is done. Thread: setup.
JobSummary summarise(const DeblurRequest& request, const DeblurWork& work);
void take_failures(const std::vector<cluster::Failure>& failures, const DeblurWork& work, JobSummary& summary);

void print_job(const DeblurRequest& request, const JobSummary& summary);

}  // namespace bolo::tools
