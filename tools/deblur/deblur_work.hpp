// The pieces of a deblurring job. Of a capture that is one block: the whole. Of others:
//   walk-K     what block K must know of the frames before it; where it depends on more than its window
//   block-K    the sharp planes of frames [K block, (K + 1) block), into the job's data
//   output     the blocks put together under the output's name; what they left is removed
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/result.hpp"
#include "tools/cluster/job_folder.hpp"
#include "tools/cluster/work.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/deblur_plan.hpp"

namespace bolo::tools {

class DeblurWork final : public cluster::Work {
 public:
  // The request and the folder outlive it.
  DeblurWork(const DeblurRequest& request, DeblurPlan plan, const cluster::JobFolder& folder);

  const std::vector<cluster::Piece>& pieces() const override { return pieces_; }
  bool done(std::size_t piece) const override;
  Status run(std::size_t piece, const cluster::Beat& beat) override;

  const DeblurPlan& plan() const { return plan_; }
  // What is recorded of a piece; of one that is done.
  std::optional<nlohmann::json> record(std::size_t piece) const { return folder_.record(pieces_[piece].name); }
  // The piece with which a capture's output is there.
  std::size_t last_of(std::size_t capture) const { return last_[capture]; }
  // Of the pieces of a capture, those that hold its frames.
  const std::vector<std::size_t>& shares_of(std::size_t capture) const { return shares_[capture]; }

 private:
  enum class Kind { kWhole, kWalk, kBlock, kOutput };
  struct Task {
    Kind kind = Kind::kWhole;
    std::size_t capture = 0;
    std::size_t block = 0;
    std::size_t place = 0;  // among the pieces
  };

  void add(Task task, cluster::Piece piece);
  const std::string& name_of(const Task& task) const { return pieces_[task.place].name; }
  void add_blocks(std::size_t capture, const std::string& name);
  replay::FrameRange frames_of(const Task& task) const;
  std::filesystem::path data_of(const Task& task) const { return folder_.data(name_of(task)); }
  bool output_there(std::size_t capture) const;
  Result<std::string> state_for(const Task& task) const;
  Result<CaptureRun*> capture(std::size_t index);

  Status run_whole(const Task& task, const cluster::Beat& beat);
  Status run_walk(const Task& task, const cluster::Beat& beat);
  Status run_block(const Task& task, const cluster::Beat& beat);
  Status run_output(const Task& task, const cluster::Beat& beat);
  Status keep_output(const Task& task, const std::filesystem::path& written, const RunFacts& facts,
                     nlohmann::json record);

  const DeblurRequest& request_;
  DeblurPlan plan_;
  const cluster::JobFolder& folder_;
  std::vector<Task> tasks_;
  std::vector<cluster::Piece> pieces_;
  std::vector<std::size_t> last_;
  std::vector<std::vector<std::size_t>> shares_;
  std::optional<std::size_t> opened_;  // the capture that run_ is of
  std::optional<CaptureRun> run_;
};

}  // namespace bolo::tools
