// Drawings and pages as a parser of their markup sees them.
#pragma once

#include "tests/test.hpp"

namespace bolo::plot::test {

struct Element {
  std::string name;
  std::map<std::string, std::string> attributes;
  std::string text;
  double x = 0.0;  // left edge of a <text> in the drawing, px
  double y = 0.0;
};

// Elements in document order; none and a failed expectation if the markup is not well-formed.
std::vector<Element> elements_of(const std::string& markup);

struct TextBox {
  std::string words;
  double left = 0.0;
  double right = 0.0;
  double top = 0.0;
  double bottom = 0.0;
};
std::vector<TextBox> text_boxes(const std::vector<Element>& elements);

// Overlapping words, as "one | other".
std::vector<std::string> overlaps(const std::vector<TextBox>& boxes);

}  // namespace bolo::plot::test
