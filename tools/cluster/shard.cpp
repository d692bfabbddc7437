#include "tools/cluster/shard.hpp"

#include <algorithm>
#include <charconv>
#include <set>
#include <string_view>

namespace bolo::tools::cluster {
namespace {

bool read_number(std::string_view text, std::size_t& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

class ShardRun {
 public:
  ShardRun(Work& work, const Beat& beat, const std::function<void(std::size_t)>& told)
      : work_(work), beat_(beat), told_(told) {}

  ShardResult result;

  // False when it was told to end.
  bool share(std::size_t piece) {
    if (work_.done(piece)) {
      ++result.before;
      return true;
    }
    return with_needs(piece);
  }

  bool close(std::size_t piece) {
    if (work_.done(piece)) return true;
    const auto& needs = work_.pieces()[piece].needs;
    const auto ready = [&] {
      return std::ranges::all_of(needs, [this](std::size_t need) { return work_.done(need); });
    };
    if (!ready()) return true;
    if (!run(piece)) return false;
    if (work_.done(piece) || ready()) return true;
    // What a need had left was damaged: it is done again, and this once more.
    result.failures.pop_back();
    broken_.erase(work_.pieces()[piece].group);
    return with_needs(piece);
  }

 private:
  bool with_needs(std::size_t piece) {
    for (const std::size_t need : work_.pieces()[piece].needs) {
      if (!work_.done(need) && !with_needs(need)) return false;
    }
    return run(piece);
  }

  bool run(std::size_t piece) {
    const std::size_t group = work_.pieces()[piece].group;
    if (broken_.contains(group)) return true;
    bool ended = false;
    const Status status = work_.run(piece, [&](std::uint64_t done) {
      ended = ended || !beat_(done);
      return !ended;
    });
    if (ended) return false;
    if (status) {
      result.did.push_back(piece);
      if (told_) told_(piece);
    } else {
      result.failures.push_back({piece, status.error()});
      broken_.insert(group);
    }
    return true;
  }

  Work& work_;
  const Beat& beat_;
  const std::function<void(std::size_t)>& told_;
  std::set<std::size_t> broken_;
};

}  // namespace

Result<Shard> shard_named(const std::string& text) {
  const std::size_t slash = text.find('/');
  Shard shard;
  const bool numbers = slash != std::string::npos &&
                       read_number(std::string_view(text).substr(0, slash), shard.index) &&
                       read_number(std::string_view(text).substr(slash + 1), shard.count);
  if (!numbers || shard.count < 1 || shard.count > 1'000'000 || shard.index > shard.count) {
    return bad_input("--shard '" + text + "': give I/N, the I-th of N parts, counted from 0 or from 1");
  }
  shard.index %= shard.count;
  return shard;
}

std::vector<std::size_t> shares_of(const Work& work, const Shard& shard) {
  std::vector<std::size_t> shares;
  for (std::size_t i = 0; i < work.pieces().size(); ++i) {
    if (work.pieces()[i].role == Role::kShare) shares.push_back(i);
  }
  const auto bound = [&](std::size_t index) {
    return shares.begin() + static_cast<std::ptrdiff_t>(shares.size() * index / shard.count);
  };
  return {bound(shard.index), bound(shard.index + 1)};
}

std::size_t pieces_left(const Work& work) {
  std::size_t left = 0;
  for (std::size_t i = 0; i < work.pieces().size(); ++i) {
    if (work.pieces()[i].role != Role::kPrelude && !work.done(i)) ++left;
  }
  return left;
}

Error interruption() {
  return {ErrorKind::kFailed, "interrupted; what is done stays done, the same command goes on from there"};
}

Result<ShardResult> run_shard(Work& work, const Shard& shard, const Beat& beat,
                              const std::function<void(std::size_t)>& told) {
  const std::vector<std::size_t> shares = shares_of(work, shard);
  ShardRun run(work, beat, told);
  bool going = true;
  for (std::size_t i = 0; going && i < shares.size(); ++i) going = run.share(shares[i]);
  for (std::size_t i = 0; going && i < work.pieces().size(); ++i) {
    if (work.pieces()[i].role == Role::kClosing) going = run.close(i);
  }
  if (!going) return tl::unexpected(interruption());
  run.result.left = pieces_left(work);
  return std::move(run.result);
}

}  // namespace bolo::tools::cluster
