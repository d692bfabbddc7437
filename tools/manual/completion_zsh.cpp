// zsh: one function a command, in the words of _arguments.
#include <algorithm>
#include <cctype>

#include "tools/manual/completion.hpp"

namespace bolo::tools {
namespace {

// Within single quotes, and within the brackets and colons of _arguments.
std::string quoted(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\'') {
      out += "'\\''";
    } else if (c == '\n') {
      out += ' ';
    } else {
      if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
      out += c;
    }
  }
  return out;
}

std::string action(const Candidates& candidates) {
  switch (candidates.kind) {
    case Candidates::Kind::kFiles:
      return "_files";
    case Candidates::Kind::kFolders:
      return "_files -/";
    case Candidates::Kind::kDaemons:
      return "_bolo_daemons";
    case Candidates::Kind::kWords: {
      std::string words = "(";
      for (const std::string& word : candidates.words) words += (words.size() == 1 ? "" : " ") + word;
      return words + ")";
    }
    case Candidates::Kind::kNothing:
      break;
  }
  return " ";
}

std::string argument(const CommandOption& option) {
  const std::string value = option.value.empty() ? "" : ":" + quoted(option.value) + ":" + action(values_of(option));
  const std::string text = "[" + quoted(option.text) + "]" + value;
  const std::string spec = option.letter.empty() ? "'*--" + option.name + text + "'"
                                                 : "'*'{-" + option.letter + ",--" + option.name + "}'" + text + "'";
  return " \\\n    " + spec;
}

std::string function_name(const Command& command) {
  std::string name = "_" + command.page();
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

std::string dispatcher(const std::string& function, const std::string& name, std::span<const Command> parts) {
  std::string text = function + "() {\n  local -a words_of=(\n";
  for (const Command& part : parts) {
    text += "    '" + part.name.substr(name.size() + 1) + ":" + quoted(part.summary) + "'\n";
  }
  text += "  )\n  if (( CURRENT == 2 )); then\n    _describe 'verb' words_of\n    return\n  fi\n  case $words[2] in\n";
  for (const Command& part : parts) {
    text +=
        "    " + part.name.substr(name.size() + 1) + ") shift words; (( CURRENT-- )); " + function_name(part) + " ;;\n";
  }
  return text + "  esac\n}\n\n";
}

std::string leaf(const Command& command) {
  std::string text = function_name(command) + "() {\n  _arguments -s";
  for (const CommandOption& option : command.options()) text += argument(option);
  if (!command.operands.empty()) {
    text += " \\\n    '*:" + quoted(command.operands) + ":" + action(operands_of(command)) + "'";
  }
  return text + "\n}\n\n";
}

}  // namespace

std::string zsh_completion(std::span<const Command> verbs, const Command& daemon) {
  std::string text = "#compdef bolo bolod\n# Made from the programs' own options.\n\n";
  text += "_bolo_daemons() { local -a names=(/dev/shm/bolo.*(N)); compadd -- ${names#/dev/shm/bolo.} }\n\n";
  for (const Command& verb : verbs) {
    for (const Command& part : verb.parts) text += leaf(part);
    text += verb.parts.empty() ? leaf(verb) : dispatcher(function_name(verb), verb.name, verb.parts);
  }
  text += leaf(daemon) + dispatcher("_bolo_verbs", "bolo", verbs);
  return text + "case $service in\n  bolod) " + function_name(daemon) +
         " \"$@\" ;;\n  *) _bolo_verbs \"$@\" ;;\nesac\n";
}

}  // namespace bolo::tools
