// Shared by the tests of libbolo-client: a handle that closes itself.
#pragma once

#include "bolo/client.h"
#include "tests/test.hpp"

namespace bolo::shm {

struct CloseClient {
  void operator()(bolo_client* client) const noexcept { bolo_client_close(client); }
};
using Client = std::unique_ptr<bolo_client, CloseClient>;

// Null if opening fails; bolo_client_error(nullptr) has the reason.
inline Client open_client(const std::string& name, int timeout_ms = 0) {
  bolo_client* client = nullptr;
  bolo_client_open(name.c_str(), timeout_ms, &client);
  return Client(client);
}

}  // namespace bolo::shm
