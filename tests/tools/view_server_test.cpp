// Requests refused and accepted by the view's server, and its limits.
#include <poll.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "src/core/ip_address.hpp"
#include "tests/child.hpp"
#include "tests/no_threads.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tests/tools/sockets.hpp"
#include "tools/view/site.hpp"

namespace bolo::view::view_server_test {

namespace test = tools::test;
using namespace test;

constexpr const char* kToken = "0123456789abcdef-_XY";

UniqueFd connected(std::uint16_t port) {
  UniqueFd fd = test::patient_socket(AF_INET);
  EXPECT_TRUE(test::connect_to(fd, "127.0.0.1", port));
  return fd;
}

// A view of a daemon that does not run.
class ViewServer : public testing::Test {
 protected:
  void serve(HttpServer::Limits limits) { serve(1, limits); }
  void serve(int cameras = 1, HttpServer::Limits limits = {}, const std::string& token = kToken) {
    Access access{.token = token};
    auto server = must(HttpServer::listen({"127.0.0.1"}, 0, limits, Site::headers()));
    server_ = std::move(*server);
    access.port = server_->port();
    std::vector<LiveStream*> lent;
    for (int i = 0; i < cameras; ++i) {
      const std::string name = "test-view-none-" + std::to_string(i) + "-" + std::to_string(getpid());
      streams_.push_back(std::make_unique<LiveStream>(name, [] {}));
      lent.push_back(streams_.back().get());
    }
    const auto ask = [this](const std::string& /*name*/) -> Status {
      ++nucs_;
      while (hold_nuc_.load()) std::this_thread::yield();
      return failed("the camera does not answer");
    };
    site_ = std::make_unique<Site>(access, lent, ask, "");
    thread_ =
        std::thread([this] { server_->run([this](const Request& request) { return site_->answer(request); }, end_); });
  }

  void TearDown() override {
    hold_nuc_ = false;
    end_ = true;
    if (server_) server_->wake();
    if (thread_.joinable()) thread_.join();
  }

  std::string cookie(const std::string& token = kToken) const {
    return "Cookie: bolo_view_" + std::to_string(server_->port()) + "=" + token + "\r\n";
  }
  // A request of an authorised browser, with its own connection.
  std::string request_for(const std::string& path) const {
    return "GET " + path + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + cookie() + "\r\n";
  }
  // Expects that a new client is served soon.
  void expect_room() const {
    const UniqueFd fd = test::patient_socket(AF_INET, 5);
    ASSERT_TRUE(test::connect_to(fd, "127.0.0.1", server_->port()));
    send_text(fd, request_for("/icon.svg"));
    EXPECT_TRUE(receive_all(fd).starts_with("HTTP/1.1 200"));
  }
  // Complete answer to a request line and headers; closes the connection.
  std::string ask_bare(const std::string& request, const std::string& headers, const std::string& host) {
    const UniqueFd fd = connected(server_->port());
    send_text(fd, request + " HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n" + headers + "\r\n");
    return receive_all(fd);
  }
  // The same from an authorised browser.
  std::string ask(const std::string& request, const std::string& headers = "", const std::string& host = "localhost") {
    return ask_bare(request, cookie() + headers, host);
  }

  int status(const std::string& request, const std::string& headers = "", const std::string& host = "localhost") {
    return status_of(ask(request, headers, host));
  }
  int status_without_cookie(const std::string& request, const std::string& headers = "") {
    return status_of(ask_bare(request, headers, "localhost"));
  }
  static int status_of(const std::string& answer) {
    return answer.starts_with("HTTP/1.1 ") ? std::stoi(answer.substr(9, 3)) : 0;
  }

  std::unique_ptr<HttpServer> server_;
  std::vector<std::unique_ptr<LiveStream>> streams_;
  std::unique_ptr<Site> site_;
  std::atomic<int> nucs_{0};
  std::atomic<bool> hold_nuc_{false};
  std::atomic<bool> end_{false};
  std::thread thread_;
};

TEST_F(ViewServer, ServesThePageAndOnlyIt) {
  serve();
  const std::string page = ask("GET /");
  EXPECT_TRUE(page.starts_with("HTTP/1.1 200")) << page.substr(0, 200);
  expect_parts(page, {"Content-Security-Policy: default-src 'self'", "X-Content-Type-Options: nosniff"});
  EXPECT_EQ(page.find("Access-Control-Allow"), std::string::npos);
  for (const PageFile& file : page_files()) {
    const std::string answer = ask("GET /" + std::string(file.name));
    EXPECT_TRUE(answer.ends_with(file.content)) << file.name;
  }
  for (const char* path : {"/nothing", "/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/api",
                           "/api/", "/page", "/index.html/"}) {
    EXPECT_EQ(status(std::string("GET ") + path), 404) << path;
  }
}

TEST_F(ViewServer, ServesSeveralCamerasEachAtItsPlace) {
  serve(2);
  const auto content = [](std::string_view name) {
    const auto files = page_files();
    return std::find_if(files.begin(), files.end(), [name](const PageFile& f) { return f.name == name; })->content;
  };
  const std::string first = "/camera/" + streams_[0]->name();
  EXPECT_TRUE(ask("GET /").ends_with(content("all.html")));
  EXPECT_TRUE(ask("GET " + first + "/").ends_with(content("index.html")));
  EXPECT_TRUE(ask("GET " + first + "/app.js").ends_with(content("app.js")));
  EXPECT_TRUE(ask("GET /api/cameras").ends_with("[\"" + streams_[0]->name() + "\",\"" + streams_[1]->name() + "\"]"));
  for (const auto& stream : streams_) {
    expect_parts(ask("GET /camera/" + stream->name() + "/api/status"), {"\"name\":\"" + stream->name() + "\""});
  }
  EXPECT_EQ(status("POST " + first + "/api/nuc", "Origin: http://localhost\r\n"), 202);
  for (const char* path :
       {"/api/status", "/api/frame?epoch=0&after=0", "/camera/", "/camera/none/", "/camera//api/status"}) {
    EXPECT_EQ(status(std::string("GET ") + path), 404) << path;
  }
  EXPECT_EQ(status("GET " + first), 404);  // links on the page need the trailing slash
}

TEST_F(ViewServer, RefusesOtherMethods) {
  serve();
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "HEAD", "PATCH", "TRACE", "BREW"}) {
    EXPECT_EQ(status(std::string(method) + " /", "Origin: http://localhost\r\n"), 405) << method;
  }
  EXPECT_EQ(status("GET /api/nuc"), 405);
  EXPECT_EQ(nucs_, 0);
}

TEST_F(ViewServer, RefusesNamesThatAreNotThisComputer) {
  serve();
  for (const char* host : {"localhost", "localhost:8640", "LOCALHOST", "127.0.0.1:1", "127.9.9.9", "[::1]:8640"}) {
    EXPECT_EQ(status("GET /", "", host), 200) << host;
  }
  for (const char* host : {"example.com", "localhost.example.com", "127.0.0.1.example.com", "192.168.1.5", "[::2]", "",
                           "[", "localhost@example.com", "0.0.0.0"}) {
    EXPECT_EQ(status("GET /", "", host), 403) << host;
    EXPECT_EQ(status("GET /api/status", "", host), 403) << host;
  }
}

TEST(ViewAccess, BeyondLoopbackAddressesAndTheHostNameAreThisComputer) {
  const Access access{.token = kToken, .beyond_loopback = true, .host_name = "truck", .port = 8640};
  for (const char* host : {"192.168.1.5:8640", "[fe80::1]", "truck:8640", "Truck.local", "localhost"}) {
    EXPECT_TRUE(is_this_computer(access, host)) << host;
  }
  for (const char* host : {"example.com", "truck.example.com", "local", ""}) {
    EXPECT_FALSE(is_this_computer(access, host)) << host;
  }
}

TEST_F(ViewServer, EachRequestNeedsTheToken) {
  serve();
  const std::string good = kToken;
  for (const std::string path : {"/", "/app.js", "/api/status", "/api/frame?epoch=0&after=0"}) {
    EXPECT_EQ(status_without_cookie("GET " + path), 401) << path;
    EXPECT_EQ(status_without_cookie("GET " + path, cookie("wrong")), 401) << path;
    EXPECT_EQ(status_without_cookie("GET " + path, cookie(good + "0")), 401) << path;
  }
  EXPECT_EQ(status_without_cookie("GET /?token="), 401);
  EXPECT_EQ(status_without_cookie("GET /?token=0123456789abcdef-_XZ"), 401);
  expect_parts(ask_bare("GET /?token=" + good, "", "localhost"),
               {"Set-" + cookie().substr(0, cookie().size() - 2) + "; Path=/; HttpOnly; SameSite=Strict"});
  EXPECT_EQ(status_without_cookie("GET /api/status", "Cookie: other=1; " + cookie().substr(8)), 200);
  EXPECT_EQ(status_without_cookie("POST /api/nuc", "Origin: http://localhost\r\n"), 401);
}

TEST_F(ViewServer, OtherSitesGetNothing) {
  serve();
  for (const char* site : {"cross-site", "same-site"}) {
    const std::string header = std::string("Sec-Fetch-Site: ") + site + "\r\n";
    EXPECT_EQ(status("GET /api/status", header), 403) << site;
    EXPECT_EQ(status("GET /app.js", header), 403) << site;
    EXPECT_EQ(status("GET /", header), 200) << site;  // a link to the page from elsewhere
  }
  EXPECT_EQ(status("GET /api/status", "Sec-Fetch-Site: same-origin\r\n"), 200);
}

TEST_F(ViewServer, ANucNeedsThePagesOwnOrigin) {
  serve();
  for (const char* origin : {"", "Origin: null\r\n", "Origin: http://example.com\r\n", "Origin: http://localhost:1\r\n",
                             "Origin: https://localhost\r\n"}) {
    EXPECT_EQ(status("POST /api/nuc", origin), 403) << origin;
  }
  EXPECT_EQ(nucs_, 0);
  hold_nuc_ = true;
  EXPECT_EQ(status("POST /api/nuc", "Origin: http://localhost\r\n"), 202);
  EXPECT_EQ(status("POST /api/nuc", "Origin: http://localhost\r\n"), 409) << "one at a time";
  expect_parts(ask("GET /api/status"), {"\"nuc_asking\":true"});
  hold_nuc_ = false;
  std::string answer;
  do {
    answer = ask("GET /api/status");
  } while (answer.find("\"nuc_asking\":true") != std::string::npos);
  expect_parts(answer, {"the camera does not answer"});
  EXPECT_EQ(nucs_, 1);
}

TEST_F(ViewServer, ANucWithoutAThreadIsToldOf) {
  serve();
  {
    const NoThreads none;
    EXPECT_EQ(status("POST /api/nuc", "Origin: http://localhost\r\n"), 202);
  }
  expect_parts(ask("GET /api/status"), {"\"nuc_asking\":false", "no thread can be started"});
  EXPECT_EQ(nucs_, 0);
  EXPECT_EQ(status("POST /api/nuc", "Origin: http://localhost\r\n"), 202) << "the next one is made";
}

TEST_F(ViewServer, RefusesBodiesAndNonsense) {
  serve();
  EXPECT_EQ(status("POST /api/nuc", "Origin: http://localhost\r\nContent-Length: 5\r\n"), 413);
  EXPECT_EQ(status("POST /api/nuc", "Origin: http://localhost\r\nTransfer-Encoding: chunked\r\n"), 413);
  EXPECT_EQ(status("GET /", "Content-Length: 99999999999\r\n"), 413);
  EXPECT_EQ(nucs_, 0);
  for (const char* query : {"", "?epoch=1", "?epoch=1&after=x", "?epoch=-1&after=0", "?epoch=1&after=1e3",
                            "?epoch=&after=", "?epoch=1&after=99999999999999999999999"}) {
    EXPECT_EQ(status(std::string("GET /api/frame") + query), 400) << query;
    EXPECT_EQ(status(std::string("GET /api/trace") + query), 400) << query;
  }
  EXPECT_EQ(status("GET /api/trace?x=0&y=0&epoch=0&after=0"), 404) << "no stream";
  EXPECT_NE(status("GET /" + std::string(40000, 'a')), 200);
  EXPECT_EQ(status("GET /api/frame?epoch=0&after=0"), 204) << "a frame that does not come";
  const UniqueFd fd = connected(server_->port());
  send_text(fd, "GET / HTTP/1.1\r\n\r\n");  // no Host header
  EXPECT_TRUE(receive_all(fd).starts_with("HTTP/1.1 400"));
}

TEST_F(ViewServer, RequestsThatWaitAreBounded) {
  serve({.connections = 20, .waiting = 3});
  std::vector<UniqueFd> asked;
  for (int i = 0; i < 5; ++i) {
    asked.push_back(connected(server_->port()));
    send_text(asked.back(), request_for("/api/frame?epoch=0&after=0"));
  }
  int refused = 0;
  int without_frame = 0;
  for (const UniqueFd& fd : asked) {
    const std::string answer = receive_all(fd);
    refused += answer.starts_with("HTTP/1.1 503") ? 1 : 0;
    without_frame += answer.starts_with("HTTP/1.1 204") ? 1 : 0;
  }
  EXPECT_GE(refused, 1);
  EXPECT_GE(without_frame, 3);
  EXPECT_EQ(refused + without_frame, 5);
}

TEST_F(ViewServer, ConnectionsAreBoundedAndComeFree) {
  serve({.connections = 4});
  std::vector<UniqueFd> idle;
  for (int i = 0; i < 12; ++i) idle.push_back(connected(server_->port()));
  for (const UniqueFd& fd : idle) {
    const std::string request = "GET /icon.svg HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    send(fd.get(), request.data(), request.size(), MSG_NOSIGNAL);  // requests beyond the limit are closed or wait
  }
  idle.clear();
  int served = 0;
  for (int attempt = 0; attempt < 500 && served != 200; ++attempt) served = status("GET /icon.svg");
  EXPECT_EQ(served, 200);
}

// Strangers that occupy all connections with unfinished requests keep them only until another client comes.
TEST_F(ViewServer, WhoIsSilentMakesRoom) {
  serve({.connections = 4});
  std::vector<UniqueFd> silent;
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 24; ++i) {
      silent.push_back(connected(server_->port()));
      const std::string_view begun = "GET / HTTP/1.1\r\nHost: ";
      send(silent.back().get(), begun.data(), begun.size(), MSG_NOSIGNAL);
    }
    expect_room();
  }
}

// So does an authorised browser that stops reading (a laptop that fell asleep).
TEST_F(ViewServer, WhoTakesNoAnswerMakesRoom) {
  serve({.connections = 4});
  const std::string request = "GET /app.js HTTP/1.1\r\nHost: localhost\r\n" + cookie() + "\r\n";
  std::vector<UniqueFd> asleep;
  for (int i = 0; i < 4; ++i) {
    asleep.push_back(connected(server_->port()));
    pollfd takes{asleep.back().get(), POLLOUT, 0};
    while (poll(&takes, 1, 200) == 1) {
      ASSERT_GE(send(takes.fd, request.data(), request.size(), MSG_NOSIGNAL | MSG_DONTWAIT), 0) << i;
    }
  }
  expect_room();
}

TEST(ViewListen, SaysWhyAnAddressCannotBeListenedOn) {
  const auto first = must(HttpServer::listen({"127.0.0.1"}, 0, {}, {}));
  expect_refused(HttpServer::listen({"127.0.0.1", "::1"}, (*first)->port(), {}, {}), {"another program does"});
  for (const char* address : {"localhost", "", "192.0.2.1", "1.2.3"}) {
    SCOPED_TRACE(address);
    expect_refused(HttpServer::listen({address}, 0, {}, {}), {});
  }
  EXPECT_TRUE(HttpServer::listen({"192.0.2.1", "127.0.0.1"}, 0, {}, {})) << "an address that is not there is left out";
  for (const char* address : {"127.0.0.1", "0.0.0.0", "::1", "192.0.2.1"}) EXPECT_TRUE(ip_address(address)) << address;
  for (const char* word : {"banana", "", "127.0.0.1:8640", "[::1]:8640", "1.2.3"}) {
    EXPECT_FALSE(ip_address(word)) << word;
  }
}

TEST(ViewListen, SaysThatNoFileDescriptorsAreLeft) {
  const auto with_descriptors = [](rlim_t left) {
    const int next = dup(STDIN_FILENO);
    close(next);
    const rlimit limit{static_cast<rlim_t>(next) + left, static_cast<rlim_t>(next) + left};
    setrlimit(RLIMIT_NOFILE, &limit);
    const auto server = HttpServer::listen({"127.0.0.1"}, 0, {}, {});
    return server || server.error().message.find("Too many open files") != std::string::npos ? 0 : 1;
  };
  for (rlim_t left = 0; left < 7; ++left) EXPECT_EQ(in_child([&] { return with_descriptors(left); }), 0) << left;
}

// An empty token admits nobody.
TEST_F(ViewServer, AnEmptyTokenOpensNothing) {
  serve(1, {}, "");
  for (const char* request : {"GET /", "GET /?token=", "GET /?token"}) {
    EXPECT_EQ(status_without_cookie(request), 401) << request;
    EXPECT_EQ(status_without_cookie(request, cookie("")), 401) << request;
  }
}

TEST(ViewToken, IsLongEnoughAndOnlyItsOwnersToRead) {
  const auto one = random_token();
  const auto other = random_token();
  ASSERT_TRUE(one && other);
  EXPECT_TRUE(check_token(*one));
  EXPECT_EQ(one->size(), 32U);
  EXPECT_NE(*one, *other);
  EXPECT_TRUE(check_token(kToken));
  for (const std::string& bad :
       {std::string(), std::string("short"), std::string("0123456789abcde"), std::string("0123456789abcdef;"),
        std::string("0123456789 abcdef"), std::string(129, 'a')}) {
    EXPECT_FALSE(check_token(bad)) << bad;
  }
  const Scratch scratch;
  const std::string file = scratch / "token";
  EXPECT_FALSE(read_token(file)) << "no such file";
  std::ofstream(file) << kToken << "\n";
  chmod(file.c_str(), 0644);
  EXPECT_FALSE(read_token(file)) << "others may read it";
  chmod(file.c_str(), 0600);
  EXPECT_EQ(read_token(file).value_or(""), kToken);
}

}  // namespace bolo::view::view_server_test
