// fish: one line an option.
#include "tools/manual/completion.hpp"

namespace bolo::tools {
namespace {

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'' || c == '\\') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out + "'";
}

// Arguments of `complete` that offer them; -r: a value is needed, -x: nothing else is one.
std::string offer(const Candidates& candidates) {
  switch (candidates.kind) {
    case Candidates::Kind::kFiles:
      return " -rF";
    case Candidates::Kind::kFolders:
      return " -xa '(__fish_complete_directories)'";
    case Candidates::Kind::kDaemons:
      return " -xa \"(string replace /dev/shm/bolo. '' /dev/shm/bolo.*)\"";
    case Candidates::Kind::kWords: {
      std::string words;
      for (const std::string& word : candidates.words) words += (words.empty() ? "" : " ") + word;
      return " -xa '" + words + "'";
    }
    case Candidates::Kind::kNothing:
      break;
  }
  return " -x";
}

std::string option_line(const std::string& begin, const CommandOption& option) {
  std::string line = begin;
  if (!option.letter.empty()) line += " -s " + option.letter;
  line += " -l " + option.name;
  if (!option.value.empty()) line += offer(values_of(option));
  return line + " -d " + quoted(option.text) + "\n";
}

// `condition`: when the command is the one that is typed.
std::string leaf(const std::string& condition, const Command& command) {
  const std::string begin = "complete -c bolo -n " + quoted(condition);
  std::string text;
  for (const CommandOption& option : command.options()) text += option_line(begin, option);
  const Candidates operands = operands_of(command);
  if (operands.kind == Candidates::Kind::kFiles) {
    text += begin + " -F\n";
  } else if (operands.kind != Candidates::Kind::kNothing) {
    text += begin + offer(operands) + "\n";
  }
  return text;
}

std::string dispatcher(const std::string& condition, const std::string& name, std::span<const Command> parts) {
  std::string text;
  for (const Command& part : parts) {
    text += "complete -c bolo -n " + quoted(condition) + " -a " + part.name.substr(name.size() + 1) + " -d " +
            quoted(part.summary) + "\n";
  }
  return text;
}

std::string is_word(std::size_t place, const std::string& word) {
  return "test (count (commandline -opc)) -gt " + std::to_string(place - 1) + "; and test (commandline -opc)[" +
         std::to_string(place) + "] = " + word;
}

std::string count_is(std::size_t words) { return "test (count (commandline -opc)) -eq " + std::to_string(words); }

}  // namespace

std::string fish_completion(std::span<const Command> verbs) {
  std::string text = "# Made from the programs' own options.\ncomplete -c bolo -f\n";
  text += dispatcher(count_is(1), "bolo", verbs);
  for (const Command& verb : verbs) {
    const std::string condition = is_word(2, verb.name.substr(5));
    if (verb.parts.empty()) text += leaf(condition, verb);
    text += dispatcher(condition + "; and " + count_is(2), verb.name, verb.parts);
    for (const Command& part : verb.parts) {
      text += leaf(condition + "; and " + is_word(3, part.name.substr(verb.name.size() + 1)), part);
    }
  }
  return text;
}

std::string fish_completion(const Command& daemon) {
  std::string text = "# Made from the program's own options.\ncomplete -c bolod -f\n";
  for (const CommandOption& option : daemon.options()) text += option_line("complete -c bolod", option);
  return text;
}

}  // namespace bolo::tools
