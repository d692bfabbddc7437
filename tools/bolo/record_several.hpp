// `bolo record a b c`: a recording of its own for each camera, side by side.
#pragma once

#include <cxxopts.hpp>

namespace bolo::tools {

// A `bolo record` for each name, with the other options as given, into the folder of --output; a process each, so that
// none waits for another's disk or daemon. Returns the exit code: the worst of theirs. Thread: setup.
int record_several(const cxxopts::ParseResult& parsed);

}  // namespace bolo::tools
