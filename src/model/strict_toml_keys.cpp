// Types of a table's keys and their documentation; strict_toml.cpp reads files.
#include "src/model/strict_toml.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <sstream>
#include <utility>

#include "src/core/text.hpp"

namespace bolo::model {
namespace {

// Shortest text that reads back as the same value; always a TOML float.
std::string float_text(double value) {
  std::array<char, 64> buffer{};
  const double size = std::abs(value);
  const bool handy = size == 0.0 || (size >= 1e-6 && size < 1e15);
  const auto format = handy ? std::chars_format::fixed : std::chars_format::general;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, format).ptr;
  std::string text(buffer.data(), end);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

// Human-readable: whole numbers without a point.
std::string plain_text(double value) {
  std::string text = float_text(value);
  if (text.ends_with(".0")) text.resize(text.size() - 2);
  return text;
}

// A TOML text. Control characters are escaped; what is not UTF-8 has no place in TOML and becomes '?'.
std::string in_quotes(std::string_view text) {
  constexpr std::string_view kHex = "0123456789ABCDEF";
  std::string result = "\"";
  while (!text.empty()) {
    const auto first = static_cast<unsigned char>(text.front());
    const std::size_t bytes = printable_character(text);
    if (first == '"' || first == '\\') result += '\\';
    if (bytes != 0) {
      result += text.substr(0, bytes);
    } else if (first < 0x80U) {
      result += {'\\', 'u', '0', '0', kHex[first >> 4U], kHex[first & 0xfU]};
    } else {
      result += '?';
    }
    text.remove_prefix(std::max<std::size_t>(bytes, 1));
  }
  return result + '"';
}

std::string range_text(const Range& range) {
  const std::string unit = range.unit.empty() ? "" : " " + std::string(range.unit);
  return plain_text(range.min) + " to " + plain_text(range.max) + unit;
}

std::string out_of_range(const std::string& value, const Range& range) {
  return " = " + value + " is out of range: " + range_text(range);
}

bool inside(double value, const Range& range) { return value >= range.min && value <= range.max; }  // false for NaN

std::string list_text(const std::vector<int>& values) {
  std::string text;
  for (const int value : values) text += (text.empty() ? "" : ", ") + std::to_string(value);
  return "[" + text + "]";
}

std::string octal_text(unsigned value) {
  std::ostringstream out;
  out << "0o" << std::oct << value;
  return out.str();
}

using Value = KeyTable::Value;
using Checked = KeyTable::Checked;
using Check = KeyTable::Check;

tl::unexpected<std::string> wrong(std::string what) { return tl::unexpected<std::string>(std::move(what)); }

// The checks below serve plain and optional variables alike: both are assigned the bare value.
template <typename Target>
Check number_check(Target& target, Range range) {
  return [&target, range](const Value& given) -> Checked {
    const auto* whole = std::get_if<std::int64_t>(&given);
    const auto* real = std::get_if<double>(&given);
    if (whole == nullptr && real == nullptr) return wrong(" must be a number: " + range_text(range));
    const double number = whole != nullptr ? static_cast<double>(*whole) : *real;
    if (!inside(number, range)) return wrong(out_of_range(plain_text(number), range));
    return [&target, number] { target = number; };
  };
}

template <typename Target>
Check integer_check(Target& target, Range range) {
  return [&target, range](const Value& given) -> Checked {
    const auto* whole = std::get_if<std::int64_t>(&given);
    if (whole == nullptr) return wrong(" must be a whole number: " + range_text(range));
    if (!inside(static_cast<double>(*whole), range)) return wrong(out_of_range(std::to_string(*whole), range));
    return [&target, number = static_cast<int>(*whole)] { target = number; };
  };
}

// Values that are taken as they are: `what` they must be.
template <typename Given, typename Target>
Check type_check(Target& target, std::string what) {
  return [&target, what = std::move(what)](const Value& given) -> Checked {
    const auto* value = std::get_if<Given>(&given);
    if (value == nullptr) return wrong(" must be " + what);
    return [&target, wanted = *value] { target = wanted; };
  };
}

std::string octal_range(const Range& range) {
  return octal_text(static_cast<unsigned>(range.min)) + " to " + octal_text(static_cast<unsigned>(range.max));
}

}  // namespace

void KeyTable::section(std::string_view name, std::string_view meaning) {
  sections_.push_back({std::string(name), std::string(meaning), {}});
}

void KeyTable::add(Key key) {
  Section& last = sections_.back();
  if (!last.name.empty()) key.path = last.name + "." + key.path;
  last.keys.push_back(std::move(key));
}

void KeyTable::number(std::string_view key, double& value, Range range, std::string_view meaning) {
  add({std::string(key), range_text(range), std::string(meaning), float_text(value), false,
       number_check(value, range)});
}

void KeyTable::number(std::string_view key, std::optional<double>& value, double example, Range range,
                      std::string_view meaning) {
  add({std::string(key), range_text(range), std::string(meaning), float_text(value.value_or(example)),
       !value.has_value(), number_check(value, range)});
}

void KeyTable::number_or_word(std::string_view key, double& value, bool& is_word, std::string_view word, Range range,
                              std::string_view meaning) {
  const std::string limits = range_text(range) + ", or " + in_quotes(word);
  const auto check = [&value, &is_word, word = std::string(word), range, limits](const Value& given) -> Checked {
    const auto* text = std::get_if<std::string>(&given);
    if (text != nullptr && *text == word) return [&is_word] { is_word = true; };
    const auto* whole = std::get_if<std::int64_t>(&given);
    const auto* real = std::get_if<double>(&given);
    if (whole == nullptr && real == nullptr) return wrong(" must be a number: " + limits);
    const double number = whole != nullptr ? static_cast<double>(*whole) : *real;
    if (!inside(number, range)) return wrong(" = " + plain_text(number) + " is out of range: " + limits);
    return [&value, &is_word, number] {
      value = number;
      is_word = false;
    };
  };
  add({std::string(key), limits, std::string(meaning), is_word ? in_quotes(word) : float_text(value), false, check});
}

void KeyTable::integer(std::string_view key, int& value, Range range, std::string_view meaning) {
  add({std::string(key), range_text(range), std::string(meaning), std::to_string(value), false,
       integer_check(value, range)});
}

void KeyTable::integer(std::string_view key, std::optional<int>& value, int example, Range range,
                       std::string_view meaning) {
  add({std::string(key), range_text(range), std::string(meaning), std::to_string(value.value_or(example)),
       !value.has_value(), integer_check(value, range)});
}

void KeyTable::octal(std::string_view key, unsigned& value, Range range, std::string_view meaning) {
  const auto check = [&value, range](const Value& given) -> Checked {
    const auto* whole = std::get_if<std::int64_t>(&given);
    if (whole == nullptr) return wrong(" must be an octal number such as 0o640, without quotes");
    if (!inside(static_cast<double>(*whole), range)) {
      const std::string text = *whole < 0 ? std::to_string(*whole) : octal_text(static_cast<unsigned>(*whole));
      return wrong(" = " + text + " is out of range: " + octal_range(range));
    }
    return [&value, number = static_cast<unsigned>(*whole)] { value = number; };
  };
  add({std::string(key), octal_range(range), std::string(meaning), octal_text(value), false, check});
}

void KeyTable::integers(std::string_view key, std::vector<int>& values, Range range, std::string_view meaning) {
  const auto check = [&values, range](const Value& given) -> Checked {
    const auto* list = std::get_if<std::vector<std::int64_t>>(&given);
    if (list == nullptr) return wrong(" must be a list of whole numbers such as [2, 3]");
    std::vector<int> numbers;
    for (const std::int64_t number : *list) {
      if (!inside(static_cast<double>(number), range)) return wrong(out_of_range(std::to_string(number), range));
      numbers.push_back(static_cast<int>(number));
    }
    return [&values, numbers = std::move(numbers)] { values = numbers; };
  };
  add({std::string(key), "list of " + range_text(range), std::string(meaning), list_text(values), false, check});
}

void KeyTable::boolean(std::string_view key, bool& value, std::string_view meaning) {
  add({std::string(key), "true or false", std::string(meaning), value ? "true" : "false", false,
       type_check<bool>(value, "true or false, without quotes")});
}

void KeyTable::text(std::string_view key, std::string& value, std::string_view meaning) {
  add({std::string(key), "text", std::string(meaning), in_quotes(value), false,
       type_check<std::string>(value, "a text in quotes")});
}

void KeyTable::file(std::string_view key, std::filesystem::path& value, std::string_view example,
                    std::string_view meaning) {
  const std::string shown = value.empty() ? std::string(example) : value.string();
  add({std::string(key), "file name", std::string(meaning), in_quotes(shown), value.empty(),
       type_check<std::string>(value, "a file name in quotes")});
  sections_.back().keys.back().file = true;
}

void KeyTable::add_choice(std::string_view key, const std::vector<std::string>& names,
                          std::optional<std::size_t> present, std::function<void(std::size_t)> store,
                          std::string_view meaning) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : " | ") + in_quotes(name);
  const auto check = [names, list, store = std::move(store)](const Value& given) -> Checked {
    const auto* word = std::get_if<std::string>(&given);
    if (word == nullptr) return wrong(" must be one of " + list);
    const auto found = std::find(names.begin(), names.end(), *word);
    if (found == names.end()) return wrong(" = " + in_quotes(excerpt(*word)) + " is none of " + list);
    return [store, index = static_cast<std::size_t>(found - names.begin())] { store(index); };
  };
  add({std::string(key), list, std::string(meaning), in_quotes(names[present.value_or(0)]), !present.has_value(),
       check});
}

void KeyTable::mark(std::string_view path, std::string_view word) {
  if (Key* const key = find(path)) key->mark = word;
}

void KeyTable::explain(std::string_view path, std::string_view words) {
  if (Key* const key = find(path)) key->origin = words;
}

std::map<std::string, std::string, std::less<>> KeyTable::texts() const {
  std::map<std::string, std::string, std::less<>> texts;
  for (const Section& section : sections_) {
    for (const Key& key : section.keys) texts.emplace(key.path, key.optional ? "" : key.initial);
  }
  return texts;
}

std::string KeyTable::document() const {
  std::string out;
  for (const Section& section : sections_) {
    if (!section.name.empty()) out += "\n[" + section.name + "]  # " + section.meaning + "\n";
    for (const Key& key : section.keys) {
      const std::string value =
          !key.origin.empty() ? key.origin : (key.optional ? "no default, example " : "default ") + key.initial;
      out += "\n# " + key.meaning + "\n# " + key.limits + "; " + value + (key.mark.empty() ? "" : "; " + key.mark) +
             "\n" + (key.optional ? "#" : "") + std::string(last_part(key.path)) + " = " + key.initial + "\n";
    }
  }
  return out.empty() ? out : out.substr(1);
}

}  // namespace bolo::model
