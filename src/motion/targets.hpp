// Tables of kernels for every instruction set that is built in and that this processor runs.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include <hwy/targets.h>

namespace bolo::motion {

// Results of table() with dispatch set to each of the targets in `built` (HWY_TARGETS of the caller), best first;
// afterwards the best is chosen again. Lower bits are better. Thread: setup, one at a time.
template <typename GetTable>
auto tables_of_targets(std::int64_t built, const GetTable& table) {
  std::vector<decltype(&table())> found;
  std::int64_t left = (hwy::SupportedTargets() | HWY_STATIC_TARGET) & built;
  for (; left != 0; left &= left - 1) {
    hwy::SetSupportedTargetsForTest(left & -left);
    hwy::GetChosenTarget().DeInit();  // the next dispatch chooses again
    found.push_back(&table());
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().DeInit();
  return found;
}

// The table for `isa`; the best one for an empty name, the plainest if there is none. Thread: any.
template <typename Table>
const Table& table_for(const std::vector<const Table*>& tables, std::string_view isa) {
  for (const Table* table : tables) {
    if (isa.empty() || table->isa == isa) return *table;
  }
  return *tables.back();
}

}  // namespace bolo::motion
