// Answers that cannot be changed after the question was asked.
//
// A check of one process has its nonce in memory alone. One in a job folder keeps it there from the beginning, in a
// file that only its user may read, beside the plan, which has the seed and the digest: so all that take part, and
// whoever goes on after an interruption, have one seal, which was published before anything was diagnosed. What that
// keeps: the answers cannot be changed without the digest telling, and the digest tells nobody the answers. What it
// does not: the folder's user, and so every process of that user, can read nonce and seed and draw the answers again.
// The diagnosis is not told of the folder (child.hpp), so it cannot learn them by mistake; one that went looking for
// them could.
#pragma once

#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

// What was sealed, in the open: anybody can compute the digest again from it.
struct Opened {
  std::string answers;  // JSON with sorted keys and without blanks
  std::string nonce;    // 64 hexadecimal digits
  std::string digest;   // cluster::sha256(answers + nonce)
};

// The digest is published before any diagnosis; the answers stay here until open(). Thread: setup.
class Seal {
 public:
  // kFailed when the system gives no random nonce.
  static Result<Seal> close(const std::vector<Session>& sessions);
  // With a nonce that is kept (nonce.hpp): the same seal for the same sessions.
  static Seal close(const std::vector<Session>& sessions, const std::string& nonce);
  const std::string& digest() const { return digest_; }
  // Opens the seal for `sessions`; kFailed when they are not those that were sealed.
  Result<Opened> open(const std::vector<Session>& sessions) const;

 private:
  std::string nonce_;
  std::string digest_;
};

}  // namespace bolo::tools::blind
