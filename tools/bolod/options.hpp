// The command line of `bolod`, for the program and for its manual page.
#pragma once

#include <cxxopts.hpp>

namespace bolo::tools {

// Thread: setup.
inline cxxopts::Options bolod_options() {
  cxxopts::Options options("bolod", "Deblurs a thermal camera's frames and hands them to other programs.");
  options.add_options()                                                                             //
      ("config", "The configuration to run", cxxopts::value<std::string>(), "FILE")                 //
      ("check-config", "Say whether the configuration is right, and end")                           //
      ("print-config", "Print the complete default configuration with its documentation, and end")  //
      ("version", "Print the version")                                                              //
      ("h,help", "Print this help");
  return options;
}

}  // namespace bolo::tools
