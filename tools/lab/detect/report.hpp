// The result of `bolo-lab eval detect`, as text and as JSON.
#pragma once

#include <nlohmann/json.hpp>

#include "tools/lab/detect/options.hpp"
#include "tools/lab/detect/table.hpp"

namespace bolo::tools::detect {

// The schema is in the verb's --help. Thread: any.
nlohmann::ordered_json to_json(const Options& options, const Table& table);

// To stdout. Thread: one at a time.
void print_text(const Options& options, const Table& table);

}  // namespace bolo::tools::detect
