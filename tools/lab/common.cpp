#include "tools/lab/common.hpp"

#include <cstdio>
#include <map>
#include <mutex>

#include "src/core/statistics.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"

namespace bolo::tools {

Result<Geometry> size_of(const std::string& text, const char* option, Geometry least, Geometry most) {
  Geometry size;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%dx%d%c", &size.width, &size.height, &rest) == 2 && size.width >= least.width &&
      size.height >= least.height && size.width <= most.width && size.height <= most.height) {
    return size;
  }
  return bad_input(plot::format("--%s '%s': expected WIDTHxHEIGHT, %dx%d to %dx%d pixels", option, text.c_str(),
                                least.width, least.height, most.width, most.height));
}

std::string joined(const std::vector<std::string>& words, const char* between) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

namespace {

std::string text_of(const Json& value) {
  if (value.is_string()) return printable(value.get_ref<const std::string&>());
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_number_integer()) return value.dump();
  return value.is_number() && std::isfinite(value.get<double>()) ? plot::format("%.4g", value.get<double>()) : "-";
}

// Names and texts of all leaf values, such as "recovery_ms/median".
using Fields = std::vector<std::pair<std::string, std::string>>;
Fields fields_of(const Json& object) {
  Fields fields;
  const Json flat = object.empty() ? Json::object() : object.flatten();
  for (const auto& [place, value] : flat.items()) fields.emplace_back(place.substr(1), text_of(value));
  return fields;
}

bool is_table(const Json& value) {
  return value.is_structured() && !value.empty() && std::ranges::all_of(value, &Json::is_object);
}

std::string table_of(const Json& rows, const std::string& indent);

// One line for plain values, then the tables.
std::string lines_of(const Json& object, const std::string& indent, const std::string& name = "") {
  Json plain = Json::object();
  std::string tables;
  for (const auto& [key, value] : object.items()) {
    is_table(value) ? void(tables += indent + key + "\n" + table_of(value, indent + "  ")) : void(plain[key] = value);
  }
  const auto words = mapped(fields_of(plain), [](const auto& field) { return field.first + " " + field.second; });
  const std::string line = name + (name.empty() || words.empty() ? "" : ": ") + joined(words);
  return (line.empty() ? "" : indent + line + "\n") + tables;
}

// A row on each line; for a table that is too wide, the rows one by one.
std::string table_of(const Json& rows, const std::string& indent) {
  constexpr std::size_t kWidest = 240;
  Fields heads;
  std::map<std::string, std::size_t> widths;
  std::vector<std::map<std::string, std::string>> lines(1);
  for (const auto& [name, row] : rows.items()) {
    Fields fields = fields_of(row);
    if (rows.is_object()) fields.insert(fields.begin(), {"", name});
    for (const auto& [head, text] : fields) {
      if (!widths.contains(head)) heads.emplace_back(head, lines[0][head] = head);
      widths[head] = std::max({widths[head], head.size(), text.size()});
    }
    lines.emplace_back(fields.begin(), fields.end());
  }
  std::string out;
  if (sum_of(widths, [](const auto& width) { return width.second + 2; }) > kWidest) {
    for (const auto& [name, row] : rows.items()) out += lines_of(row, indent, rows.is_object() ? name : "");
    return out;
  }
  for (auto& line : lines) {
    out += indent;
    for (const auto& [head, ignored] : heads) {
      const auto width = static_cast<int>(widths[head]);
      out += plot::format("%*s  ", head == heads.front().first ? -width : width, line[head].c_str());
    }
    out.erase(out.find_last_not_of(' ') + 1) += "\n";
  }
  return out;
}

}  // namespace

std::string report_text(const Json& report) { return lines_of(report, ""); }

void print_report(const Json& report, bool json) {
  std::fputs((json ? json_text(report, 2) + "\n" : report_text(report)).c_str(), stdout);
}

Status Jobs::run(int threads, Progress& progress, std::uint64_t& done) {
  std::vector<Status> outcomes(jobs_.size());
  std::mutex progress_lock;
  share_out(jobs_.size(), static_cast<std::size_t>(threads), [&](std::size_t i) {
    outcomes[i] = interrupted().load(std::memory_order_relaxed) ? Status(failed("interrupted")) : jobs_[i]();
    const std::lock_guard lock(progress_lock);
    progress.update(++done);
  });
  jobs_.clear();
  for (const Status& outcome : outcomes) {
    if (!outcome) return outcome;
  }
  return {};
}

}  // namespace bolo::tools
