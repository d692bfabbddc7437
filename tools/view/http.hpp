// A small HTTP server over libmicrohttpd: one thread, bounded connections, deferred answers.
#pragma once

#include <microhttpd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::view {

// A request without a body; requests with one are refused before a handler sees them.
class Request {
 public:
  Request(MHD_Connection* connection, std::string method, std::string path)
      : connection_(connection), method_(std::move(method)), path_(std::move(path)) {}

  const std::string& method() const noexcept { return method_; }
  const std::string& path() const noexcept { return path_; }
  // Values as the client sent them; nothing if absent. Header names are case-insensitive. Thread: the server's.
  std::optional<std::string> header(const char* name) const { return value(MHD_HEADER_KIND, name); }
  std::optional<std::string> argument(const char* name) const { return value(MHD_GET_ARGUMENT_KIND, name); }
  std::optional<std::string> cookie(const char* name) const { return value(MHD_COOKIE_KIND, name); }

  std::chrono::milliseconds waited() const {
    return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::steady_clock::now() - since_);
  }

 private:
  std::optional<std::string> value(MHD_ValueKind kind, const char* name) const {
    const char* found = MHD_lookup_connection_value(connection_, kind, name);
    return found == nullptr ? std::nullopt : std::optional<std::string>(found);
  }

  MHD_Connection* connection_;
  std::string method_;
  std::string path_;
  std::chrono::steady_clock::time_point since_ = std::chrono::steady_clock::now();
};

struct Answer {
  unsigned status = 200;
  std::string type = "text/plain; charset=utf-8";
  std::shared_ptr<const std::string> body = std::make_shared<const std::string>();
  std::vector<std::pair<std::string, std::string>> headers{};
};

Answer line(unsigned status, const std::string& words);

class HttpServer {
 public:
  // Returns nothing while the answer is unknown: it is then called again after each wake(), and some times a second.
  using Handler = std::function<std::optional<Answer>(const Request&)>;

  struct Limits {
    // Open at once. Beyond, the one longest without a request is closed, or the one whose answer has taken longest.
    unsigned connections = 48;
    unsigned waiting = 32;  // requests without an answer yet; further ones get 503
    unsigned idle_s = 30;   // a connection without a request for this long is closed
  };

  // Listens on numeric addresses, all with one port; port 0: any free one. An address that this host lacks is skipped
  // if another one works. `headers` are added to each answer. Thread: setup.
  static Result<std::unique_ptr<HttpServer>> listen(const std::vector<std::string>& addresses, std::uint16_t port,
                                                    const Limits& limits,
                                                    std::vector<std::pair<std::string, std::string>> headers);
  ~HttpServer();

  std::uint16_t port() const noexcept { return port_; }

  // Serves until `end` is set, calling the handler on this thread. Thread: one.
  void run(const Handler& handler, const std::atomic<bool>& end);

  // Asks waiting requests again. Thread: any.
  void wake() const noexcept;

 private:
  struct Exchange;
  HttpServer(const Limits& limits, std::vector<std::pair<std::string, std::string>> headers);

  static MHD_Result on_request(void* self, MHD_Connection* connection, const char* path, const char* method,
                               const char* version, const char* body, std::size_t* body_bytes, void** exchange);
  static void on_connection(void* self, MHD_Connection* connection, void** unused, MHD_ConnectionNotificationCode code);
  static void on_completed(void* self, MHD_Connection* connection, void** exchange, MHD_RequestTerminationCode code);
  Status add_listener(const std::string& address, bool& absent);
  MHD_Result begin(MHD_Connection* connection, const char* path, const char* method, void** exchange);
  MHD_Result answer_or_wait(MHD_Connection* connection, Exchange& exchange);
  MHD_Result send(MHD_Connection* connection, const Answer& answer) const;
  void make_room();
  void resume_waiting();
  void wait_for_work() const;

  Limits limits_;
  std::vector<std::pair<std::string, std::string>> headers_;
  std::uint16_t port_ = 0;
  UniqueFd woken_;
  std::vector<MHD_Daemon*> listeners_;
  std::vector<MHD_Connection*> waiting_;
  std::vector<MHD_Connection*> silent_;  // connections without a request, oldest first
  std::vector<MHD_Connection*> asking_;  // connections with a request
  std::size_t connections_ = 0;
  const Handler* handler_ = nullptr;
};

}  // namespace bolo::view
