// The columns of the table: what the detectors are shown of each look.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/detect/picture.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::detect {

enum class ColumnKind : std::uint8_t { kSharp, kBlurred, kLive, kBolo, kBaseline, kLearned };

struct Column {
  ColumnKind kind = ColumnKind::kSharp;
  std::string name;   // in JSON
  std::string title;  // in tables
  std::string words;  // in the help and on the page
};

// In the order in which shown_columns() makes them; learned ones follow.
inline constexpr std::size_t kSharpColumn = 0;
inline constexpr std::size_t kBlurredColumn = 1;
const std::vector<Column>& own_columns();

// What a column shows of one look.
struct Shown {
  Levels levels;
  std::string setting;  // what was picked with the truth, or measured
};

// own_columns() of the sequence's only target. Black and white are those of the still. kBadInput or kFailed from the
// solvers. Thread: any, several at once.
Result<std::vector<Shown>> shown_columns(const fidelity::Sequence& sequence);

}  // namespace bolo::tools::detect
