#include "tools/manual/command.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <regex>
#include <sstream>
#include <string_view>
#include <utility>

#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \n");
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \n") - first + 1);
}

// Operands are declared as options too; --help doesn't list them.
bool listed(const std::string& help, const std::string& name) {
  return std::regex_search(help, std::regex("(^|\n) +(-[A-Za-z0-9], )?--" + name + "[ \n]"));
}

// "admm, dual (fast) or exact: ..." allows admm, dual and exact.
std::vector<std::string> choices_of(const std::string& text) {
  std::string list = text.substr(0, text.find_first_of(".:;"));
  list = std::regex_replace(list, std::regex(" *\\([^)]*\\)"), "");
  if (list.find(" or ") == std::string::npos) return {};
  list = std::regex_replace(list, std::regex(",? or "), ", ");
  std::vector<std::string> words;
  const std::regex separator(", ");
  std::copy(std::sregex_token_iterator(list.begin(), list.end(), separator, -1), std::sregex_token_iterator(),
            std::back_inserter(words));
  const std::regex word("[a-z][a-z0-9_]*");
  const bool all = std::all_of(words.begin(), words.end(), [&](const auto& w) { return std::regex_match(w, word); });
  return all ? words : std::vector<std::string>{};
}

CommandOption read_option(const cxxopts::HelpOptionDetails& details) {
  CommandOption option{details.s, details.l.front(), "", trimmed(details.desc), "", {}};
  if (details.is_boolean) return option;
  option.value = details.arg_help.empty() ? "arg" : details.arg_help;
  if (details.has_default) option.default_value = details.default_value;
  option.choices = choices_of(option.text);
  return option;
}

}  // namespace

std::vector<CommandOption> Command::options() const {
  std::vector<CommandOption> all;
  for (const OptionGroup& group : groups) all.insert(all.end(), group.options.begin(), group.options.end());
  return all;
}

std::string Command::page() const {
  std::string page = name;
  std::replace(page.begin(), page.end(), ' ', '-');
  return page;
}

Command read_command(const cxxopts::Options& options, std::string summary) {
  constexpr std::string_view kUsage = "Usage:\n";
  constexpr std::string_view kOptions = "[OPTION...]";
  const std::string help = options.help();
  Command command{options.program(), std::move(summary), "", "", {}, {}};
  const std::size_t usage = help.find(kUsage);
  command.description = trimmed(help.substr(0, usage));
  std::istringstream rest(help.substr(usage + kUsage.size()));
  std::string line;
  std::getline(rest, line);
  command.operands = trimmed(line.substr(line.find(kOptions) + kOptions.size()));
  for (const std::string& name : options.groups()) {
    OptionGroup group{name, {}};
    for (const auto& details : options.group_help(name).options) {
      if (listed(help, details.l.front())) group.options.push_back(read_option(details));
    }
    if (!group.options.empty()) command.groups.push_back(std::move(group));
  }
  return command;
}

Command read_verb(const Verb& verb, std::span<const Verb> parts, const std::string& program) {
  Command command{program + " " + std::string(verb.name), std::string(verb.summary), "", "", {}, {}};
  if (!parts.empty()) {
    for (const Verb& part : parts) command.parts.push_back(read_verb(part, {}, command.name));
    return command;
  }
  read_options_with([&](const cxxopts::Options& options) { command = read_command(options, command.summary); });
  std::string name(verb.name);
  std::array<char*, 2> argv{name.data(), nullptr};
  verb.run(1, argv.data());
  read_options_with({});
  return command;
}

}  // namespace bolo::tools
