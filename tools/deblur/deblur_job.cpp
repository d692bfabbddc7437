#include "tools/deblur/deblur_job.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "bolo/core/clock.hpp"
#include "bolo/deblur/isa.hpp"
#include "tools/cluster/mpi.hpp"
#include "tools/verbs/cli.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;

constexpr double kLogEvery_s = 10.0;

// Outputs are renamed from the job's folder: both must be on one file system.
Status check_folders(const DeblurRequest& request, const fs::path& job) {
  std::error_code error;
  fs::path outputs = fs::absolute(request.files.front().output).parent_path();
  fs::create_directories(outputs, error);
  if (error) return bad_input(outputs.string() + ": cannot be made a folder: " + error.message());
  struct stat one {};
  struct stat other {};
  if (::stat(job.c_str(), &one) == 0 && ::stat(outputs.c_str(), &other) == 0 && one.st_dev == other.st_dev) return {};
  return bad_input("--job " + job.string() + ": must be on the same file system as the output, " + outputs.string());
}

std::uint64_t frames_left(const cluster::Work& work) {
  std::uint64_t frames = 0;
  for (std::size_t i = 0; i < work.pieces().size(); ++i) {
    if (work.pieces()[i].size > 0 && !work.done(i)) frames += work.pieces()[i].size;
  }
  return frames;
}

cluster::Told progress_of(const cluster::Work& work) {
  auto progress = std::make_shared<Progress>("deblur", frames_left(work), kLogEvery_s);
  return [progress](std::uint64_t frames) { progress->update(frames); };
}

// What a job that was begun has decided; null for none.
nlohmann::json planned(const fs::path& job, const char* place) {
  const auto plan = cluster::JobFolder::plan_in(job);
  const nlohmann::json::json_pointer pointer(place);
  return plan && plan->contains(pointer) ? plan->at(pointer) : nlohmann::json();
}

Result<std::size_t> frames_of(const DeblurRequest& request) {
  std::size_t frames = 0;
  for (const DeblurFile& file : request.files) {
    const auto run = CaptureRun::open(request, file.input, true);
    if (!run) return tl::unexpected(run.error());
    frames += run->info().frames;
  }
  return frames;
}

double seconds_since(std::int64_t start_ns) { return static_cast<double>(monotonic_ns() - start_ns) / kNsPerSecond; }

}  // namespace

nlohmann::json DeblurJob::here() const { return {{"isas", deblur::available_isas()}}; }

Result<nlohmann::json> DeblurJob::decide(const std::vector<nlohmann::json>& others) {
  const auto isa = common_isa(others);
  if (!isa) return tl::unexpected(isa.error());
  const std::size_t processes = std::max(request_.shard.count, others.size() + 1);
  const nlohmann::json before = planned(request_.job, "/block_frames");
  if (!request_.block_frames && before.is_number_unsigned()) request_.block_frames = before.get<std::size_t>();
  if (!request_.block_frames) {
    const auto frames = frames_of(request_);
    if (!frames) return tl::unexpected(frames.error());
    request_.block_frames = automatic_block(request_.files.size(), *frames, processes);
  }
  return nlohmann::json{{"isa", *isa}, {"block_frames", *request_.block_frames}};
}

Result<std::string> DeblurJob::common_isa(const std::vector<nlohmann::json>& others) const {
  if (request_.isa_given) return std::string(deblur::best_isa());
  const auto everywhere = [&](std::string_view isa) {
    return std::ranges::all_of(others, [&](const nlohmann::json& other) {
      const auto isas = other.value("isas", std::vector<std::string>());
      return std::ranges::find(isas, isa) != isas.end();
    });
  };
  const nlohmann::json before = planned(request_.job, "/settings/isa");
  std::optional<std::string_view> best;
  for (const std::string_view isa : deblur::available_isas()) {
    if (!everywhere(isa)) continue;
    if (before == isa) return std::string(isa);
    if (!best) best = isa;
  }
  if (!best) return bad_input("the hosts have no instruction set in common; start bolo on hosts of one kind");
  return std::string(*best);
}

Result<cluster::Work*> DeblurJob::prepare(const nlohmann::json& decision, int local) {
  const std::string isa = decision.at("isa");
  request_.block_frames = decision.at("block_frames").get<std::size_t>();
  if (Status status = deblur::choose_isa(isa); !status) return at("--isa " + isa, status.error());
  if (!request_.threads_given) request_.options.workers = std::max(1, request_.options.workers / std::max(1, local));
  auto plan = plan_deblurring(request_);
  if (!plan) return tl::unexpected(plan.error());
  const auto digests = digests_of(request_);
  if (!digests) return tl::unexpected(digests.error());
  auto folder = cluster::JobFolder::open(request_.job, plan->text(request_, *digests));
  if (!folder) return tl::unexpected(folder.error());
  if (Status status = check_folders(request_, request_.job); !status) return tl::unexpected(status.error());
  folder_.emplace(std::move(*folder));
  work_.emplace(request_, std::move(*plan), *folder_);
  return &*work_;
}

Result<JobSummary> DeblurJob::run_alone() {
  const std::int64_t start_ns = monotonic_ns();
  const auto decision = decide({});
  if (!decision) return tl::unexpected(decision.error());
  const auto work = prepare(*decision, 1);
  if (!work) return tl::unexpected(work.error());
  const cluster::Told told = progress_of(**work);
  std::uint64_t did = 0;
  const auto beat = [&](std::uint64_t frames) {
    told(did + frames);
    return !interrupted().load(std::memory_order_relaxed);
  };
  auto result = cluster::run_shard(**work, request_.shard, beat,
                                   [&](std::size_t piece) { did += (*work)->pieces()[piece].size; });
  if (!result) return tl::unexpected(result.error());
  if (result->left == 0 && result->failures.empty()) folder_->clear_data();
  JobSummary summary = this->summary(seconds_since(start_ns));
  summary.before = result->before;
  summary.did = result->did.size();
  summary.left = result->left;
  take_failures(result->failures, *work_, summary);
  return summary;
}

Result<std::optional<JobSummary>> DeblurJob::run_ranks() {
  const std::int64_t start_ns = monotonic_ns();
  const auto messenger = cluster::open_mpi();
  if (!messenger) return tl::unexpected(messenger.error());
  const cluster::CrewOptions options{request_.rank_timeout_s, &interrupted()};
  auto result = cluster::take_part(*this, **messenger, options, progress_of);
  if (!result) return tl::unexpected(result.error());
  if (!*result) return std::nullopt;
  const cluster::CrewResult& crew = **result;
  if (crew.failures.empty()) folder_->clear_data();
  JobSummary summary = this->summary(seconds_since(start_ns));
  summary.before = crew.before;
  summary.did = crew.did;
  summary.again = crew.again;
  summary.ranks = crew.ranks;
  take_failures(crew.failures, *work_, summary);
  return summary;
}

JobSummary DeblurJob::summary(double seconds) const {
  JobSummary summary = summarise(request_, *work_);
  summary.seconds = seconds;
  return summary;
}

}  // namespace bolo::tools
