// The daemon's numbers as Prometheus knows them; names and units follow its conventions.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <prometheus/metric_family.h>

#include "src/core/result.hpp"
#include "src/pipeline/pipeline.hpp"
#include "src/rt/counters.hpp"
#include "tools/bolod/config.hpp"
#include "tools/bolod/request_server.hpp"

namespace bolo::daemon {

// Sources of the metrics; they outlive a scrape.
struct MetricsView {
  const std::string& name;
  const pipeline::Pipeline& pipeline;
  const rt::Gauge<bool>& flows;  // as given to the watchdog
};

// Reads counters that are kept anyway: nothing is spent on it between scrapes. Thread: any.
std::vector<prometheus::MetricFamily> collect_metrics(const MetricsView& view);

// --- Answers Prometheus' scrapes over HTTP.

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
