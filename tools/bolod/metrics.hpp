// The daemon's numbers as Prometheus knows them; names and units follow its conventions.
#pragma once

#include <string>
#include <vector>

#include <prometheus/metric_family.h>

#include "src/pipeline/pipeline.hpp"
#include "src/rt/counters.hpp"

namespace bolo::daemon {

// Sources of the metrics; they outlive a scrape.
struct MetricsView {
  const std::string& name;
  const pipeline::Pipeline& pipeline;
  const rt::Gauge<bool>& flows;  // as the watchdog is told
};

// Reads counters that are kept anyway: nothing is spent on it between scrapes. Thread: any.
std::vector<prometheus::MetricFamily> collect_metrics(const MetricsView& view);

}  // namespace bolo::daemon
