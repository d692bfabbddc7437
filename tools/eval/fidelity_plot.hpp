// The pictures of `bolo eval fidelity`.
#pragma once

#include <filesystem>

#include "bolo/core/result.hpp"
#include "tools/eval/fidelity_report.hpp"

namespace bolo::tools::fidelity {

// Writes fidelity_SCENE.png for each scene: RMSE relative to blurred, a bar a column, a group a motion and noise, a
// panel a look-ahead; and fidelity_latency.png: RMSE over look-ahead. Thread: setup.
Status draw(const std::filesystem::path& folder, const Table& table);

}  // namespace bolo::tools::fidelity
