// --plot FILE.svg|FILE.html of the verbs that run long: what they measured, drawn.
#pragma once

#include <filesystem>
#include <string>

#include <cxxopts.hpp>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"

namespace bolo::tools {

// With --overwrite. `what`: as in "Draw the table". Thread: setup.
void add_plot_option(cxxopts::Options& options, const std::string& what);

// The file that was asked for, or none. kBadInput when it ends neither with .svg nor with .html, or may not be written.
// Thread: any.
Result<OutputFile> plot_file_of(const cxxopts::ParseResult& given);

// Processor and its number of threads, for what depends on the machine. Thread: any.
std::string machine_words();

}  // namespace bolo::tools
