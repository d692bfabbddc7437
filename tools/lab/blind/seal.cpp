#include "tools/lab/blind/seal.hpp"

#include <sys/random.h>

#include <array>
#include <cstdio>
#include <memory>

#include <glib.h>

namespace bolo::tools::blind {
namespace {

// Sorted keys, no blanks, shortest numbers that read back the same: one text for one set of answers.
std::string canonical(const std::vector<Session>& sessions) {
  nlohmann::json out = nlohmann::json::array();
  for (const Session& session : sessions) out.push_back(to_json(session));
  return out.dump();
}

// 64 hexadecimal digits.
Result<std::string> fresh_nonce() {
  std::array<unsigned char, 32> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    return failed("the system gives no random numbers to seal the answers with");
  }
  std::string text;
  for (const unsigned char byte : bytes) {
    std::array<char, 3> hex{};
    std::snprintf(hex.data(), hex.size(), "%02x", static_cast<unsigned>(byte));
    text += hex.data();
  }
  return text;
}

}  // namespace

std::string sha256(const std::string& text) {
  const std::unique_ptr<char, decltype(&g_free)> digest(
      g_compute_checksum_for_data(G_CHECKSUM_SHA256, reinterpret_cast<const unsigned char*>(text.data()), text.size()),
      &g_free);
  return digest.get();
}

Result<Seal> Seal::close(const std::vector<Session>& sessions) {
  auto nonce = fresh_nonce();
  if (!nonce) return tl::unexpected(nonce.error());
  Seal seal;
  seal.nonce_ = std::move(*nonce);
  seal.digest_ = sha256(canonical(sessions) + seal.nonce_);
  return seal;
}

Result<Opened> Seal::open(const std::vector<Session>& sessions) const {
  Opened opened{canonical(sessions), nonce_, {}};
  opened.digest = sha256(opened.answers + nonce_);
  if (opened.digest != digest_) return failed("the answers are not those that were sealed; the check is void");
  return opened;
}

}  // namespace bolo::tools::blind
