#include "tools/manual/roff.hpp"

#include <algorithm>
#include <cctype>
#include <sstream>

namespace bolo::tools {
namespace {

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

}  // namespace

std::string roff(const std::string& text) {
  std::string out;
  bool line_begins = true;
  for (const char c : text) {
    if (line_begins && (c == '.' || c == '\'')) out += "\\&";
    line_begins = c == '\n';
    switch (c) {
      case '\\':
        out += "\\e";
        break;
      case '-':
        out += "\\-";
        break;
      case '^':
        out += "\\(ha";
        break;
      case '~':
        out += "\\(ti";
        break;
      case '\'':
        out += "\\(aq";
        break;
      case '`':
        out += "\\(ga";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string bold(const std::string& text) { return "\\fB" + roff(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + roff(text) + "\\fR"; }

std::string roff_paragraphs(const std::string& text) {
  std::istringstream lines(text);
  std::string out;
  std::string line;
  bool as_is = false;
  while (std::getline(lines, line)) {
    const bool indented = line.starts_with("  ");
    if (indented != as_is && !(line.empty() && as_is)) {
      out += indented ? ".PP\n.nf\n" : ".fi\n.PP\n";
      as_is = indented;
    }
    if (line.empty()) {
      if (!as_is) out += ".PP\n";
      continue;
    }
    out += roff(line) + "\n";
  }
  return out + (as_is ? ".fi\n" : "");
}

std::string page_head(const std::string& page, int chapter, const std::string& summary, const PageOrigin& origin) {
  return ".TH " + roff(upper(page)) + " " + std::to_string(chapter) + " " + origin.date + " \"Bolo " + origin.version +
         "\" \"Bolo\"\n.SH NAME\n" + roff(page) + " \\- " + roff(summary) + "\n";
}

std::string roff_section(const PageSection& section) {
  return ".SH " + section.title + "\n" + roff_paragraphs(section.text);
}

}  // namespace bolo::tools
