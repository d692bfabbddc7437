#include "tools/manual/completion.hpp"

#include <algorithm>
#include <cctype>
#include <regex>

namespace bolo::tools {
namespace {

bool is_file(const std::string& value) {
  return value.find("FILE") != std::string::npos || value.find("CAPTURE") != std::string::npos ||
         value.find("IMAGE") != std::string::npos || value.starts_with("IN") || value.starts_with("OUT") ||
         std::regex_search(value, std::regex("\\.[a-z0-9]+"));
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text;
}

std::string options_of(const Command& command) {
  std::vector<std::string> words;
  for (const CommandOption& option : command.options()) words.push_back("--" + option.name);
  return joined(words);
}

// What the shell function _bolo_offer does with them.
std::string offer(const Candidates& candidates) {
  switch (candidates.kind) {
    case Candidates::Kind::kFiles:
      return "_bolo_files";
    case Candidates::Kind::kFolders:
      return "_bolo_folders";
    case Candidates::Kind::kDaemons:
      return "_bolo_words \"$(_bolo_daemons)\"";
    case Candidates::Kind::kWords:
      return "_bolo_words '" + joined(candidates.words) + "'";
    case Candidates::Kind::kNothing:
      break;
  }
  return ":";
}

// Branches of `case "COMMAND --option"`: what each option's value may be. Switches have none.
std::string value_branches(const Command& command) {
  std::string text;
  for (const CommandOption& option : command.options()) {
    if (option.value.empty()) continue;
    std::string pattern = "'" + command.name + " --" + option.name + "'";
    if (!option.letter.empty()) pattern += " | '" + command.name + " -" + option.letter + "'";
    text += "    " + pattern + ") " + offer(values_of(option)) + " ;;\n";
  }
  return text;
}

std::string word_branches(const Command& command) {
  std::string text = "    '" + command.name + "')\n      case $cur in\n        -*) _bolo_words '" + options_of(command);
  text += "' ;;\n        *) " + offer(operands_of(command)) + " ;;\n      esac\n      ;;\n";
  return text;
}

// Every command that takes options: verbs, parts of verbs, the daemon.
std::vector<Command> leaves(std::span<const Command> verbs, const Command& daemon) {
  std::vector<Command> all;
  for (const Command& verb : verbs) {
    if (verb.parts.empty()) all.push_back(verb);
    all.insert(all.end(), verb.parts.begin(), verb.parts.end());
  }
  all.push_back(daemon);
  return all;
}

std::string dispatcher_branch(const std::string& name, std::span<const Command> parts) {
  std::vector<std::string> words;
  for (const Command& part : parts) words.push_back(part.name.substr(name.size() + 1));
  return "    '" + name + "') _bolo_words '" + joined(words) + " --help' ;;\n";
}

constexpr std::string_view kBashHead = R"(# Completion of bolo and bolod for bash; made from the programs' own options.

_bolo_daemons() { ( @daemons@ ); }
_bolo_words() { mapfile -t COMPREPLY < <(compgen -W "$1" -- "$cur"); }
_bolo_files() {
  compopt -o filenames 2>/dev/null
  mapfile -t COMPREPLY < <(compgen -f -- "$cur")
}
_bolo_folders() {
  compopt -o filenames 2>/dev/null
  mapfile -t COMPREPLY < <(compgen -d -- "$cur")
}

_bolo() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]}
  # bash takes "--option=value" for three words.
  if [ "$cur" = = ]; then
    cur=
  elif [ "$prev" = = ]; then
    prev=${COMP_WORDS[COMP_CWORD - 2]}
  fi
  local command=${COMP_WORDS[0]##*/} word=1
  COMPREPLY=()
  # The verb, and of a verb that has parts the part.
  while [ "$word" -lt "$COMP_CWORD" ]; do
    case "$command" in
      @dispatchers@) command="$command ${COMP_WORDS[word]}" ;;
      *) break ;;
    esac
    word=$((word + 1))
  done
  case "$command $prev" in
)";

}  // namespace

Candidates values_of(const CommandOption& option) {
  if (!option.choices.empty()) return {Candidates::Kind::kWords, option.choices};
  if (option.value.find("DIR") != std::string::npos) return {Candidates::Kind::kFolders, {}};
  if (is_file(option.value)) return {Candidates::Kind::kFiles, {}};
  return {};
}

Candidates operands_of(const Command& command) {
  const std::string& operands = command.operands;
  if (operands.empty()) return {};
  if (operands == "NAME") return {Candidates::Kind::kDaemons, {}};
  if (std::regex_match(operands, std::regex("[a-z|]+"))) {
    std::string words = operands;
    std::replace(words.begin(), words.end(), '|', ' ');
    return {Candidates::Kind::kWords, {words}};
  }
  return {Candidates::Kind::kFiles, {}};
}

std::string bash_completion(std::span<const Command> verbs, const Command& daemon) {
  std::string dispatchers = "bolo";
  std::string branches = dispatcher_branch("bolo", verbs);
  for (const Command& verb : verbs) {
    if (verb.parts.empty()) continue;
    dispatchers += " | '" + verb.name + "'";
    branches += dispatcher_branch(verb.name, verb.parts);
  }
  std::string text = std::regex_replace(std::string(kBashHead), std::regex("@dispatchers@"), dispatchers);
  text.replace(text.find("@daemons@"), 9, kListDaemons);
  const std::vector<Command> commands = leaves(verbs, daemon);
  for (const Command& command : commands) text += value_branches(command);
  text += "    *) _bolo_place ;;\n  esac\n}\n\n_bolo_place() {\n  case \"$command\" in\n" + branches;
  for (const Command& command : commands) text += word_branches(command);
  return text + "  esac\n}\n\ncomplete -F _bolo bolo bolod\n";
}

}  // namespace bolo::tools
