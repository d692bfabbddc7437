// Ranks at work together: rank 0 hands out the pieces and works too, the others ask it.
//
// Words are JSON objects. From the others: {"here": {...}} once; {"alive": frames} while a piece is worked on, twice a
// second; {"did": piece, "seconds": s, "frames": n}; {"failed": piece, "kind": exit code, "error": text}; {"gone":
// why}. From rank 0: {"plan": {...}} once; {"piece": piece}; {"alive": 0}, once a second; {"end": all are present}.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/result.hpp"
#include "tools/cluster/messenger.hpp"
#include "tools/cluster/shard.hpp"
#include "tools/cluster/work.hpp"

namespace bolo::tools::cluster {

struct CrewOptions {
  double silence_s = 60.0;                  // after which another process is taken for dead
  const std::atomic<bool>* stop = nullptr;  // the user's interruption
};

// What each rank did.
struct RankShare {
  std::string host;
  int pid = 0;
  std::size_t pieces = 0;
  std::uint64_t frames = 0;
  double busy_s = 0.0;
  bool lost = false;
};

struct CrewResult {
  std::vector<Failure> failures;
  std::size_t before = 0;  // pieces that were done when it began
  std::size_t did = 0;
  std::size_t again = 0;  // handed out once more, since a rank was lost or failed
  std::vector<RankShare> ranks;
};

// Frames done by all ranks so far.
using Told = std::function<void(std::uint64_t)>;

// Rank 0. Thread: the messenger's.
class Leader {
 public:
  Leader(Messenger& messenger, const CrewOptions& options);

  // What the other ranks said of themselves ("here"), when all are here; after silence_s of those that are. kFailed
  // when interrupted.
  Result<std::vector<nlohmann::json>> gather();
  // What they are to do.
  void announce(const nlohmann::json& plan);
  // Until nothing is left. kFailed when interrupted.
  Result<CrewResult> lead(Work& work, const Told& told);
  // Tells the others that it is over; the last word.
  void end();
  // After end(): nobody was lost, so that all can take leave of each other.
  bool all_present() const { return all_present_; }

 private:
  struct Run;

  void send(int to, const nlohmann::json& word);
  void send_all(const nlohmann::json& word);

  Messenger& messenger_;
  CrewOptions options_;
  std::vector<nlohmann::json> here_;  // of each rank; null: not heard
  nlohmann::json plan_;
  bool all_present_ = true;
};

// Any other rank. Thread: the messenger's.
class Follower {
 public:
  Follower(Messenger& messenger, const CrewOptions& options);

  // Says that it is here, and waits for the plan. Nothing: there is nothing to do. kFailed when rank 0 is silent.
  Result<std::optional<nlohmann::json>> join(const nlohmann::json& here);
  // Until rank 0 says so. kFailed when it falls silent, or when interrupted.
  Status follow(Work& work);
  // It cannot take part.
  void give_up(const Error& error);
  bool all_present() const { return all_present_; }

 private:
  std::optional<nlohmann::json> receive();
  Result<nlohmann::json> next_word();
  void work_on(Work& work, std::size_t piece);
  void send(const nlohmann::json& word) { messenger_.send(0, word.dump()); }

  Messenger& messenger_;
  CrewOptions options_;
  double heard_s_;
  bool all_present_ = false;
};

}  // namespace bolo::tools::cluster
