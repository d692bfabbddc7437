// The result of `bolo-lab eval detect`, as text and as JSON.
#pragma once

#include <nlohmann/json.hpp>

#include "src/report/sheet.hpp"
#include "tools/lab/detect/table.hpp"

namespace bolo::tools::detect {

// The schema is in the verb's --help. Thread: any.
nlohmann::ordered_json to_json(const Options& options, const Table& table);

// To stdout. Thread: one at a time.
void print_text(const Options& options, const Table& table);

// For each motion one look as the columns show it, with the boxes that one detector found; a page has the table, too.
// Thread: any.
plot::Sheet sheet_of(const Table& table, const Found& found, const Options& options);

}  // namespace bolo::tools::detect
