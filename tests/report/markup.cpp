#include "tests/report/markup.hpp"

#include <glib.h>

#include "src/report/text.hpp"

namespace bolo::plot::test {
namespace {

struct Shift {
  double x = 0.0;
  double y = 0.0;
};

struct Reading {
  std::vector<Element> elements;
  std::vector<std::size_t> open;
  std::vector<Shift> shifts{{}};
};

double number(const std::map<std::string, std::string>& attributes, const char* key) {
  const auto found = attributes.find(key);
  return found == attributes.end() ? 0.0 : std::stod(found->second);
}

void begin(GMarkupParseContext*, const char* name, const char** keys, const char** values, void* data, GError**) {
  auto& reading = *static_cast<Reading*>(data);
  Element element{name, {}, "", 0.0, 0.0};
  for (; *keys != nullptr; ++keys, ++values) element.attributes[*keys] = *values;
  Shift shift = reading.shifts.back();
  element.x = shift.x + number(element.attributes, "x");
  element.y = shift.y + number(element.attributes, "y");
  if (element.name == "svg") shift = {element.x, element.y};
  if (element.attributes.contains("transform")) {
    Shift by;
    EXPECT_EQ(std::sscanf(element.attributes["transform"].c_str(), "translate(%lf %lf)", &by.x, &by.y), 2);
    shift = {shift.x + by.x, shift.y + by.y};
  }
  reading.shifts.push_back(shift);
  reading.open.push_back(reading.elements.size());
  reading.elements.push_back(element);
}

void end(GMarkupParseContext*, const char*, void* data, GError**) {
  auto& reading = *static_cast<Reading*>(data);
  reading.open.pop_back();
  reading.shifts.pop_back();
}

void text(GMarkupParseContext*, const char* words, gsize size, void* data, GError**) {
  auto& reading = *static_cast<Reading*>(data);
  if (!reading.open.empty()) reading.elements[reading.open.back()].text.append(words, size);
}

}  // namespace

std::vector<Element> elements_of(const std::string& markup) {
  Reading reading;
  const GMarkupParser parser{begin, end, text, nullptr, nullptr};
  GMarkupParseContext* context = g_markup_parse_context_new(&parser, GMarkupParseFlags{}, &reading, nullptr);
  GError* error = nullptr;
  const bool good =
      g_markup_parse_context_parse(context, markup.data(), static_cast<gssize>(markup.size()), &error) != 0 &&
      g_markup_parse_context_end_parse(context, &error) != 0;
  EXPECT_TRUE(good) << (error != nullptr ? error->message : "");
  g_clear_error(&error);
  g_markup_parse_context_free(context);
  return good ? reading.elements : std::vector<Element>();
}

std::vector<TextBox> text_boxes(const std::vector<Element>& elements) {
  std::vector<TextBox> boxes;
  for (const Element& element : elements) {
    if (element.name != "text") continue;
    const std::string css_class = element.attributes.at("class");
    const auto has = [&](const char* word) { return css_class.find(word) != std::string::npos; };
    const double size = has("title") ? 15.0 : has("caption") ? 13.0 : 12.0;
    const double wide = text_width(element.text, size);
    const double left = element.x - (has("end") ? wide : has("middle") ? wide / 2 : 0.0);
    boxes.push_back({element.text, left, left + wide, element.y - 0.75 * size, element.y + 0.2 * size});
  }
  return boxes;
}

std::vector<std::string> overlaps(const std::vector<TextBox>& boxes) {
  std::vector<std::string> out;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    for (std::size_t k = i + 1; k < boxes.size(); ++k) {
      const TextBox& a = boxes[i];
      const TextBox& b = boxes[k];
      if (a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom) {
        out.push_back(a.words + " | " + b.words);
      }
    }
  }
  return out;
}

}  // namespace bolo::plot::test
