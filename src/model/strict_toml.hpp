// Settings files whose keys are declared once: the declaration reads, validates and documents them.
//
//   KeyTable keys;
//   keys.number("deblur.lambda", settings.lambda, {0.0, 1000.0, "K"}, "Weight of the prior");
//   keys.read("bolod.toml");      // settings.lambda is set when the file has it, else keeps its default
//   keys.document();              // a complete commented TOML with the present values
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::model {

// A number's closed range and its unit ("" when it has none).
struct Range {
  double min = 0.0;
  double max = 0.0;
  std::string_view unit;
};

// "key" of "section.key". Thread: any.
std::string_view last_part(std::string_view path);

// Binds dotted key paths ("section.key", or "key" before any section) to variables. The variables must outlive the
// table; their values when a key is declared are its default. Thread: one at a time.
class KeyTable {
 public:
  // Starts a section: keys declared from here on lie in [name], printed below its heading.
  void section(std::string_view name, std::string_view meaning);

  // `key` is relative to the section. A number accepts an integer too; an absent optional key stays empty, `example` is
  // what the documentation shows in its place.
  void number(std::string_view key, double& value, Range range, std::string_view meaning);
  void number(std::string_view key, std::optional<double>& value, double example, Range range,
              std::string_view meaning);
  // A number, or `word` in quotes; a word leaves the number alone. The default is the word when `is_word` is set.
  void number_or_word(std::string_view key, double& value, bool& is_word, std::string_view word, Range range,
                      std::string_view meaning);
  void integer(std::string_view key, int& value, Range range, std::string_view meaning);
  void integer(std::string_view key, std::optional<int>& value, int example, Range range, std::string_view meaning);
  // Permission bits, printed as 0o644.
  void octal(std::string_view key, unsigned& value, Range range, std::string_view meaning);
  void integers(std::string_view key, std::vector<int>& values, Range range, std::string_view meaning);
  void boolean(std::string_view key, bool& value, std::string_view meaning);
  void text(std::string_view key, std::string& value, std::string_view meaning);
  // A file's name; relative ones are resolved against the folder of the settings file. Empty stays empty.
  void file(std::string_view key, std::filesystem::path& value, std::string_view example, std::string_view meaning);

  template <typename Enum>
  using Choices = std::span<const std::pair<std::string_view, Enum>>;
  // `value`: an Enum, or an optional one.
  template <typename Enum, typename Target>
  void choice(std::string_view key, Target& value, Choices<Enum> choices, std::string_view meaning);

  // Reads a file into the bound variables. A syntax error, an unknown key (with the nearest valid one), a wrong type
  // and a value out of range are bad input: "FILE:LINE:COLUMN: what is wrong"; the first in the file is reported, and
  // the number of others. The variables keep their values when anything is wrong. Thread: setup.
  Status read(const std::filesystem::path& file);

  // A note on a declared key that document() prints beside its default.
  void mark(std::string_view path, std::string_view word);
  // Replaces "default" and the value in document()'s line for a key.
  void explain(std::string_view path, std::string_view words);

  // Each key's value at declaration, as TOML, by path; empty for a key without a value. For variables that were read
  // before: the file's value.
  std::map<std::string, std::string, std::less<>> texts() const;

  // "FILE:LINE:COLUMN: " of a key that the file has, otherwise "FILE: ": for errors that involve several keys.
  std::string where(std::string_view path) const;

  // A TOML text with every key, its meaning, unit, range and value; a key without a value is commented out.
  std::string document() const;

  // A value in a file, and a key's check of it: how to store it, or what is wrong (" must be ...").
  struct WrongType {};
  using Value = std::variant<std::int64_t, double, bool, std::string, std::vector<std::int64_t>, WrongType>;
  using Commit = std::function<void()>;
  using Checked = tl::expected<Commit, std::string>;
  using Check = std::function<Checked(const Value&)>;

 private:
  struct Key {
    std::string path;
    std::string limits;  // unit and range in words
    std::string meaning;
    std::string initial;  // the default as TOML; what is shown when there is no value, if `optional`
    bool optional = false;
    Check check;
    std::string mark{};
    std::string origin{};  // empty: the default
    bool file = false;     // a relative name is resolved against the settings file's folder
  };
  struct Section {
    std::string name;
    std::string meaning;
    std::vector<Key> keys;
  };
  struct Place {
    std::int64_t line = 0;
    std::int64_t column = 0;
    auto operator<=>(const Place&) const = default;  // NOLINT(modernize-use-nullptr)
  };
  struct Problem {
    Place place;
    std::string message;
  };
  struct Reading;  // state of one read()

  void add(Key key);
  Key* find(std::string_view path);
  bool has_section(std::string_view path) const;
  std::string nearest(std::string_view path) const;

  // Choices as text, so that one function independent of Enum does the work; `store` gets the index.
  void add_choice(std::string_view key, const std::vector<std::string>& names, std::optional<std::size_t> present,
                  std::function<void(std::size_t)> store, std::string_view meaning);

  std::vector<Section> sections_{{}};  // the first has no name: the keys before any section
  std::filesystem::path file_;
  std::map<std::string, Place, std::less<>> places_;
};

template <typename Enum, typename Target>
void KeyTable::choice(std::string_view key, Target& value, Choices<Enum> choices, std::string_view meaning) {
  std::vector<std::string> names;
  std::optional<std::size_t> present;
  for (std::size_t i = 0; i < choices.size(); ++i) {
    names.emplace_back(choices[i].first);
    if (choices[i].second == value) present = i;
  }
  add_choice(
      key, names, present, [&value, choices](std::size_t i) { value = choices[i].second; }, meaning);
}

}  // namespace bolo::model
