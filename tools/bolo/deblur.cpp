// `bolo deblur`: runs captures through the camera's pipeline, as fast as possible.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>

#include "src/capture/commit_records.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/made_from.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {
namespace {

constexpr const char* kDeblurVerb = "deblur";

double seconds_since(std::int64_t start_ns) { return static_cast<double>(monotonic_ns() - start_ns) / kNsPerSecond; }

// Shows progress under the name `what`.
Result<CaptureSummary> deblur(CaptureRun& run, const DeblurFile& file, Replace replace, const std::string& made_from,
                              const std::string& what) {
  Progress progress(what, run.info().frames);
  auto facts = run.run({file.output, replace}, made_from, [&progress](std::uint64_t frames, bool solved) {
    if (!solved) progress.start_rate(frames);
    progress.update(frames);
  });
  if (!facts) return tl::unexpected(facts.error());
  return CaptureSummary{file, run.info().frames, run.options().points.size(), std::move(*facts)};
}

Status deblur_one(const DeblurRequest& request) {
  const DeblurFile& file = request.files.front();
  ASSIGN_OR_RETURN(auto run, CaptureRun::open(request, file.input));
  const std::int64_t start_ns = monotonic_ns();
  ASSIGN_OR_RETURN(const auto capture, deblur(run, file, request.replace, "", kDeblurVerb));
  print_capture(request, capture, seconds_since(start_ns));
  return {};
}

// Removes journals left by a process killed between renaming its output and removing them.
void remove_left_records(const std::filesystem::path& output) {
  const std::filesystem::path part = output.string() + ".part";
  std::error_code ignored;
  if (!std::filesystem::exists(part, ignored)) capture::remove_records(part);
}

// Deblurs one capture of many: skips finished output, and output that another process is writing.
Status deblur_into_folder(const DeblurRequest& request, const DeblurFile& file, FolderSummary& summary) {
  ASSIGN_OR_RETURN(auto run, CaptureRun::open(request, file.input));
  ASSIGN_OR_RETURN(const auto source, made_from(request, run.reader()));
  if (is_made(file.output, file.input, source)) {
    remove_left_records(file.output);
    summary.skipped.push_back(file.output);
    return {};
  }
  std::error_code ignored;
  if (request.replace == Replace::kNothing && std::filesystem::exists(file.output, ignored)) {
    return bad_input(file.output.string() +
                     " is there already, made otherwise; choose another folder, or --overwrite it");
  }
  if (request.replace == Replace::kNothing && is_unfinished_recording(file.output)) {
    return bad_input(file.output.string() +
                     ".part is there: an unfinished recording; save it with bolo recover, or choose another folder");
  }
  // Restarts output that a killed run left under ".part".
  auto capture = deblur(run, file, Replace::kExisting, source, kDeblurVerb + (" " + file.input.filename().string()));
  if (capture) {
    summary.captures.push_back(std::move(*capture));
  } else if (is_being_made(file.output)) {
    summary.elsewhere.push_back(file.output);
  } else {
    return tl::unexpected(capture.error());
  }
  return {};
}

// Continues after a failed capture. The exit code is the worst one.
Result<int> deblur_many(const DeblurRequest& request) {
  const std::int64_t start_ns = monotonic_ns();
  FolderSummary summary;
  for (std::size_t i = 0; i < request.files.size() && !interrupted(); ++i) {
    if (!request.share.has(i)) continue;
    const Status status = deblur_into_folder(request, request.files[i], summary);
    if (!status) summary.failed.push_back({request.files[i].input, status.error()});
  }
  summary.seconds = seconds_since(start_ns);
  print_folder(request, summary);
  int code = interrupted() ? kExitFailed : kExitDone;
  for (const FailedCapture& failed : summary.failed) code = std::max(code, failed.error.exit_code());
  return code;
}

Result<int> run_deblur(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(DeblurRequest request, read_deblur_request(given));
  request.options.warn = [](const std::string& line) {
    std::fprintf(stderr, "bolo deblur: %s\n", printable(line).c_str());
  };
  request.options.give_up = &interrupted();
  if (request.into_folder) return deblur_many(request);
  if (!request.share.has(0)) return kExitDone;  // belongs to another rank
  RETURN_IF_ERROR(deblur_one(request));
  return kExitDone;
}

}  // namespace

int deblur_main(int argc, char** argv) { return run_verb(kDeblurVerb, deblur_command_line(), argc, argv, run_deblur); }

}  // namespace bolo::tools
