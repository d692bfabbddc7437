// Answers that cannot be changed after the question was asked: their digest is published before anything is diagnosed,
// and tells nobody the answers. Nonce and answers are in this process's memory alone until they are opened, and the
// diagnosis, in a process of its own (diagnosis.hpp), is told of neither.
#pragma once

#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

// SHA-256 in 64 hexadecimal digits. Thread: any.
std::string sha256(const std::string& text);

// What was sealed, in the open: anybody can compute the digest again from it.
struct Opened {
  std::string answers;  // JSON with sorted keys and without blanks
  std::string nonce;    // 64 hexadecimal digits
  std::string digest;   // sha256(answers + nonce)
};

// The digest is published before any diagnosis; the answers stay here until open(). Thread: setup.
class Seal {
 public:
  // kFailed when the system gives no random nonce.
  static Result<Seal> close(const std::vector<Session>& sessions);
  const std::string& digest() const { return digest_; }
  // Opens the seal for `sessions`; kFailed when they are not those that were sealed.
  Result<Opened> open(const std::vector<Session>& sessions) const;

 private:
  std::string nonce_;
  std::string digest_;
};

}  // namespace bolo::tools::blind
