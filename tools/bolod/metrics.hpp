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

// Serves /metrics; `collect` collects the metrics for a scrape, on the server's thread. An address that another program
// has, or no interface, is a failure. Thread: setup.
using CollectMetrics = std::function<std::vector<prometheus::MetricFamily>()>;
Result<std::unique_ptr<RequestServer>> metrics_server(const MetricsOptions& options, CollectMetrics collect);

}  // namespace bolo::daemon
