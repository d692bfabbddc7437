#include "tools/lab/blind/nonce.hpp"

#include <fcntl.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <system_error>

#include "src/core/unique_fd.hpp"
#include "tools/cluster/job_folder.hpp"

namespace bolo::tools::blind {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kDigits = 64;

// No moment at which others might read it.
Status write_private(const fs::path& file, const std::string& text) {
  std::error_code ignored;
  fs::remove(file, ignored);
  const UniqueFd out(::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (out && ::write(out.get(), text.data(), text.size()) == static_cast<ssize_t>(text.size())) return {};
  return failed(file.string() + ": cannot be written: " + std::strerror(errno));
}

}  // namespace

Result<std::string> fresh_nonce() {
  std::array<unsigned char, kDigits / 2> bytes{};
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

fs::path nonce_file(const fs::path& job) { return job / "nonce"; }

Result<std::optional<std::string>> kept_nonce(const fs::path& job) {
  const fs::path file = nonce_file(job);
  std::error_code ignored;
  if (!fs::exists(file, ignored)) return std::nullopt;
  std::ifstream in(file);
  std::string nonce;
  in >> nonce;
  const bool digits = std::ranges::all_of(nonce, [](unsigned char c) { return std::isxdigit(c) != 0; });
  if (in && digits && nonce.size() == kDigits) return std::optional(nonce);
  return bad_input(file.string() + ": cannot be read, or is no nonce; remove " + job.string() + " to begin anew");
}

Result<std::string> keep_nonce(const fs::path& job) {
  auto nonce = fresh_nonce();
  if (!nonce) return nonce;
  std::error_code error;
  fs::create_directories(job / "data", error);
  if (error) return bad_input(job.string() + ": cannot be made a folder: " + error.message());
  const fs::path own = job / "data" / (cluster::own_name() + "-nonce");
  Status status = write_private(own, *nonce + "\n");
  if (status) status = cluster::publish_first(own, nonce_file(job));
  if (!status) return tl::unexpected(status.error());
  const auto kept = kept_nonce(job);
  if (!kept) return tl::unexpected(kept.error());
  if (!*kept) return failed(nonce_file(job).string() + ": is gone; is anybody removing " + job.string() + "?");
  return **kept;
}

}  // namespace bolo::tools::blind
