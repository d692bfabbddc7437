// A blind check in a job folder: alone, as a shard, or as one of MPI's ranks.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "src/core/result.hpp"
#include "tools/cluster/job.hpp"
#include "tools/cluster/job_folder.hpp"
#include "tools/cluster/job_run.hpp"
#include "tools/lab/blind/blind_work.hpp"
#include "tools/lab/blind/request.hpp"
#include "tools/lab/blind/score.hpp"
#include "tools/lab/blind/seal.hpp"

namespace bolo::tools::blind {

class BlindJob final : public cluster::Job {
 public:
  // `publish` is called once, in the process that decides, when the seal is in the folder's plan and before anything is
  // diagnosed. The request outlives it.
  BlindJob(const BlindRequest& request, std::function<void(const Seal&)> publish)
      : request_(request), publish_(std::move(publish)) {}

  nlohmann::json here() const override { return nlohmann::json::object(); }
  // The seal: of the nonce that the folder has, or now gets.
  Result<nlohmann::json> decide(const std::vector<nlohmann::json>& others) override;
  // kBadInput when this process does not see the folder of the one that decided, or other work is in it.
  Result<cluster::Work*> prepare(const nlohmann::json& decision, int local) override;

  // After its run. Thread: setup.
  const Seal& seal() const { return *seal_; }
  const BlindWork& work() const { return *work_; }
  // The trials of all sessions that have a record, in their order. When these are all, what lay about is removed.
  std::vector<Trial> finish() const;

 private:
  nlohmann::json plan(const std::string& digest) const;

  const BlindRequest& request_;
  std::function<void(const Seal&)> publish_;
  bool decides_ = false;
  std::optional<Seal> seal_;
  std::optional<cluster::JobFolder> folder_;
  std::optional<BlindWork> work_;
};

}  // namespace bolo::tools::blind
