// Answers Prometheus' scrapes over HTTP.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include <prometheus/metric_family.h>

#include "src/core/result.hpp"
#include "tools/bolod/config.hpp"
#include "tools/bolod/request_server.hpp"

namespace bolo::daemon {

// An address and port; of another computer's reach only where that is allowed. Thread: any.
Status check_listen(const MetricsOptions& options);

// Serves /metrics as RequestServer does.
class MetricsServer {
 public:
  // Collects the metrics for a scrape. Thread: the server's.
  using Collect = std::function<std::vector<prometheus::MetricFamily>()>;

  // An address that another program has, or no interface, is a failure. Thread: setup.
  static Result<std::unique_ptr<MetricsServer>> start(const MetricsOptions& options, Collect collect);

 private:
  MetricsServer(UniqueFd listener, Collect collect);

  RequestServer server_;
};

}  // namespace bolo::daemon
