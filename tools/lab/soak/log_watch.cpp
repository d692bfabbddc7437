#include "tools/lab/soak/log_watch.hpp"

#include <algorithm>
#include <cctype>

namespace bolo::tools::soak {
namespace {

constexpr std::string_view kTime = "2026-11-22 10:00:00.000 ";

bool begins_with_time(std::string_view line) {
  if (line.size() < kTime.size()) return false;
  return std::equal(kTime.begin(), kTime.end(), line.begin(), [](char form, char c) {
    const bool digit = std::isdigit(static_cast<unsigned char>(form)) != 0;
    return digit ? std::isdigit(static_cast<unsigned char>(c)) != 0 : form == c;
  });
}

}  // namespace

LogLine classify(std::string_view line) {
  if (line.starts_with("bolod: ")) return LogLine::kNoStart;
  if (!begins_with_time(line)) return LogLine::kForeign;
  const std::string_view rest = line.substr(kTime.size());
  if (rest.starts_with("warning: ")) return LogLine::kWarning;
  if (!rest.starts_with("error: ") && !rest.starts_with("critical: ")) return LogLine::kUsual;
  if (rest.find("error: reload: ") == 0) return LogLine::kRefusedReload;
  if (rest.find("no signs of life") != std::string_view::npos) return LogLine::kNoLife;
  return LogLine::kError;
}

}  // namespace bolo::tools::soak
