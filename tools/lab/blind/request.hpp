// What `bolo-lab blind` is asked to do.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include <cxxopts.hpp>

#include "src/core/result.hpp"
#include "tools/lab/blind/check.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

struct BlindRequest {
  DrawOptions draw;
  std::vector<Kind> kinds;
  std::int64_t first = 0;         // index of the first session of each kind
  std::int64_t count = 0;         // sessions of each kind
  std::vector<Session> sessions;  // drawn
  CheckOptions check;
  OutputFile html;  // empty: no page
  bool json = false;
};

cxxopts::Options blind_command_line();

// Draws the sessions. Errors name the option. Thread: setup.
Result<BlindRequest> read_blind_request(const cxxopts::ParseResult& args);

}  // namespace bolo::tools::blind
