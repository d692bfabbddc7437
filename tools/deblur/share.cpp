#include "tools/deblur/share.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <string_view>

namespace bolo::tools {
namespace {

constexpr std::size_t kMostShares = 1'000'000;

std::optional<std::size_t> count_of(std::string_view text) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<std::size_t> count_of(const Environment& environment, const char* name) {
  const char* const text = environment(name);
  return text != nullptr ? count_of(std::string_view(text)) : std::nullopt;
}

tl::unexpected<Error> contradiction(const std::string& from) {
  return bad_input(from + " do not name one of several processes; say which with --shard I/N");
}

struct RankVariables {
  const char* rank;
  const char* size;
};

// In this order, because ranks that mpirun starts within a Slurm job have Slurm's variables too, of their daemons. PMIx
// has no variable of its own for how many there are.
constexpr std::array<RankVariables, 4> kLaunchers{{{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                                                   {"PMI_RANK", "PMI_SIZE"},
                                                   {"SLURM_PROCID", "SLURM_NTASKS"},
                                                   {"PMIX_RANK", "SLURM_NTASKS"}}};

// A batch script is no task of srun, though Slurm gives it the number of one and the count of all.
bool is_batch_script(const Environment& environment) {
  return environment("SLURM_JOB_ID") != nullptr && environment("SLURM_STEP_ID") == nullptr;
}

Result<Share> rank_of(const Environment& environment) {
  for (const RankVariables& launcher : kLaunchers) {
    const bool slurm = std::string_view(launcher.rank) == "SLURM_PROCID";
    if (environment(launcher.rank) == nullptr || (slurm && is_batch_script(environment))) continue;
    const auto rank = count_of(environment, launcher.rank);
    const auto size = count_of(environment, launcher.size);
    const std::string from = std::string(launcher.rank) + " and " + launcher.size;
    if (!rank || !size || *size > kMostShares || *rank >= *size) return contradiction(from);
    return Share{*rank, *size, from};
  }
  return Share{};
}

// Of an array with gaps (1,3,7) the shares in the gaps are nobody's.
Result<Share> array_task_of(const Environment& environment) {
  const char* const kFrom = "SLURM_ARRAY_TASK_ID and SLURM_ARRAY_TASK_COUNT";
  if (environment("SLURM_ARRAY_TASK_ID") == nullptr) return Share{};
  const auto id = count_of(environment, "SLURM_ARRAY_TASK_ID");
  const auto count = count_of(environment, "SLURM_ARRAY_TASK_COUNT");
  if (!id || !count || *count < 1 || *count > kMostShares) return contradiction(kFrom);
  const auto first = count_of(environment, "SLURM_ARRAY_TASK_MIN");
  const auto last = count_of(environment, "SLURM_ARRAY_TASK_MAX");
  if (!first || !last) return Share{*id % *count, *count, kFrom};
  const std::size_t step = std::max<std::size_t>(1, count_of(environment, "SLURM_ARRAY_TASK_STEP").value_or(1));
  if (*id < *first || *id > *last || *last - *first >= kMostShares * step) return contradiction(kFrom);
  return Share{(*id - *first) / step, (*last - *first) / step + 1, kFrom};
}

}  // namespace

Result<Share> share_named(const std::string& text) {
  const std::size_t slash = text.find('/');
  const auto index = count_of(std::string_view(text).substr(0, slash));
  const auto count = slash == std::string::npos ? std::nullopt : count_of(std::string_view(text).substr(slash + 1));
  if (!index || !count || *count < 1 || *count > kMostShares || *index > *count) {
    return bad_input("--shard '" + text + "': give I/N, the I-th of N parts, counted from 0 or from 1");
  }
  return Share{*index % *count, *count, "--shard " + text};
}

Result<Share> share_of(const Environment& environment) {
  auto rank = rank_of(environment);
  if (!rank) return rank;
  auto task = array_task_of(environment);
  if (!task) return task;
  if (rank->count == 1) return task->count == 1 ? Share{} : *task;
  const std::string from = task->count == 1 ? rank->from : rank->from + ", " + task->from;
  return Share{task->index * rank->count + rank->index, task->count * rank->count, from};
}

int threads_of(const Environment& environment, int processors) {
  if (const auto given = count_of(environment, "SLURM_CPUS_PER_TASK"); given && *given > 0) {
    return static_cast<int>(std::min<std::size_t>(*given, static_cast<std::size_t>(std::max(processors, 1))));
  }
  for (const char* name : {"OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS"}) {
    const auto ranks = count_of(environment, name);
    if (ranks && *ranks > 0)
      return std::max(1, processors / static_cast<int>(std::min<std::size_t>(*ranks, 1U << 20U)));
  }
  return std::max(1, processors);
}

}  // namespace bolo::tools
