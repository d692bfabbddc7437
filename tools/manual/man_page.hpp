// Manual pages in roff's man macros.
#pragma once

#include <span>
#include <string>

#include "tools/manual/command.hpp"

namespace bolo::tools {

// What stands at the top and the bottom of every page.
struct PageOrigin {
  std::string version;
  std::string date;  // YYYY-MM-DD
};

// A section with a title of capitals; the text's paragraphs are parted by empty lines, indented lines stay as they are.
struct PageSection {
  std::string title;
  std::string text;
};

// bolo(1): the verbs. Thread: any.
std::string overview_page(std::span<const Command> verbs, const PageOrigin& origin);

// The page of one command, with `sections` behind its options. Thread: any.
std::string command_page(const Command& command, int chapter, std::span<const PageSection> sections,
                         const PageOrigin& origin);

// A page of section 5 from a settings file whose every key is commented: a comment's lines, the last of them with type
// and default, stand before each key. Thread: any.
std::string settings_page(const std::string& name, const std::string& summary, const std::string& document,
                          std::span<const PageSection> sections, const PageOrigin& origin);

// Sections of all pages of `bolo`. Thread: any.
PageSection exit_status();

}  // namespace bolo::tools
