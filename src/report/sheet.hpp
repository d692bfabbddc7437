// A verb's plots and tables in one file: `--plot FILE.svg` or `--plot FILE.html`.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/report/plot.hpp"

namespace bolo::plot {

// Cells that begin with a digit, or with a sign and a digit, stand to the right, with their column's head.
struct Table {
  std::vector<std::string> head{};
  std::vector<std::vector<std::string>> rows{};
  std::string caption{};
};

struct Sheet {
  std::string title{};          // what was measured
  Rows rows{};                  // of plots, from the top down
  std::vector<Table> tables{};  // on a page only
  std::string how{};            // how it was measured: machine, seed, command; on a page only
};

// kBadInput unless the name ends with .svg or .html: for verbs that run long, to be asked first. Thread: any.
Status check_sheet_file(const std::filesystem::path& file);

// Errors: as of write_file(). Thread: any.
Status save(const Sheet& sheet, const OutputFile& file);

}  // namespace bolo::plot
