// What a program's command line takes, read from the very options that it parses with: manual pages and completion
// follow.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <cxxopts.hpp>

#include "tools/cli/verb.hpp"

namespace bolo::tools {

struct CommandOption {
  std::string letter;  // without '-'; may be empty
  std::string name;    // without "--"
  std::string value;   // what stands for its value; empty: a switch
  std::string text;
  std::string default_value;         // empty: none
  std::vector<std::string> choices;  // where the text begins with the words that are allowed
};

struct OptionGroup {
  std::string title;  // empty: the general ones
  std::vector<CommandOption> options;
};

struct Command {
  std::string name;  // "bolo deblur"
  std::string summary;
  std::string description;
  std::string operands;  // "IN.h5"; empty: none
  std::vector<OptionGroup> groups;
  std::vector<Command> parts;  // of a verb that dispatches further

  // All groups' options. Thread: any.
  std::vector<CommandOption> options() const;
  // "bolo-deblur", as its manual page is named. Thread: any.
  std::string page() const;
};

// Thread: any.
Command read_command(const cxxopts::Options& options, std::string summary);

// Runs the verb without doing its work; of a verb with parts all of them. `program` stands before the verb's name:
// "bolo", "bolo-lab eval". Thread: setup.
Command read_verb(const Verb& verb, std::span<const Verb> parts, const std::string& program);

}  // namespace bolo::tools
