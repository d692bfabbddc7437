#include <sstream>
#include <string_view>
#include <vector>

#include "tools/manual/man_page.hpp"
#include "tools/manual/roff.hpp"

namespace bolo::tools {
namespace {

// Lines of the document between two empty ones.
std::vector<std::vector<std::string>> blocks_of(const std::string& document) {
  std::vector<std::vector<std::string>> blocks(1);
  std::istringstream lines(document);
  for (std::string line; std::getline(lines, line);) {
    if (!line.empty()) {
      blocks.back().push_back(line);
    } else if (!blocks.back().empty()) {
      blocks.emplace_back();
    }
  }
  if (blocks.back().empty()) blocks.pop_back();
  return blocks;
}

bool is_comment(const std::string& line) { return line.starts_with("# "); }

// "[name]  # what it is about".
std::string section_entry(const std::string& line) {
  const std::size_t comment = line.find('#');
  const std::string name = line.substr(0, line.find(']') + 1);
  return ".SS " + roff(name) + "\n" + (comment == std::string::npos ? "" : roff(line.substr(comment + 2)) + "\n");
}

// "key = value", or "#key = example" where there is no default, after its comments.
std::string key_entry(const std::vector<std::string>& block) {
  std::string line = block.back();
  if (line.starts_with("#")) line.erase(0, 1);
  std::string entry = ".TP\n" + bold(line.substr(0, line.find(' '))) + "\n";
  for (std::size_t i = 0; i + 1 < block.size(); ++i) {
    if (i > 0) entry += i + 2 == block.size() ? ".br\n" : "";
    entry += roff(block[i].substr(2)) + "\n";
  }
  return entry;
}

}  // namespace

std::string settings_page(const std::string& name, const std::string& summary, const std::string& document,
                          std::span<const PageSection> sections, const PageOrigin& origin) {
  std::string page = page_head(name, 5, summary, origin) + ".SH DESCRIPTION\n";
  bool keys = false;
  for (const auto& block : blocks_of(document)) {
    if (!keys && is_comment(block.back())) {  // the heading
      for (const std::string& line : block) page += roff(line.substr(2)) + "\n";
      continue;
    }
    if (!keys) page += ".SH KEYS\n";
    keys = true;
    page += block.back().starts_with("[") ? section_entry(block.back()) : key_entry(block);
  }
  for (const PageSection& section : sections) page += roff_section(section);
  return page;
}

}  // namespace bolo::tools
