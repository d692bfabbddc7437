#include "tools/bolod/request_server.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <thread>
#include <utility>
#include <vector>

#include "src/core/clock.hpp"
#include "src/core/threads.hpp"

namespace bolo::daemon {
namespace {

constexpr int kNoRoomPause_ms = 100;  // when the process has no descriptor left for a client
constexpr int kPoll_ms = 100;         // for the end, if there is no event to signal it

struct Client {
  UniqueFd socket;
  std::int64_t deadline_ns;
  std::string received{};
  std::string answer{};  // remaining bytes to send
};

bool passing(int error) { return error == EAGAIN || error == EINTR || error == ECONNABORTED; }

// False: the client has everything, or accepts no more.
bool send_rest(Client& client) {
  const ssize_t sent = send(client.socket.get(), client.answer.data(), client.answer.size(), MSG_NOSIGNAL);
  if (sent < 0) return passing(errno);
  client.answer.erase(0, static_cast<std::size_t>(sent));
  return !client.answer.empty();
}

}  // namespace

struct RequestServer::Impl {
  Impl(UniqueFd l, const Limits& m, Answer a)
      : listener(std::move(l)), stop(eventfd(0, EFD_CLOEXEC)), limits(m), answer(std::move(a)) {}

  std::int64_t deadline() const { return monotonic_ns() + std::int64_t{limits.patience_ms} * kNsPerMs; }

  void serve() {
    std::vector<pollfd> events;
    events.reserve(limits.clients + 2);
    for (;;) {
      list(events);
      if (poll(events.data(), events.size(), wait_ms()) < 0 && errno != EINTR) return;
      if ((events[0].revents & POLLIN) != 0 || ending.load(std::memory_order_relaxed)) return;
      const bool served = attempt([&] {
        attend(events);
        if ((events[1].revents & POLLIN) != 0) accept_all();
      });
      if (!served) clients.clear();  // frames go on
    }
  }

  // Events to wait for: the end, a new client, and each client in the order of `clients`.
  void list(std::vector<pollfd>& events) const {
    const bool full = monotonic_ns() < no_room_until_ns;
    events.assign({{stop.get(), POLLIN, 0}, {full ? -1 : listener.get(), POLLIN, 0}});
    for (const Client& client : clients) {
      events.push_back({client.socket.get(), static_cast<short>(client.answer.empty() ? POLLIN : POLLOUT), 0});
    }
  }

  // Time until the first client's deadline, or until descriptors may be available again.
  int wait_ms() const {
    std::int64_t until_ns = monotonic_ns() < no_room_until_ns ? no_room_until_ns : INT64_MAX;
    if (!stop) until_ns = std::min(until_ns, monotonic_ns() + std::int64_t{kPoll_ms} * kNsPerMs);
    for (const Client& client : clients) until_ns = std::min(until_ns, client.deadline_ns);
    if (until_ns == INT64_MAX) return -1;
    return static_cast<int>(std::max<std::int64_t>(0, until_ns - monotonic_ns()) / kNsPerMs + 1);
  }

  // Reads requests before closing expired clients: an answer to another client may have used up their time.
  void attend(const std::vector<pollfd>& events) {
    std::vector<Client> stay;
    for (std::size_t i = 0; i < clients.size(); ++i) {
      Client& client = clients[i];
      const bool ready = events[i + 2].revents != 0;
      const bool wanted = ready ? proceed(client) : monotonic_ns() < client.deadline_ns;
      if (wanted && monotonic_ns() < client.deadline_ns) stay.push_back(std::move(client));
    }
    clients = std::move(stay);
  }

  // False: done with the client, or it is gone.
  bool proceed(Client& client) {
    if (!client.answer.empty()) return send_rest(client);
    std::array<char, 4096> part;
    const ssize_t got = recv(client.socket.get(), part.data(), part.size(), 0);
    if (got <= 0) return got < 0 && passing(errno);
    client.received.append(part.data(), static_cast<std::size_t>(got));
    std::optional<std::string> text = answer(client.received);
    if (!text) return client.received.size() < limits.longest_request;
    client.answer = std::move(*text);
    client.deadline_ns = deadline();
    return send_rest(client);
  }

  void accept_all() {
    for (std::size_t i = 0; i < limits.clients; ++i) {
      UniqueFd socket(accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
      if (!socket) {
        // The listener stays readable meanwhile: without a pause this would be a busy loop.
        if (!passing(errno)) no_room_until_ns = monotonic_ns() + std::int64_t{kNoRoomPause_ms} * kNsPerMs;
        return;
      }
      if (clients.size() >= limits.clients) clients.erase(clients.begin());
      clients.push_back({std::move(socket), deadline()});
    }
  }

  UniqueFd listener;
  UniqueFd stop;
  std::atomic<bool> ending{false};
  Limits limits;
  Answer answer;
  std::vector<Client> clients{};  // oldest first
  std::int64_t no_room_until_ns = 0;
  std::thread thread{};
};

RequestServer::RequestServer(UniqueFd listener, const Limits& limits, Answer answer)
    : impl_(std::make_unique<Impl>(std::move(listener), limits, std::move(answer))) {
  impl_->thread = std::thread([self = impl_.get()] { self->serve(); });
}

RequestServer::~RequestServer() {
  impl_->ending.store(true, std::memory_order_relaxed);
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = write(impl_->stop.get(), &one, sizeof one);
  impl_->thread.join();
}

}  // namespace bolo::daemon
