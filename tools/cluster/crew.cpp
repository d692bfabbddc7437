#include "tools/cluster/crew.hpp"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <map>
#include <optional>
#include <thread>
#include <utility>

#include "src/core/clock.hpp"
#include "tools/cluster/coordinator.hpp"
#include "tools/cluster/job_folder.hpp"

namespace bolo::tools::cluster {
namespace {

using Json = nlohmann::json;

constexpr auto kPause = std::chrono::milliseconds(1);
constexpr double kLookEvery_s = 0.001;  // at messages, while it works itself
constexpr double kFollowerAliveEvery_s = 0.5;
constexpr double kLeaderAliveEvery_s = 1.0;

double now_s() { return static_cast<double>(monotonic_ns()) / kNsPerSecond; }

bool stopped(const CrewOptions& options) {
  return options.stop != nullptr && options.stop->load(std::memory_order_relaxed);
}

// A word is JSON of our own making; anything else is nobody's.
std::optional<Json> parsed(const std::string& text) {
  Json word = Json::parse(text, nullptr, false);
  if (word.is_discarded() || !word.is_object()) return std::nullopt;
  return word;
}

}  // namespace

// The loop of rank 0.
struct Leader::Run {
  Run(Leader& leader_in, Work& work_in, const Told& told_in)
      : leader(leader_in),
        work(work_in),
        told(told_in),
        coordinator(work_in, leader_in.messenger_.size(), leader_in.options_.silence_s),
        done_of(work_in.pieces().size(), 0) {
    result.before = coordinator.before();
    result.ranks.resize(leader.here_.size());
    const double now = now_s();
    for (std::size_t rank = 0; rank < leader.here_.size(); ++rank) {
      const Json& here = leader.here_[rank];
      result.ranks[rank].lost = here.is_null();
      if (here.is_null()) continue;
      result.ranks[rank].host = here.value("host", "");
      result.ranks[rank].pid = here.value("pid", 0);
      coordinator.heard(static_cast<int>(rank), now);
    }
  }

  void hear(const Message& message) {
    const auto word = parsed(message.text);
    if (!word) return;
    const double now = now_s();
    coordinator.heard(message.from, now);
    RankShare& share = result.ranks[static_cast<std::size_t>(message.from)];
    if (word->contains("did")) {
      done(message.from, word->at("did").get<std::size_t>(), word->value("seconds", 0.0), now);
    } else if (word->contains("failed")) {
      const auto kind = word->value("kind", 1) == 2 ? ErrorKind::kBadInput : ErrorKind::kFailed;
      const std::size_t piece = word->at("failed").get<std::size_t>();
      coordinator.failed(message.from, piece, {kind, share.host + ": " + word->value("error", "failed")}, now);
    } else if (word->contains("alive")) {
      if (working_on.contains(message.from)) done_of[working_on[message.from]] = word->at("alive").get<std::uint64_t>();
    } else if (word->contains("gone")) {
      coordinator.lost(message.from);
    } else if (word->contains("here")) {
      leader.here_[static_cast<std::size_t>(message.from)] = word->at("here");  // it was late
      share.host = word->at("here").value("host", "");
      share.pid = word->at("here").value("pid", 0);
      leader.send(message.from, {{"plan", leader.plan_}});
    }
  }

  void done(int rank, std::size_t piece, double seconds, double now) {
    coordinator.did(rank, piece, now);
    RankShare& share = result.ranks[static_cast<std::size_t>(rank)];
    ++share.pieces;
    ++result.did;
    share.frames += work.pieces()[piece].size;
    share.busy_s += seconds;
    done_of[piece] = work.pieces()[piece].size;
  }

  // A process of this very host that is gone need not be waited for.
  void look_at_processes() {
    for (std::size_t rank = 1; rank < result.ranks.size(); ++rank) {
      const RankShare& share = result.ranks[rank];
      if (!coordinator.present(static_cast<int>(rank)) || share.pid == 0 || share.host != result.ranks[0].host)
        continue;
      if (::kill(share.pid, 0) != 0 && errno == ESRCH) coordinator.lost(static_cast<int>(rank));
    }
  }

  void hand_out() {
    for (int rank = 1; rank < leader.messenger_.size(); ++rank) {
      const auto piece = coordinator.next(rank);
      if (!piece) continue;
      working_on[rank] = *piece;
      leader.send(rank, {{"piece", *piece}});
    }
  }

  // Everything but rank 0's own work.
  void look() {
    while (const auto message = leader.messenger_.receive()) hear(*message);
    const double now = now_s();
    (void)coordinator.look(now);
    if (now - alive_s >= kLeaderAliveEvery_s) {
      alive_s = now;
      look_at_processes();
      for (int rank = 1; rank < leader.messenger_.size(); ++rank) {
        if (coordinator.present(rank)) leader.send(rank, {{"alive", 0}});
      }
      std::uint64_t frames = 0;
      for (const std::uint64_t of : done_of) frames += of;
      if (told) told(frames);
    }
    hand_out();
  }

  bool beat(std::size_t piece, std::uint64_t frames) {
    done_of[piece] = frames;
    const double now = now_s();
    if (now - look_s >= kLookEvery_s) {
      look_s = now;
      look();
    }
    return !stopped(leader.options_);
  }

  void work_on(std::size_t piece) {
    const double start = now_s();
    const Status status = work.run(piece, [&](std::uint64_t frames) { return beat(piece, frames); });
    if (status) {
      done(0, piece, now_s() - start, now_s());
    } else {
      coordinator.failed(0, piece, status.error(), now_s());
    }
  }

  Leader& leader;
  Work& work;
  const Told& told;
  Coordinator coordinator;
  CrewResult result;
  std::map<int, std::size_t> working_on;
  std::vector<std::uint64_t> done_of;  // frames of each piece, in this run
  double alive_s = 0.0;
  double look_s = 0.0;
};

Leader::Leader(Messenger& messenger, const CrewOptions& options)
    : messenger_(messenger), options_(options), here_(static_cast<std::size_t>(messenger.size())) {
  here_[0] = {{"host", own_host()}, {"pid", ::getpid()}};
}

void Leader::send(int to, const Json& word) { messenger_.send(to, word.dump()); }

void Leader::send_all(const Json& word) {
  for (int rank = 1; rank < messenger_.size(); ++rank) {
    if (!here_[static_cast<std::size_t>(rank)].is_null()) send(rank, word);
  }
}

Result<std::vector<Json>> Leader::gather() {
  const double start = now_s();
  const auto missing = [this] { return std::ranges::count_if(here_, [](const Json& here) { return here.is_null(); }); };
  while (missing() > 0 && now_s() - start < options_.silence_s) {
    if (stopped(options_)) {
      all_present_ = false;
      return tl::unexpected(interruption());
    }
    const auto message = messenger_.receive();
    if (!message) {
      std::this_thread::sleep_for(kPause);
      continue;
    }
    const auto word = parsed(message->text);
    if (word && word->contains("here")) here_[static_cast<std::size_t>(message->from)] = word->at("here");
  }
  all_present_ = missing() == 0;
  std::vector<Json> others;
  for (std::size_t rank = 1; rank < here_.size(); ++rank) {
    if (!here_[rank].is_null()) others.push_back(here_[rank]);
  }
  return others;
}

void Leader::announce(const Json& plan) {
  plan_ = plan;
  send_all({{"plan", plan}});
}

void Leader::end() { send_all({{"end", all_present_}}); }

Result<CrewResult> Leader::lead(Work& work, const Told& told) {
  Run run(*this, work, told);
  while (!run.coordinator.finished()) {
    if (stopped(options_)) {
      all_present_ = false;  // the others were told to end too
      return tl::unexpected(interruption());
    }
    run.look();
    const auto own = run.coordinator.next(0);
    if (own) {
      run.work_on(*own);
    } else {
      std::this_thread::sleep_for(kPause);
    }
  }
  for (int rank = 1; rank < messenger_.size(); ++rank) {
    const bool present = run.coordinator.present(rank);
    run.result.ranks[static_cast<std::size_t>(rank)].lost = !present;
    all_present_ = all_present_ && present;
  }
  run.result.failures = run.coordinator.failures();
  run.result.again = run.coordinator.again();
  return std::move(run.result);
}

Follower::Follower(Messenger& messenger, const CrewOptions& options)
    : messenger_(messenger), options_(options), heard_s_(now_s()) {}

std::optional<Json> Follower::receive() {
  while (const auto message = messenger_.receive()) {
    heard_s_ = now_s();
    if (auto word = parsed(message->text); word && !word->contains("alive")) return word;
  }
  return std::nullopt;
}

Result<Json> Follower::next_word() {
  while (true) {
    if (auto word = receive()) return std::move(*word);
    if (stopped(options_)) return tl::unexpected(interruption());
    if (now_s() - heard_s_ > options_.silence_s) {
      return failed("rank 0 has been silent for " + std::to_string(static_cast<int>(options_.silence_s)) +
                    " s; start the same command again, it goes on from what is done");
    }
    std::this_thread::sleep_for(kPause);
  }
}

Result<std::optional<Json>> Follower::join(const Json& here) {
  Json word = here;
  word["host"] = own_host();
  word["pid"] = ::getpid();
  send({{"here", word}});
  while (true) {
    const auto answer = next_word();
    if (!answer) return tl::unexpected(answer.error());
    if (answer->contains("plan")) return answer->at("plan");
    if (!answer->contains("end")) continue;
    all_present_ = answer->at("end").get<bool>();
    return std::nullopt;
  }
}

Status Follower::follow(Work& work) {
  while (true) {
    const auto word = next_word();
    if (!word) return tl::unexpected(word.error());
    if (word->contains("end")) {
      all_present_ = word->at("end").get<bool>();
      return {};
    }
    if (!word->contains("piece")) continue;
    work_on(work, word->at("piece").get<std::size_t>());
    heard_s_ = now_s();  // nothing was listened to meanwhile
  }
}

void Follower::give_up(const Error& error) { send({{"gone", error.message}}); }

void Follower::work_on(Work& work, std::size_t piece) {
  const double start = now_s();
  double alive_s = start;
  const Status status = work.run(piece, [&](std::uint64_t frames) {
    const double now = now_s();
    if (now - alive_s >= kFollowerAliveEvery_s) {
      alive_s = now;
      send({{"alive", frames}});
    }
    return !stopped(options_);
  });
  if (stopped(options_)) return;
  if (status) {
    send({{"did", piece}, {"seconds", now_s() - start}});
  } else {
    send({{"failed", piece}, {"kind", status.error().exit_code()}, {"error", status.error().message}});
  }
}

}  // namespace bolo::tools::cluster
