// The sessions of a check as pieces of shared work: one each, called "single-00012", of which its finding is recorded.
#pragma once

#include <mutex>
#include <optional>
#include <vector>

#include "src/core/result.hpp"
#include "tools/cluster/job_folder.hpp"
#include "tools/cluster/work.hpp"
#include "tools/lab/blind/check.hpp"
#include "tools/lab/blind/score.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

// done() and run() may be called by several threads at once (cluster/at_once.hpp).
class BlindWork final : public cluster::Work {
 public:
  // All three outlive it.
  BlindWork(const std::vector<Session>& sessions, const CheckOptions& options, const cluster::JobFolder& folder);

  const std::vector<cluster::Piece>& pieces() const override { return pieces_; }
  // Its record is there, and with --keep its folder too.
  bool done(std::size_t piece) const override;
  // A diagnosis that broke is recorded as one that broke: it is done. kFailed: the disk, the simulator, or the end.
  Status run(std::size_t piece, const cluster::Beat& beat) override;

  // What is recorded of a session.
  std::optional<Trial> trial(std::size_t piece) const;

 private:
  const std::vector<Session>& sessions_;
  const CheckOptions& options_;
  const cluster::JobFolder& folder_;
  std::vector<cluster::Piece> pieces_;
  mutable std::mutex records_;  // the folder is for one at a time
};

}  // namespace bolo::tools::blind
