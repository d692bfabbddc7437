#include "tools/lab/soak/reader.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <memory>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "bolo/client.h"
#include "src/core/clock.hpp"

namespace bolo::tools::soak {
namespace {

constexpr int kOpen_ms = 10'000;
constexpr int kLook_ms = 100;
constexpr std::int64_t kTellNs = 500'000'000;
constexpr std::streamoff kEnd = 1024;  // bytes: several lines

struct Close {
  void operator()(bolo_client* client) const { bolo_client_close(client); }
};

void tell(const ReaderAccount& account) {
  std::puts(text_of(account).c_str());
  std::fflush(stdout);
}

}  // namespace

std::string text_of(const ReaderAccount& account) {
  return nlohmann::ordered_json{{"frames", account.frames},
                                {"missed", account.missed},
                                {"restarts", account.restarts},
                                {"disorder", account.disorder}}
      .dump();
}

// From the end of the file: it grows for hours.
ReaderAccount last_account(const std::string& file) {
  std::ifstream in(file, std::ios::ate);
  const std::streamoff size = in.tellg();
  in.seekg(std::max<std::streamoff>(0, size - kEnd));
  ReaderAccount account;
  for (std::string line; std::getline(in, line);) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (!json.is_object()) continue;
    account = {json.value("frames", 0ULL), json.value("missed", 0ULL), json.value("restarts", 0ULL),
               json.value("disorder", 0ULL)};
  }
  return account;
}

Status read_along(const std::string& name, int slow_ms, const std::atomic<bool>& stop) {
  bolo_client* opened = nullptr;
  if (bolo_client_open(name.c_str(), kOpen_ms, &opened) != BOLO_CLIENT_OK) return failed(bolo_client_error(nullptr));
  const std::unique_ptr<bolo_client, Close> client(opened);
  const bolo_client_info* info = bolo_client_get_info(client.get());
  std::vector<std::uint16_t> raw(std::size_t{info->width} * info->height);
  std::vector<std::uint16_t> deblurred(raw.size());
  ReaderAccount account;
  bolo_client_frame frame{};
  std::int64_t last_publish_ns = 0;
  std::int64_t next_tell_ns = monotonic_ns();
  while (!stop.load(std::memory_order_relaxed)) {
    if (monotonic_ns() >= next_tell_ns) {
      tell(account);
      next_tell_ns = monotonic_ns() + kTellNs;
    }
    const int got = bolo_client_next(client.get(), kLook_ms, &frame);
    if (got == BOLO_CLIENT_RESTARTED) ++account.restarts;
    if (got < 0) return failed(bolo_client_error(client.get()));
    if (got != BOLO_CLIENT_OK) continue;
    account.missed += frame.missed;
    if (bolo_client_copy(&frame, raw.data(), deblurred.data()) != BOLO_CLIENT_OK) {
      ++account.missed;
      continue;
    }
    ++account.frames;
    if (frame.publish_ns <= last_publish_ns) ++account.disorder;
    last_publish_ns = frame.publish_ns;
    if (slow_ms > 0) std::this_thread::sleep_for(std::chrono::milliseconds(slow_ms));
  }
  tell(account);
  return {};
}

}  // namespace bolo::tools::soak
