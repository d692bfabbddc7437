// The daemon's metrics for Prometheus; names and units follow its conventions.
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
  const rt::Gauge<bool>& flows;  // as reported to the watchdog
};

// Reads existing counters: costs nothing between scrapes. Thread: any.
std::vector<prometheus::MetricFamily> collect_metrics(const MetricsView& view);

// --- Answers Prometheus' scrapes over HTTP.

// Checks for an address and port; reachable from other computers only if allowed. Thread: any.
Status check_listen(const MetricsOptions& options);

// Serves /metrics; `collect` collects the metrics for a scrape, on the server's thread. kFailed: an address in use, or
// of no interface. Thread: setup.
using CollectMetrics = std::function<std::vector<prometheus::MetricFamily>()>;
Result<std::unique_ptr<RequestServer>> metrics_server(const MetricsOptions& options, CollectMetrics collect);

}  // namespace bolo::daemon
