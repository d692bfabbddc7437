// The terminal that `bolo stat` draws on, one picture over the other.
#pragma once

#include <string>
#include <vector>

#include "tools/bolo/stat_history.hpp"

namespace bolo::tools {

// A table of ended lines and lines below it, cut to what a terminal shows: first the table's end goes. Letters count
// as one column each. Thread: any.
std::vector<std::string> fitted(const std::string& table, const std::vector<std::string>& below, TextSpace space);

// What is sent to draw `lines` where `drawn` lines stand above the cursor: nothing is blank in between. Thread: any.
std::string redrawn(const std::vector<std::string>& lines, int drawn);

// Of standard output; 80 by 24 where it is no terminal. Thread: any.
TextSpace terminal_space();

class StatScreen {
 public:
  // Whether standard output can be drawn over.
  static bool is_there();

  StatScreen();
  void show(const std::string& table, const StatHistory& history);
  // Draws the last picture again when the terminal has got another size.
  void follow_size(const StatHistory& history);

 private:
  bool colour_;
  TextSpace space_;
  std::string table_;
  int drawn_ = 0;  // lines above the cursor
};

}  // namespace bolo::tools
