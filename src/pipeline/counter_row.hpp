// One row for each number that a daemon counts for its frames (stats.hpp) and its camera (source.hpp). Shared memory,
// metrics, JSON, `bolo stat` and the journal's last message follow: a new number needs a member, a row and a count.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>

namespace bolo::pipeline {

enum class RowKind : std::uint8_t {
  kCount,  // uint64
  kNs,     // int64
  kSince,  // int64, CLOCK_MONOTONIC; in JSON the seconds since then, null for 0
  kReal,   // double
};

struct InStat {
  std::string_view words{};  // after the number in `bolo stat`
};
struct AtEnd {
  bool at_end = false;  // included in the journal's last message, as KEY or KEY_PART
};
struct ByLabel {  // one number per part
  std::string_view label{};
  std::size_t parts = 1;
  std::string_view (*part_name)(std::size_t part) = nullptr;
};
struct Reading {
  RowKind kind = RowKind::kCount;
  double json_scale = 1.0;  // of kNs and kReal
  double metric_scale = 1.0;
  std::size_t known_by = 0;  // offset of a word that is 0 (JSON: null) while this one is unknown; 0: its own
};

template <typename Source>
struct CounterRow : InStat, AtEnd, ByLabel, Reading {
  using Read = std::uint64_t (*)(const Source& source, std::size_t part) noexcept;
  template <typename... Extras>
  constexpr CounterRow(Read r, std::size_t at, std::string_view k = {}, std::string_view m = {},
                       std::string_view h = {}, Extras... extras)
      : read(r), shared(at), key(k), metric(m), help(h) {
    ((static_cast<Extras&>(*this) = extras), ...);
  }

  Read read;                // the number's 64 bits. Thread: any
  std::size_t shared;       // offset in bolo_shm_header or bolo_shm_camera; 0: not written there with the others
  std::string_view key;     // in JSON; empty: not there, or not by itself
  std::string_view metric;  // for Prometheus: a counter if it ends in _total, otherwise a gauge; empty: not there
  std::string_view help;
};

template <typename Enum>
constexpr ByLabel by(std::string_view label, std::size_t count) {
  return {label, count, [](std::size_t part) { return name(static_cast<Enum>(part)); }};
}

// A part's name in JSON and metrics: "control lost" is control_lost. Thread: any.
template <typename Source>
std::string part_key(const CounterRow<Source>& row, std::size_t part) {
  std::string key(row.part_name(part));
  for (char& letter : key) letter = letter == ' ' ? '_' : letter;
  return key;
}

// The member's 64 bits; for an array, those of its part.
template <auto kMember, typename Source>
std::uint64_t word_of(const Source& source, std::size_t part) noexcept {
  const auto bits = [](auto value) {
    if constexpr (std::is_same_v<decltype(value), double>) return std::bit_cast<std::uint64_t>(value);
    return static_cast<std::uint64_t>(value);
  };
  if constexpr (requires { (source.*kMember)[part]; })
    return bits((source.*kMember)[part].value());
  else
    return bits((source.*kMember).value());
}

// Calls store(index, word) for every number in shared memory; the index counts words from its structure's beginning.
template <typename Rows, typename Source, typename Store>
void each_shared_word(const Rows& rows, const Source& source, const Store& store) noexcept {
  for (const auto& row : rows) {
    if (row.shared == 0) continue;
    for (std::size_t i = 0; i < row.parts; ++i) store(row.shared / sizeof(std::uint64_t) + i, row.read(source, i));
  }
}

}  // namespace bolo::pipeline
