#include "tools/bolod/metrics_server.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <charconv>
#include <exception>
#include <optional>
#include <string>
#include <utility>

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>

namespace bolo::daemon {
namespace {

struct Listen {
  std::string host;
  int port = 0;
};

// "127.0.0.1:9464", "[::1]:9464"
std::optional<Listen> parse(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) return std::nullopt;
  Listen listen{text.substr(0, colon)};
  const char* const end = text.data() + text.size();
  const auto [read, error] = std::from_chars(text.data() + colon + 1, end, listen.port);
  constexpr int kMostPorts = 65535;
  if (error != std::errc() || read != end || listen.port < 1 || listen.port > kMostPorts) return std::nullopt;
  return listen;
}

struct Address {
  bool valid = false;
  bool loopback = false;
};

Address classify(const std::string& host) {
  constexpr std::uint32_t kLoopbackNet = 127;
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return {true, ntohl(v4.s_addr) >> 24 == kLoopbackNet};
  if (host.size() < 2 || host.front() != '[' || host.back() != ']') return {};
  in6_addr v6{};
  if (inet_pton(AF_INET6, host.substr(1, host.size() - 2).c_str(), &v6) != 1) return {};
  return {true, IN6_IS_ADDR_LOOPBACK(&v6) != 0};
}

class Collector final : public prometheus::Collectable {
 public:
  explicit Collector(MetricsServer::Collect collect) : collect_(std::move(collect)) {}
  std::vector<prometheus::MetricFamily> Collect() const override { return collect_(); }

 private:
  MetricsServer::Collect collect_;
};

}  // namespace

struct MetricsServer::Impl {
  std::shared_ptr<Collector> collector;
  std::unique_ptr<prometheus::Exposer> exposer;
};

Status check_listen(const MetricsOptions& options) {
  const auto listen = parse(options.listen);
  const Address address = listen ? classify(listen->host) : Address{};
  if (!address.valid) {
    return bad_input("metrics.listen = \"" + options.listen + "\" is no ADDRESS:PORT such as 127.0.0.1:9464");
  }
  if (address.loopback || options.allow_remote) return {};
  return bad_input("metrics.listen = \"" + options.listen +
                   "\" is within other computers' reach: use 127.0.0.1, or set metrics.allow_remote = true");
}

Result<std::unique_ptr<MetricsServer>> MetricsServer::start(const MetricsOptions& options, Collect collect) {
  constexpr std::size_t kThreads = 2;
  auto impl = std::make_unique<Impl>();
  impl->collector = std::make_shared<Collector>(std::move(collect));
  try {
    impl->exposer = std::make_unique<prometheus::Exposer>(options.listen, kThreads);
    impl->exposer->RegisterCollectable(impl->collector);
  } catch (const std::exception&) {  // it does not say why
    return bad_input("metrics.listen: cannot listen at " + options.listen +
                     "; another program may: set metrics.listen to a free port");
  }
  return std::unique_ptr<MetricsServer>(new MetricsServer(std::move(impl)));
}

MetricsServer::MetricsServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MetricsServer::~MetricsServer() = default;

}  // namespace bolo::daemon
