// `bolo deblur` in blocks: alone, as a shard, or as one of MPI's ranks.
#pragma once

#include <optional>

#include "src/core/result.hpp"
#include "tools/cluster/job.hpp"
#include "tools/cluster/job_run.hpp"
#include "tools/deblur/deblur_work.hpp"
#include "tools/deblur/report.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

class DeblurJob final : public cluster::Job {
 public:
  // The request outlives it.
  explicit DeblurJob(DeblurRequest& request) : request_(request) {}

  // The instruction sets of this host.
  nlohmann::json here() const override;
  // An instruction set that all hosts have, so that all bits are the same wherever a block is done, and the length of a
  // block; both as before when the job goes on.
  Result<nlohmann::json> decide(const std::vector<nlohmann::json>& others) override;
  Result<cluster::Work*> prepare(const nlohmann::json& decision, int local) override;

  // After its run: from the records, and removes what the job needs no more. Thread: setup.
  JobSummary finish(cluster::JobResult result) const;

 private:
  Result<std::string> common_isa(const std::vector<nlohmann::json>& others) const;

  DeblurRequest& request_;
  std::optional<cluster::JobFolder> folder_;
  std::optional<DeblurWork> work_;
};

}  // namespace bolo::tools
