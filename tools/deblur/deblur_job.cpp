#include "tools/deblur/deblur_job.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "src/deblur/isa.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;

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

}  // namespace

nlohmann::json DeblurJob::here() const { return {{"isas", deblur::available_isas()}}; }

Result<nlohmann::json> DeblurJob::decide(const std::vector<nlohmann::json>& others) {
  const auto isa = common_isa(others);
  if (!isa) return tl::unexpected(isa.error());
  const std::size_t processes = std::max(request_.sharing.shard.count, others.size() + 1);
  const nlohmann::json before = planned(request_.sharing.job, "/block_frames");
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
  const nlohmann::json before = planned(request_.sharing.job, "/settings/isa");
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
  auto folder = cluster::JobFolder::open(request_.sharing.job, plan->text(request_, *digests));
  if (!folder) return tl::unexpected(folder.error());
  if (Status status = check_folders(request_, request_.sharing.job); !status) return tl::unexpected(status.error());
  folder_.emplace(std::move(*folder));
  work_.emplace(request_, std::move(*plan), *folder_);
  return &*work_;
}

JobSummary DeblurJob::finish(cluster::JobResult result) const {
  if (result.left == 0 && result.failures.empty()) folder_->clear_data();
  JobSummary summary = summarise(request_, *work_);
  take_failures(result.failures, *work_, summary);
  summary.run = std::move(result);
  return summary;
}

}  // namespace bolo::tools
