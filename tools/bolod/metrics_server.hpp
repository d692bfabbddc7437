// Answers Prometheus' scrapes over HTTP.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include <prometheus/metric_family.h>

#include "src/core/result.hpp"
#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// An address and port; of another computer's reach only where that is allowed. Thread: any.
Status check_listen(const MetricsOptions& options);

// Serves /metrics on threads of its own, which touch nothing that frames pass.
class MetricsServer {
 public:
  // What a scrape gets. Thread: the server's.
  using Collect = std::function<std::vector<prometheus::MetricFamily>()>;

  // An address that cannot be had is bad input. Thread: setup.
  static Result<std::unique_ptr<MetricsServer>> start(const MetricsOptions& options, Collect collect);
  ~MetricsServer();
  MetricsServer(const MetricsServer&) = delete;
  MetricsServer& operator=(const MetricsServer&) = delete;

 private:
  struct Impl;
  explicit MetricsServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::daemon
