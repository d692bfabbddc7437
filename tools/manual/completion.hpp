// Completion of command lines for bash, zsh and fish: verbs, options, values and operands.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "tools/manual/command.hpp"

namespace bolo::tools {

// What may stand in a place of the command line.
struct Candidates {
  enum class Kind { kNothing, kFiles, kFolders, kDaemons, kWords };
  Kind kind = Kind::kNothing;
  std::vector<std::string> words;  // of kWords
};

// Of an option's value, from its choices and from what stands for it: FILE, IN.h5, DIR ... Thread: any.
Candidates values_of(const CommandOption& option);

// Of the operands: files, a daemon's name (NAME), or the words themselves ("deblur"). Thread: any.
Candidates operands_of(const Command& command);

// `verbs` of bolo, and the daemon. Each returns the whole script. Thread: any.
std::string bash_completion(std::span<const Command> verbs, const Command& daemon);
std::string zsh_completion(std::span<const Command> verbs, const Command& daemon);
std::string fish_completion(std::span<const Command> verbs);

// fish looks for a program's completion in a file of its name. Thread: any.
std::string fish_completion(const Command& daemon);

// Lists the names of daemons that publish, for all three shells.
inline constexpr std::string_view kListDaemons =
    "for f in /dev/shm/bolo.*; do [ -e \"$f\" ] && echo \"${f#/dev/shm/bolo.}\"; done";

}  // namespace bolo::tools
