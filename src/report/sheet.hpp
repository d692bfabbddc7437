// What a verb has to show, in one file: `--plot FILE.svg` or `--plot FILE.html`.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "src/report/page.hpp"
#include "src/report/plot.hpp"

namespace bolo::plot {

struct Sheet {
  std::string title{};          // what was measured
  Rows rows{};                  // of plots, from the top down
  std::vector<Table> tables{};  // on a page only
  std::string how{};            // how it was measured: machine, seed, command; on a page only
};

// kBadInput unless the name ends with .svg or .html: for verbs that run long, to be asked first. Thread: any.
Status check_sheet_file(const std::filesystem::path& file);

// kBadInput when it cannot be written. Thread: any.
Status save(const Sheet& sheet, const std::filesystem::path& file);

// For pages and drawings that are made otherwise. kBadInput when it cannot be written. Thread: any.
Status write_text(const std::filesystem::path& file, const std::string& text);

}  // namespace bolo::plot
