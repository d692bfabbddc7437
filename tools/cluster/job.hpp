// A verb's shared work from its start to its end, whoever takes part.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/result.hpp"
#include "tools/cluster/crew.hpp"
#include "tools/cluster/messenger.hpp"
#include "tools/cluster/work.hpp"

namespace bolo::tools::cluster {

// What a verb does. Thread: setup.
class Job {
 public:
  virtual ~Job() = default;
  // What the process that decides must know of every other one.
  virtual nlohmann::json here() const = 0;
  // Decides for all: in rank 0, or in a process alone (`others` empty).
  virtual Result<nlohmann::json> decide(const std::vector<nlohmann::json>& others) = 0;
  // Makes ready for what was decided; the work lives as long as the job. `local`: processes of the job on this host.
  virtual Result<Work*> prepare(const nlohmann::json& decision, int local) = 0;
};

// Takes part in a job as one of the messenger's ranks, to its end; leaves the messenger. Rank 0 gets the result, all
// others nothing. Errors: what keeps this rank from taking part, in rank 0 that of the job. Thread: the messenger's.
Result<std::optional<CrewResult>> take_part(Job& job, Messenger& messenger, const CrewOptions& options,
                                            const std::function<Told(const Work&)>& progress);

}  // namespace bolo::tools::cluster
