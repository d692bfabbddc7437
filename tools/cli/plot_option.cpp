#include "tools/cli/plot_option.hpp"

#include <fstream>
#include <thread>

#include "src/report/sheet.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {

void add_plot_option(cxxopts::Options& options, const std::string& what) {
  options.add_options()("plot", what + ": a drawing (.svg) or a page with figures (.html)",
                        cxxopts::value<std::string>(), "FILE");
  add_overwrite_option(options);
}

Result<OutputFile> plot_file_of(const cxxopts::ParseResult& given) {
  if (given.count("plot") == 0) return OutputFile();
  OutputFile file(given["plot"].as<std::string>(), replace_of(given));
  Status good = plot::check_sheet_file(file.path);
  if (good) good = check_output(file);
  if (!good) return bad_input("--plot " + good.error().message);
  return file;
}

std::string machine_words() {
  std::string name = "unknown processor";
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    const std::size_t colon = line.find(": ");
    if (!line.starts_with("model name") || colon == std::string::npos) continue;
    name = line.substr(colon + 2);
    break;
  }
  return name + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads";
}

}  // namespace bolo::tools
