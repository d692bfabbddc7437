// Shared by the tests of libbolo-client: a handle that closes itself.
#pragma once

#include "bolo/client.h"
#include "tests/test.hpp"

namespace bolo::shm {

struct CloseClient {
  void operator()(bolo_client* client) const noexcept { bolo_client_close(client); }
};
using Client = std::unique_ptr<bolo_client, CloseClient>;

// Empty when it can't be opened; bolo_client_error(nullptr) says why.
inline Client open_client(const std::string& name, int timeout_ms = 0) {
  bolo_client* client = nullptr;
  bolo_client_open(name.c_str(), timeout_ms, &client);
  return Client(client);
}

}  // namespace bolo::shm
