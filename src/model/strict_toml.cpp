#include "src/model/strict_toml.hpp"

#include <toml++/toml.h>

#include <algorithm>

#include "src/core/input_file.hpp"
#include "src/core/text.hpp"

namespace bolo::model {
namespace {

constexpr std::uintmax_t kMaxFileBytes = 1U << 20;
constexpr std::size_t kMostDots = 32;        // in a key
constexpr std::size_t kLongestGuessed = 80;  // longest key that is taken for a misspelling

std::string position(const std::filesystem::path& file, std::int64_t line, std::int64_t column) {
  return file.string() + ":" + std::to_string(line) + ":" + std::to_string(column) + ": ";
}

Result<std::string> slurp(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return bad_input(file.string() + ": no such file");
  return read_input(file, kMaxFileBytes);
}

// Line of the first key with too many parts, or 0: the TOML library recurses into nested tables, without limit.
std::int64_t line_of_deep_key(std::string_view text) {
  std::int64_t line = 1;
  std::size_t dots = 0;
  char quote = '\0';
  bool comment = false;
  for (const char c : text) {
    if (c == '\n') {
      ++line;
      dots = 0;
      quote = '\0';
      comment = false;
    } else if (quote != '\0') {
      if (c == quote) quote = '\0';
    } else if (c == '"' || c == '\'') {
      quote = c;
    } else {
      comment = comment || c == '#';
      if (c == '=' || c == ',') dots = 0;  // numbers have dots, too
      if (c == '.' && !comment && ++dots > kMostDots) return line;
    }
  }
  return 0;
}

}  // namespace

std::string_view last_part(std::string_view path) {
  const std::size_t dot = path.rfind('.');
  return dot == std::string_view::npos ? path : path.substr(dot + 1);
}

// State of one read(). Values are stored only if the whole file is valid.
struct KeyTable::Reading {
  KeyTable& keys;
  std::vector<Commit> commits;
  std::vector<Problem> problems;
  std::map<std::string, Place, std::less<>> places;

  static Place place(const toml::source_region& source) { return {source.begin.line, source.begin.column}; }

  static Value value_of(const toml::node& node) {
    if (const auto* v = node.as_integer()) return v->get();
    if (const auto* v = node.as_floating_point()) return v->get();
    if (const auto* v = node.as_boolean()) return v->get();
    if (const auto* v = node.as_string()) return v->get();
    const auto* list = node.as_array();
    if (list == nullptr) return WrongType{};
    std::vector<std::int64_t> numbers;
    for (const toml::node& item : *list) {
      if (!item.is_integer()) return WrongType{};
      numbers.push_back(item.as_integer()->get());
    }
    return numbers;
  }

  // Resolves a relative file name against the settings file's folder; an empty one stays empty.
  Value resolved(Value value) const {
    auto* name = std::get_if<std::string>(&value);
    if (name != nullptr && !name->empty()) *name = (keys.file_.parent_path() / *name).string();
    return value;
  }

  void walk(const toml::table& table, const std::string& prefix) {
    for (const auto& [name, node] : table) {
      const std::string path = prefix + std::string(name.str());
      if (const Key* key = keys.find(path)) {
        take(*key, node);
      } else if (!keys.has_section(path)) {
        problems.push_back({place(name.source()), "unknown key '" + excerpt(path) + "'" + keys.nearest(path)});
      } else if (const toml::table* inner = node.as_table()) {
        walk(*inner, path + ".");
      } else {
        std::string message = "'" + path + "' is a section: write [";
        problems.push_back({place(name.source()), message.append(path).append("]")});
      }
    }
  }

  void take(const Key& key, const toml::node& node) {
    places.emplace(key.path, place(node.source()));
    Checked checked = key.check(key.file ? resolved(value_of(node)) : value_of(node));
    if (checked) {
      commits.push_back(std::move(*checked));
    } else {
      problems.push_back({place(node.source()), key.path + checked.error()});
    }
  }
};

Status KeyTable::read(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(const std::string text, slurp(file));
  if (const std::int64_t line = line_of_deep_key(text); line != 0) {
    return bad_input(position(file, line, 1) + "no key has so many parts");
  }
  file_ = file;
  places_.clear();
  Reading reading{*this, {}, {}, {}};
  try {
    reading.walk(toml::parse(text, file.string()), "");
  } catch (const toml::parse_error& e) {
    return bad_input(position(file, e.source().begin.line, e.source().begin.column) + std::string(e.description()));
  }
  if (!reading.problems.empty()) {
    const auto first = std::min_element(reading.problems.begin(), reading.problems.end(),
                                        [](const Problem& a, const Problem& b) { return a.place < b.place; });
    const std::size_t more = reading.problems.size() - 1;
    return bad_input(position(file, first->place.line, first->place.column) + first->message +
                     (more == 0 ? "" : " (and " + std::to_string(more) + " more wrong)"));
  }
  for (const Commit& commit : reading.commits) commit();
  places_ = std::move(reading.places);
  return {};
}

std::string KeyTable::where(std::string_view path) const {
  const auto found = places_.find(path);
  return found == places_.end() ? file_.string() + ": " : position(file_, found->second.line, found->second.column);
}

KeyTable::Key* KeyTable::find(std::string_view path) {
  for (Section& section : sections_) {
    for (Key& key : section.keys) {
      if (key.path == path) return &key;
    }
  }
  return nullptr;
}

bool KeyTable::has_section(std::string_view path) const {
  return !path.empty() &&
         std::any_of(sections_.begin(), sections_.end(), [path](const Section& s) { return s.name == path; });
}

// "; did you mean '...'?" for a misspelling of at most a third of the letters, or a key under the wrong section.
std::string KeyTable::nearest(std::string_view path) const {
  if (path.size() > kLongestGuessed) return "";
  std::string_view best;
  std::size_t best_distance = std::max<std::size_t>(2, last_part(path).size() / 3) + 1;
  const auto offer = [&](std::string_view candidate, std::size_t distance) {
    if (distance >= best_distance) return;
    best = candidate;
    best_distance = distance;
  };
  for (const Section& section : sections_) {
    if (!section.name.empty()) offer(section.name, edit_distance(path, section.name));
    for (const Key& key : section.keys) {
      offer(key.path, edit_distance(path, key.path));
      offer(key.path, edit_distance(last_part(path), last_part(key.path)) + 1);
    }
  }
  return best.empty() ? "" : "; did you mean '" + std::string(best) + "'?";
}

}  // namespace bolo::model
