// Work that can be shared: in pieces, each done by any process of any host, in any order that their needs allow, and
// done again when it must be.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::tools::cluster {

// Called often while a piece is worked on, from the thread that works on it, with the frames (or what the work counts)
// of this piece that are done; false: end now, with an error.
using Beat = std::function<bool(std::uint64_t)>;

enum class Role {
  kShare,    // the work itself, divided among shards
  kPrelude,  // what later pieces need and nobody else wants: a shard does what its own pieces need
  kClosing,  // what is left when all others of its group are done; whoever did the last of them does it
};

struct Piece {
  std::string name;       // of its record; a file's name
  std::size_t group = 0;  // pieces that fail together: those of one capture
  Role role = Role::kShare;
  std::uint64_t size = 0;          // what Beat counts up to, for progress; 0 for a prelude
  std::vector<std::size_t> needs;  // places of pieces that come before, all smaller than its own
};

// A piece is done when its record says so: what was begun and not finished, torn or lost counts for nothing. Doing a
// piece twice, even at the same time in two places, gives the same result as once. Thread: any one at a time.
class Work {
 public:
  virtual ~Work() = default;
  virtual const std::vector<Piece>& pieces() const = 0;
  // Looks at the shared disk.
  virtual bool done(std::size_t piece) const = 0;
  // All it needs is done. kBadInput: nobody can do it; kFailed: perhaps another one, or later.
  virtual Status run(std::size_t piece, const Beat& beat) = 0;
};

}  // namespace bolo::tools::cluster
