// Bytes from a client of the live page, sent to the server over a socket: each input is a connection. The server must
// survive any.
#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <thread>

#include "tests/fuzz/input.hpp"
#include "tools/view/site.hpp"

using namespace bolo;
using namespace bolo::view;

// Replaces the files generated from tools/view/page.
std::span<const PageFile> bolo::view::page_files() {
  static constexpr PageFile kFiles[] = {{"index.html", "page"}, {"app.js", "script"}, {"style.css", "style"}};
  return kFiles;
}

namespace {

// A view of a daemon that does not run.
class Rig {
 public:
  Rig() : stream_("fuzz-view-" + std::to_string(getpid()), [] {}) {
    auto server = HttpServer::listen({"127.0.0.1"}, 0, {}, Site::headers());
    if (!server) std::abort();
    server_ = std::move(*server);
    const Access access{.token = "0123456789abcdef", .beyond_loopback = true, .host_name = "host", .port = 8640};
    site_ = std::make_unique<Site>(
        access, std::vector{&stream_}, [](const std::string& /*name*/) -> Status { return failed("no camera"); }, "");
    thread_ = std::thread([this] { server_->run([this](const Request& r) { return site_->answer(r); }, end_); });
  }
  ~Rig() {
    end_ = true;
    server_->wake();
    thread_.join();
  }
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;
  std::uint16_t port() const { return server_->port(); }

 private:
  LiveStream stream_;
  std::unique_ptr<HttpServer> server_;
  std::unique_ptr<Site> site_;
  std::atomic<bool> end_{false};
  std::thread thread_;
};

// Closing sends a reset, so that no port stays in TIME_WAIT.
UniqueFd connected(std::uint16_t port) {
  UniqueFd fd(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const linger reset{1, 0};
  setsockopt(fd.get(), SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
  const timeval patience{0, 50'000};  // do not wait for answers that wait for a frame
  setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  if (connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) std::abort();
  return fd;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  static const Rig rig;
  const UniqueFd fd = connected(rig.port());
  static_cast<void>(send(fd.get(), data, bytes, MSG_NOSIGNAL));
  shutdown(fd.get(), SHUT_WR);
  std::array<char, 4096> part;
  while (recv(fd.get(), part.data(), part.size(), 0) > 0) {
  }
  return 0;
}
