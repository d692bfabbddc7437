#include "tools/view/http.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "src/core/ip_address.hpp"

namespace bolo::view {
namespace {

constexpr int kAskAgain_ms = 50;                 // waiting requests may have timed out by then
constexpr std::size_t kConnectionBytes = 16384;  // request line and headers; longer ones are refused with 431
constexpr int kBacklog = 16;

std::string describe_bind_error(const std::string& address, std::uint16_t port) {
  const std::string where = "cannot listen on " + address + " port " + std::to_string(port) + ": ";
  if (errno == EADDRINUSE) return where + "another program does; choose another --port";
  if (errno == EACCES) return where + "ports below 1024 are for root; choose another --port";
  if (errno == EADDRNOTAVAIL) return where + "this computer has no such address; see `ip address`";
  return where + std::strerror(errno);
}

// `absent`: set if the host lacks this address or its family.
Result<UniqueFd> listening_socket(const std::string& text, std::uint16_t port, bool& absent) {
  const auto address = ip_address(text, port);
  if (!address) return bad_input("address '" + text + "' is not a numeric IP address such as 192.168.1.10 or ::1");
  UniqueFd fd = listen_on(*address, kBacklog, address->place.ss_family == AF_INET6);
  if (fd) return fd;
  absent = errno == EADDRNOTAVAIL || errno == EAFNOSUPPORT;
  return bad_input(describe_bind_error(text, port));
}

std::uint16_t port_of(int fd) {
  sockaddr_storage place{};
  socklen_t bytes = sizeof place;
  getsockname(fd, reinterpret_cast<sockaddr*>(&place), &bytes);
  return place.ss_family == AF_INET6 ? ntohs(reinterpret_cast<sockaddr_in6*>(&place)->sin6_port)
                                     : ntohs(reinterpret_cast<sockaddr_in*>(&place)->sin_port);
}

// Discards the library's messages about misbehaving clients.
void ignore(void*, const char*, va_list) {}

void release_body(void* body) { delete static_cast<std::shared_ptr<const std::string>*>(body); }

}  // namespace

Answer line(unsigned status, const std::string& words) {
  return {.status = status, .body = std::make_shared<const std::string>(words + "\n")};
}

struct HttpServer::Exchange {
  Request request;
  bool waits = false;
};

HttpServer::HttpServer(const Limits& limits, std::vector<std::pair<std::string, std::string>> headers)
    : limits_(limits), headers_(std::move(headers)), woken_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {}

HttpServer::~HttpServer() {
  resume_waiting();  // the library requires that none is suspended
  for (MHD_Daemon* listener : listeners_) MHD_stop_daemon(listener);
}

Result<std::unique_ptr<HttpServer>> HttpServer::listen(const std::vector<std::string>& addresses, std::uint16_t port,
                                                       const Limits& limits,
                                                       std::vector<std::pair<std::string, std::string>> headers) {
  std::unique_ptr<HttpServer> server(new HttpServer(limits, std::move(headers)));
  server->port_ = port;
  Status last;
  for (const std::string& address : addresses) {
    bool absent = false;
    last = server->add_listener(address, absent);
    if (!last && !absent) break;
    if (last || !server->listeners_.empty()) last = {};
  }
  if (!last) return tl::unexpected<Error>(last.error());
  return server;
}

Status HttpServer::add_listener(const std::string& address, bool& absent) {
  ASSIGN_OR_RETURN(const UniqueFd fd, listening_socket(address, port_, absent));
  if (port_ == 0) port_ = port_of(fd.get());
  const auto refused = [&] {
    return failed("cannot serve on " + address + ": " + std::strerror(errno) + "; free some, or raise ulimit -n");
  };
  const int copy = fcntl(fd.get(), F_DUPFD_CLOEXEC, 0);  // owned and closed by the library
  if (copy < 0) return refused();                        // without a socket it would listen on all addresses
  MHD_Daemon* listener = MHD_start_daemon(
      MHD_USE_EPOLL | MHD_ALLOW_SUSPEND_RESUME, 0, nullptr, nullptr, &HttpServer::on_request, this,
      MHD_OPTION_EXTERNAL_LOGGER, &ignore, nullptr, MHD_OPTION_LISTEN_SOCKET, copy, MHD_OPTION_CONNECTION_LIMIT,
      limits_.connections + kBacklog, MHD_OPTION_CONNECTION_TIMEOUT, limits_.idle_s, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
      kConnectionBytes, MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_NOTIFY_COMPLETED, &HttpServer::on_completed, this,
      MHD_OPTION_NOTIFY_CONNECTION, &HttpServer::on_connection, this, MHD_OPTION_END);
  if (listener == nullptr) {
    auto why = refused();
    ::close(copy);
    return why;
  }
  listeners_.push_back(listener);
  return {};
}

void HttpServer::run(const Handler& handler, const std::atomic<bool>& end) {
  handler_ = &handler;
  while (!end.load(std::memory_order_relaxed)) {
    wait_for_work();
    resume_waiting();
    for (MHD_Daemon* listener : listeners_) MHD_run(listener);
  }
}

// Sleeps until a socket is ready, wake() is called, or waiting requests are due to be asked again.
void HttpServer::wait_for_work() const {
  std::vector<pollfd> fds{{woken_.get(), POLLIN, 0}};
  MHD_UNSIGNED_LONG_LONG wait_ms = waiting_.empty() ? 250 : kAskAgain_ms;
  for (MHD_Daemon* listener : listeners_) {
    fds.push_back({MHD_get_daemon_info(listener, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd, POLLIN, 0});
    MHD_UNSIGNED_LONG_LONG theirs_ms = 0;
    if (MHD_get_timeout(listener, &theirs_ms) == MHD_YES) wait_ms = std::min(wait_ms, theirs_ms);
  }
  poll(fds.data(), fds.size(), static_cast<int>(wait_ms));
  eventfd_t count = 0;
  eventfd_read(woken_.get(), &count);
}

void HttpServer::resume_waiting() {
  for (MHD_Connection* connection : waiting_) MHD_resume_connection(connection);
  waiting_.clear();
}

void HttpServer::wake() const noexcept { eventfd_write(woken_.get(), 1); }

MHD_Result HttpServer::on_request(void* self, MHD_Connection* connection, const char* path, const char* method,
                                  const char* /*version*/, const char* /*body*/, std::size_t* body_bytes,
                                  void** exchange) {
  auto& server = *static_cast<HttpServer*>(self);
  if (*exchange == nullptr) return server.begin(connection, path, method, exchange);
  if (*body_bytes != 0) return MHD_NO;  // refused by begin()
  return server.answer_or_wait(connection, *static_cast<Exchange*>(*exchange));
}

MHD_Result HttpServer::begin(MHD_Connection* connection, const char* path, const char* method, void** exchange) {
  std::erase(silent_, connection);
  asking_.push_back(connection);
  auto made = std::make_unique<Exchange>(Exchange{.request = Request(connection, method, path)});
  const std::string length = made->request.header(MHD_HTTP_HEADER_CONTENT_LENGTH).value_or("0");
  if (length != "0" || made->request.header(MHD_HTTP_HEADER_TRANSFER_ENCODING)) {
    return send(connection, line(413, "no request here has a body"));
  }
  *exchange = made.release();  // owned until on_completed()
  return MHD_YES;
}

MHD_Result HttpServer::answer_or_wait(MHD_Connection* connection, Exchange& exchange) {
  const std::optional<Answer> answer = (*handler_)(exchange.request);
  if (answer) return send(connection, *answer);
  if (waiting_.size() >= limits_.waiting) return send(connection, line(503, "too many requests are waiting"));
  waiting_.push_back(connection);
  MHD_suspend_connection(connection);
  return MHD_YES;
}

// A client may open all connections and keep each alive by a byte now and then; the library's own limit would let it.
// So would clients that stopped reading (a laptop asleep), authorised or not.
void HttpServer::on_connection(void* self, MHD_Connection* connection, void** /*unused*/,
                               MHD_ConnectionNotificationCode code) {
  auto& server = *static_cast<HttpServer*>(self);
  if (code == MHD_CONNECTION_NOTIFY_CLOSED) {
    --server.connections_;
    std::erase(server.silent_, connection);
    std::erase(server.asking_, connection);
    return;
  }
  ++server.connections_;
  server.silent_.push_back(connection);
  if (server.connections_ > server.limits_.connections) server.make_room();
}

// The library closes it when it next polls its sockets.
void HttpServer::make_room() {
  auto& from = silent_.size() > 1 || asking_.empty() ? silent_ : asking_;  // the newest silent one has only just come
  shutdown(MHD_get_connection_info(from.front(), MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd, SHUT_RDWR);
  from.erase(from.begin());
}

void HttpServer::on_completed(void* self, MHD_Connection* connection, void** exchange, MHD_RequestTerminationCode) {
  auto& server = *static_cast<HttpServer*>(self);
  std::erase(server.waiting_, connection);
  std::erase(server.asking_, connection);
  server.silent_.push_back(connection);
  delete static_cast<Exchange*>(*exchange);
  *exchange = nullptr;
}

MHD_Result HttpServer::send(MHD_Connection* connection, const Answer& answer) const {
  auto* keeper = new std::shared_ptr<const std::string>(answer.body);
  MHD_Response* response = MHD_create_response_from_buffer_with_free_callback_cls(
      answer.body->size(), const_cast<char*>(answer.body->data()), &release_body, keeper);
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, answer.type.c_str());
  for (const auto* headers : {&headers_, &answer.headers}) {
    for (const auto& [name, value] : *headers) MHD_add_response_header(response, name.c_str(), value.c_str());
  }
  const MHD_Result queued = MHD_queue_response(connection, answer.status, response);
  MHD_destroy_response(response);
  return queued;
}

}  // namespace bolo::view
