// Who may ask the view for what. A browser sends requests to loopback on behalf of any page that it shows, and any user
// of this computer can connect, whatever he may read of shared memory and control socket: what is local is not trusted
// for being local.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/view/http.hpp"

namespace bolo::view {

struct Access {
  std::string token;             // that every request has to bring; an empty one lets nobody in
  bool beyond_loopback = false;  // other computers may connect: they name this one by its address or its host name
  std::string host_name{};
  std::uint16_t port = 0;
};

// Good tokens have 16 to 128 letters, digits, '-' and '_'. Thread: any.
Status check_token(const std::string& token);
// 32 letters that nobody can guess. Thread: setup.
Result<std::string> random_token();
// The first line of a file that only its owner may read. Thread: setup.
Result<std::string> read_token(const std::string& file);

// The refusal of a request: 400 (no Host), 403 (a Host that is not this computer: DNS rebinding; another site's
// page; a change without an Origin that is this page), 401 (no token). Nothing: it may pass. Thread: any.
std::optional<Answer> refusal(const Access& access, const Request& request);

// The cookie to be set for a request that brought the token as ?token=; nothing otherwise. Thread: any.
std::optional<std::string> cookie_for(const Access& access, const Request& request);

// True if a Host header ("localhost:8640", "[::1]") names this computer. Thread: any.
bool is_this_computer(const Access& access, const std::string& host);

// True for an IP address, and no more than that. Thread: any.
bool is_numeric(const std::string& address);

// True for a numeric address of the loopback interface. Thread: any.
bool is_loopback(const std::string& address);

}  // namespace bolo::view
