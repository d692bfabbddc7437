#include "tools/lab/blind/seal.hpp"

#include "tools/cluster/digest.hpp"
#include "tools/lab/blind/nonce.hpp"

namespace bolo::tools::blind {
namespace {

// Sorted keys, no blanks, shortest numbers that read back the same: one text for one set of answers.
std::string canonical(const std::vector<Session>& sessions) {
  nlohmann::json out = nlohmann::json::array();
  for (const Session& session : sessions) out.push_back(to_json(session));
  return out.dump();
}

}  // namespace

Result<Seal> Seal::close(const std::vector<Session>& sessions) {
  const auto nonce = fresh_nonce();
  if (!nonce) return tl::unexpected(nonce.error());
  return close(sessions, *nonce);
}

Seal Seal::close(const std::vector<Session>& sessions, const std::string& nonce) {
  Seal seal;
  seal.nonce_ = nonce;
  seal.digest_ = cluster::sha256(canonical(sessions) + seal.nonce_);
  return seal;
}

Result<Opened> Seal::open(const std::vector<Session>& sessions) const {
  Opened opened{canonical(sessions), nonce_, {}};
  opened.digest = cluster::sha256(opened.answers + nonce_);
  if (opened.digest != digest_) return failed("the answers are not those that were sealed; the check is void");
  return opened;
}

}  // namespace bolo::tools::blind
