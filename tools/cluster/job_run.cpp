#include "tools/cluster/job_run.hpp"

#include <array>
#include <cstdio>
#include <memory>
#include <set>
#include <utility>

#include "src/core/clock.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cluster/at_once.hpp"
#include "tools/cluster/mpi.hpp"

namespace bolo::tools::cluster {
namespace {

constexpr double kLogEvery_s = 10.0;

std::uint64_t size_left(const Work& work) {
  std::uint64_t size = 0;
  for (std::size_t i = 0; i < work.pieces().size(); ++i) {
    if (work.pieces()[i].size > 0 && !work.done(i)) size += work.pieces()[i].size;
  }
  return size;
}

Told progress_of(const std::string& verb, const Work& work) {
  auto progress = std::make_shared<Progress>(verb, size_left(work), kLogEvery_s);
  return [progress](std::uint64_t done) { progress->update(done); };
}

double seconds_since(std::int64_t start_ns) { return static_cast<double>(monotonic_ns() - start_ns) / kNsPerSecond; }

}  // namespace

Result<JobResult> run_alone(Job& job, const Sharing& sharing, const std::string& verb, int at_once) {
  const std::int64_t start_ns = monotonic_ns();
  const auto decision = job.decide({});
  if (!decision) return tl::unexpected(decision.error());
  auto prepared = job.prepare(*decision, 1);
  if (!prepared) {  // another shard may have decided at the same moment, otherwise, and been faster
    const auto now = job.decide({});
    if (now && *now != *decision) prepared = job.prepare(*now, 1);
  }
  if (!prepared) return tl::unexpected(prepared.error());
  Work& work = **prepared;
  const Told told = progress_of(verb, work);
  std::uint64_t did = 0;
  const auto beat = [&](std::uint64_t done) {
    told(did + done);
    return !interrupted().load(std::memory_order_relaxed);
  };
  const auto add = [&](std::size_t piece) { did += work.pieces()[piece].size; };
  auto result = at_once > 1 ? run_shard_at_once(work, sharing.shard, at_once, beat, add)
                            : run_shard(work, sharing.shard, beat, add);
  if (!result) return tl::unexpected(result.error());
  return JobResult{std::move(result->failures), result->before, result->did.size(), 0, result->left, {},
                   seconds_since(start_ns)};
}

Result<std::optional<JobResult>> run_ranks(Job& job, const Sharing& sharing, const std::string& verb) {
  const std::int64_t start_ns = monotonic_ns();
  const auto messenger = open_mpi();
  if (!messenger) return tl::unexpected(messenger.error());
  const CrewOptions options{sharing.rank_timeout_s, &interrupted()};
  auto crew = take_part(job, **messenger, options, [&verb](const Work& work) { return progress_of(verb, work); });
  if (!crew) return tl::unexpected(crew.error());
  if (!*crew) return std::nullopt;
  CrewResult& all = **crew;
  return JobResult{std::move(all.failures), all.before, all.did, all.again, 0, std::move(all.ranks),
                   seconds_since(start_ns)};
}

Result<bool> shared_by_ranks(const Sharing& sharing) {
  const bool ranks = launched_by_mpi();
  if (!ranks || !sharing.sharded) return ranks;
  return bad_input("--shard: ranks share the work already; start one process, or leave it out");
}

int report_once(const std::string& verb, const Error& error) {
  return mpi_launch().rank == 0 ? report(verb, error) : error.exit_code();
}

int report_rank(const std::string& verb, const Error& error) {
  return interrupted().load(std::memory_order_relaxed) ? report_once(verb, error) : report(verb, error);
}

double busy_s(const JobResult& result) {
  double busy = 0.0;
  for (const RankShare& rank : result.ranks) busy += rank.busy_s;
  return busy;
}

std::string ranks_text(const JobResult& result) {
  if (result.ranks.empty()) return {};
  std::set<std::string> hosts;
  std::size_t lost = 0;
  for (const RankShare& rank : result.ranks) {
    hosts.insert(rank.host);
    lost += rank.lost ? 1 : 0;
  }
  const auto ranks = static_cast<double>(result.ranks.size());
  std::array<char, 160> text{};
  std::snprintf(
      text.data(), text.size(), "%zu ranks on %zu hosts, busy %.0f %% of the time; %zu lost, %zu pieces done again",
      result.ranks.size(), hosts.size(), 100.0 * busy_s(result) / (ranks * result.seconds), lost, result.again);
  return text.data();
}

}  // namespace bolo::tools::cluster
