#include "tools/cluster/job.hpp"

#include <utility>

namespace bolo::tools::cluster {
namespace {

Result<CrewResult> lead(Job& job, Leader& leader, int local, const std::function<Told(const Work&)>& progress) {
  const auto others = leader.gather();
  if (!others) return tl::unexpected(others.error());
  const auto decision = job.decide(*others);
  if (!decision) return tl::unexpected(decision.error());
  const auto work = job.prepare(*decision, local);
  if (!work) return tl::unexpected(work.error());
  leader.announce(*decision);
  return leader.lead(**work, progress(**work));
}

Status follow(Job& job, Follower& follower, int local) {
  const auto decision = follower.join(job.here());
  if (!decision) return tl::unexpected(decision.error());
  if (!*decision) return {};
  const auto work = job.prepare(**decision, local);
  if (!work) {
    follower.give_up(work.error());
    return tl::unexpected(work.error());
  }
  return follower.follow(**work);
}

}  // namespace

Result<std::optional<CrewResult>> take_part(Job& job, Messenger& messenger, const CrewOptions& options,
                                            const std::function<Told(const Work&)>& progress) {
  if (messenger.rank() != 0) {
    Follower follower(messenger, options);
    const Status status = follow(job, follower, messenger.local());
    messenger.leave(follower.all_present());
    if (!status) return tl::unexpected(status.error());
    return std::nullopt;
  }
  Leader leader(messenger, options);
  auto result = lead(job, leader, messenger.local(), progress);
  leader.end();
  messenger.leave(leader.all_present());
  if (!result) return tl::unexpected(result.error());
  return std::optional<CrewResult>(std::move(*result));
}

}  // namespace bolo::tools::cluster
