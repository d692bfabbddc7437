// Drawings and pages as a program that reads markup sees them.
#pragma once

#include "tests/test.hpp"

namespace bolo::plot::test {

struct Element {
  std::string name;
  std::map<std::string, std::string> attributes;
  std::string text;
  double x = 0.0;  // of <text>: where it begins to be drawn in the whole drawing, px
  double y = 0.0;
};

// The elements in their order; none, and a failed expectation, when the markup is not well-formed.
std::vector<Element> elements_of(const std::string& markup);

struct TextBox {
  std::string words;
  double left = 0.0;
  double right = 0.0;
  double top = 0.0;
  double bottom = 0.0;
};
std::vector<TextBox> text_boxes(const std::vector<Element>& elements);

// Words that stand on one another, as "one | other".
std::vector<std::string> overlaps(const std::vector<TextBox>& boxes);

}  // namespace bolo::plot::test
