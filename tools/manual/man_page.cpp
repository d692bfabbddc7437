#include "tools/manual/man_page.hpp"

#include "tools/manual/roff.hpp"

namespace bolo::tools {
namespace {

std::string synopsis(const Command& command) {
  if (!command.parts.empty()) return bold(command.name) + " " + italic("WHAT") + " [" + italic("OPTION") + "...]\n";
  std::string line = bold(command.name) + " [" + italic("OPTION") + "...]";
  if (!command.operands.empty()) line += " " + italic(command.operands);
  return line + "\n";
}

// "--help" tells defaults as "(default: x)" too; where the text has it already it is not told twice.
std::string option_entry(const CommandOption& option) {
  std::string entry = ".TP\n";
  if (!option.letter.empty()) entry += bold("-" + option.letter) + ", ";
  entry += bold("--" + option.name);
  if (!option.value.empty()) entry += " " + italic(option.value);
  entry += "\n" + roff(option.text);
  if (!option.default_value.empty()) entry += " (default: " + roff(option.default_value) + ")";
  return entry + "\n";
}

std::string options_of(const Command& command) {
  std::string text;
  for (const OptionGroup& group : command.groups) {
    if (!group.title.empty()) text += ".SS " + roff(group.title) + "\n";
    for (const CommandOption& option : group.options) text += option_entry(option);
  }
  return text;
}

std::string part_entry(const Command& part) {
  return ".SH " + roff(part.page()) + "\n" + synopsis(part) + ".PP\n" + roff_paragraphs(part.description) +
         options_of(part);
}

}  // namespace

PageSection exit_status() {
  return {"EXIT STATUS",
          "0: done. 1: failed while running. 2: wrong usage, configuration or input, with one line on standard error "
          "that says what, where and what to do."};
}

std::string overview_page(std::span<const Command> verbs, const PageOrigin& origin) {
  std::string page = page_head("bolo", 1, "sharp frames from moving thermal cameras", origin);
  page += ".SH SYNOPSIS\n" + bold("bolo") + " " + italic("VERB") + " [" + italic("OPTION") + "...]\n.br\n" +
          bold("bolo --help") + "\n.br\n" + bold("bolo --version") + "\n";
  page += roff_section(
      {"DESCRIPTION",
       "Undoes the thermal inertia of the pixels of an uncooled microbolometer camera: simulates, records, replays, "
       "calibrates and diagnoses, and asks the running daemon, bolod(8). Each verb has a page of its own."});
  page += ".SH VERBS\n";
  for (const Command& verb : verbs) {
    page += ".TP\n.BR " + roff(verb.page()) + " (1)\n" + roff(verb.summary) + "\n";
  }
  return page + roff_section(exit_status()) + roff_section({"SEE ALSO", "bolod(8), bolod.toml(5), bolo-profile(5)"});
}

std::string command_page(const Command& command, int chapter, std::span<const PageSection> sections,
                         const PageOrigin& origin) {
  std::string page = page_head(command.page(), chapter, command.summary, origin);
  page += ".SH SYNOPSIS\n" + synopsis(command);
  if (command.parts.empty()) {
    page += ".SH DESCRIPTION\n" + roff_paragraphs(command.description) + ".SH OPTIONS\n" + options_of(command);
  } else {
    page += ".SH DESCRIPTION\n";
    for (const Command& part : command.parts) {
      const std::string word = part.name.substr(command.name.size() + 1);
      page += ".TP\n" + bold(word) + "\n" + roff(part.summary) + "\n";
    }
    for (const Command& part : command.parts) page += part_entry(part);
  }
  for (const PageSection& section : sections) page += roff_section(section);
  return page;
}

}  // namespace bolo::tools
