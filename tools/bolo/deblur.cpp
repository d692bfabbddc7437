// `bolo deblur`: captures through the same pipeline as the camera's frames, as fast as it goes; one at once, or many in
// blocks that processes share.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>

#include "src/core/clock.hpp"
#include "tools/bolo/cli.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cluster/job_run.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/deblur_job.hpp"
#include "tools/deblur/report.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {
namespace {

Status deblur_at_once(const DeblurRequest& request) {
  const DeblurFile& file = request.files.front();
  auto run = CaptureRun::open(request, file.input);
  if (!run) return tl::unexpected(run.error());
  const std::int64_t start_ns = monotonic_ns();
  Progress progress("deblur", run->info().frames);
  const auto facts = run->whole({file.output, request.replace}, [&progress](std::uint64_t frames) {
    progress.update(frames);
    return !interrupted().load(std::memory_order_relaxed);
  });
  if (!facts) return tl::unexpected(facts.error());
  const double seconds = static_cast<double>(monotonic_ns() - start_ns) / kNsPerSecond;
  print_capture(request, {file, run->info().frames, *facts}, run->options().points.size(), seconds);
  return {};
}

// The exit code: of the worst that happened to a capture.
int end_of(const DeblurRequest& request, const JobSummary& summary) {
  print_job(request, summary);
  int code = kExitDone;
  for (const FailedCapture& failed : summary.failed) code = std::max(code, failed.error.exit_code());
  return code;
}

int deblur_in_blocks(DeblurRequest& request, bool ranks) {
  DeblurJob job(request);
  if (!ranks) {
    auto result = cluster::run_alone(job, request.sharing, "deblur");
    return result ? end_of(request, job.finish(std::move(*result))) : report("deblur", result.error());
  }
  auto result = cluster::run_ranks(job, request.sharing, "deblur");
  if (!result) return cluster::report_rank("deblur", result.error());
  return *result ? end_of(request, job.finish(std::move(**result))) : kExitDone;
}

}  // namespace

int deblur_main(int argc, char** argv) {
  cxxopts::Options options = deblur_command_line();
  cxxopts::ParseResult args;
  if (const auto code = parse(options, argc, argv, args)) return *code;
  Result<DeblurRequest> request = read_deblur_request(args);
  if (!request) return cluster::report_once("deblur", request.error());
  request->options.warn = [](const std::string& line) { std::fprintf(stderr, "bolo deblur: %s\n", line.c_str()); };
  catch_interrupts();
  const auto ranks = cluster::shared_by_ranks(request->sharing);
  if (!ranks) return cluster::report_once("deblur", ranks.error());
  if (*ranks || request->in_blocks) return deblur_in_blocks(*request, *ranks);
  const Status status = deblur_at_once(*request);
  return status ? kExitDone : report("deblur", status.error());
}

}  // namespace bolo::tools
