#include "tools/view/access.hpp"

#include <arpa/inet.h>
#include <strings.h>
#include <sys/random.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

#include <fmt/format.h>

#include "src/core/input_file.hpp"

namespace bolo::view {
namespace {

constexpr std::size_t kShortestToken = 16;
constexpr std::size_t kLongestToken = 128;
constexpr std::uint64_t kLargestTokenFile = 4096;

std::string cookie_name(const Access& access) { return "bolo_view_" + std::to_string(access.port); }

// Takes as long for a wrong token as for the right one, as far as the lengths are the same.
bool same(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned differ = 0;
  for (std::size_t i = 0; i < a.size(); ++i) differ |= static_cast<unsigned>(a[i] ^ b[i]);
  return differ == 0;
}

// "name:8640" -> "name", "[::1]:8640" -> "::1"
std::string without_port(const std::string& host) {
  if (host.starts_with('[')) return host.substr(1, host.find(']') - 1);
  return host.substr(0, host.find(':'));
}

bool equal_names(const std::string& a, const std::string& b) { return strcasecmp(a.c_str(), b.c_str()) == 0; }

bool has_token(const Access& access, const Request& request) {
  if (access.token.empty()) return false;
  return same(request.cookie(cookie_name(access).c_str()).value_or(""), access.token) ||
         same(request.argument("token").value_or(""), access.token);
}

// Browsers of our time say where a request comes from; others are held off by what they cannot read.
bool from_another_site(const Request& request) {
  const std::string site = request.header("Sec-Fetch-Site").value_or("none");
  return site == "cross-site" || site == "same-site";
}

}  // namespace

Status check_token(const std::string& token) {
  const bool clean = std::all_of(token.begin(), token.end(),
                                 [](unsigned char c) { return std::isalnum(c) != 0 || c == '-' || c == '_'; });
  if (clean && token.size() >= kShortestToken && token.size() <= kLongestToken) return {};
  return bad_input("the token must have 16 to 128 letters, digits, '-' or '_'; make one: openssl rand -hex 16");
}

Result<std::string> random_token() {
  std::array<unsigned char, 16> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    return failed("the system has no random numbers: give --token-file FILE");
  }
  return fmt::format("{:02x}", fmt::join(bytes, ""));
}

Result<std::string> read_token(const std::string& file) {
  struct stat about {};
  ASSIGN_OR_RETURN(const std::string whole, read_input(file, kLargestTokenFile));
  if (stat(file.c_str(), &about) != 0) return bad_input("cannot read the token file " + file);
  if ((about.st_mode & 077) != 0) return bad_input("others may read the token file: chmod 600 " + file);
  const std::string token = whole.substr(0, whole.find('\n'));
  if (const Status good = check_token(token); !good) return at(file, good.error());
  return token;
}

bool is_numeric(const std::string& address) {
  in6_addr place{};
  return inet_pton(AF_INET, address.c_str(), &place) == 1 || inet_pton(AF_INET6, address.c_str(), &place) == 1;
}

bool is_loopback(const std::string& address) {
  in_addr v4{};
  if (inet_pton(AF_INET, address.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24 == 127;
  in6_addr v6{};
  return inet_pton(AF_INET6, address.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6) != 0;
}

bool is_this_computer(const Access& access, const std::string& host) {
  const std::string name = without_port(host);
  if (equal_names(name, "localhost") || is_loopback(name)) return true;
  if (!access.beyond_loopback) return false;
  // Rebinding needs a name of its own: an address, or the name this computer gives itself, is none.
  return is_numeric(name) || equal_names(name, access.host_name) || equal_names(name, access.host_name + ".local");
}

std::optional<Answer> refusal(const Access& access, const Request& request) {
  const auto host = request.header("Host");
  if (!host) return line(400, "the Host header is missing");
  if (!is_this_computer(access, *host)) return line(403, "this address does not belong to the view: use localhost");
  if (!has_token(access, request)) {
    return line(401, "a token is needed: open the address that bolo view printed, or with the ?token= it was given");
  }
  const bool page = request.path() == "/";  // may be reached by a link
  if (!page && from_another_site(request)) return line(403, "only the view's own page may ask for this");
  if (request.method() == "POST" && request.header("Origin").value_or("") != "http://" + *host) {
    return line(403, "only the view's own page may do this");
  }
  return std::nullopt;
}

std::optional<std::string> cookie_for(const Access& access, const Request& request) {
  if (!request.argument("token")) return std::nullopt;
  return cookie_name(access) + "=" + access.token + "; Path=/; HttpOnly; SameSite=Strict; Max-Age=604800";
}

}  // namespace bolo::view
