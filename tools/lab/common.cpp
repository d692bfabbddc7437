#include "tools/lab/common.hpp"

#include <cstdio>
#include <mutex>

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

std::string line_of(std::span<const TextColumn> columns, const Json& row) {
  const auto text_of = [&row](const TextColumn& column) -> std::string {
    if (row.is_null()) return column.head;
    const Json::json_pointer place("/" + column.key);
    const Json value = row.contains(place) ? row.at(place) : Json();
    if (value.is_string()) return value.get<std::string>();
    if (value.is_array() && !value.empty()) return joined(value.get<std::vector<std::string>>(), " ");
    if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
    if (!value.is_number() || !std::isfinite(value.get<double>())) return "-";
    return plot::format(column.form, column.times * value.get<double>());
  };
  std::string line;
  for (const TextColumn& column : columns) {
    line += plot::format("%s%*s", line.empty() ? "" : " ", column.width, text_of(column).c_str());
  }
  return line;
}

Rows::Rows(bool json, std::vector<TextColumn> columns) : json_(json), columns_(std::move(columns)) {
  if (!json_) std::puts(line_of(columns_).c_str());
}

void Rows::add(Json row) {
  if (!json_) std::puts(line_of(columns_, row).c_str());
  std::fflush(stdout);
  rows_.push_back(std::move(row));
}

void Rows::finish(Json around, const char* key, const char* words) {
  around[key] = std::move(rows_);
  if (json_) std::puts(around.dump(2).c_str());
  if (!json_ && words != nullptr) std::puts(words);
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
