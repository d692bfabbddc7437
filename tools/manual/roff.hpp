// Text in roff: what would be a request or an escape there is neither.
#pragma once

#include <string>

#include "tools/manual/man_page.hpp"

namespace bolo::tools {

// Thread: any.
std::string roff(const std::string& text);

// The same in bold and in italics. Thread: any.
std::string bold(const std::string& text);
std::string italic(const std::string& text);

// Paragraphs: those whose lines are indented stay as they are. Thread: any.
std::string roff_paragraphs(const std::string& text);

// .TH and NAME. Thread: any.
std::string page_head(const std::string& page, int chapter, const std::string& summary, const PageOrigin& origin);

// Thread: any.
std::string roff_section(const PageSection& section);

}  // namespace bolo::tools
