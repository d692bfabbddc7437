// Pages of a file, and the record that keeps a set of them beside it.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace bolo::capture {

inline constexpr std::size_t kPageBytes = 4096;
using Page = std::vector<std::byte>;          // kPageBytes of them
using Pages = std::map<std::uint64_t, Page>;  // by number: the offset is number * kPageBytes

// pwrite() of all of it. False on failure, errno tells why. Thread: any.
bool write_all(int descriptor, std::uint64_t offset, std::size_t bytes, const void* data);
// pread(): fewer bytes than asked for only at the end of the file; -1 on failure. Thread: any.
ssize_t read_some(int descriptor, std::uint64_t offset, std::size_t bytes, void* out);
bool read_all(int descriptor, std::uint64_t offset, std::size_t bytes, void* out);

// Writes pages to where they belong; nothing at or beyond `end`. False on failure, errno tells why. Thread: any.
bool write_pages(int descriptor, const Pages& pages, std::uint64_t end);

struct PageRecord {
  std::uint64_t sequence = 0;  // of the commit; a later one has a higher number
  Pages pages;
};

// As bytes: a head with a checksum, the pages' numbers, the pages. Thread: any.
std::vector<std::byte> to_bytes(const PageRecord& record);
// The record that begins at `offset`; none when it is torn or none was written there. Thread: any.
std::optional<PageRecord> read_record(int descriptor, std::uint64_t offset);

}  // namespace bolo::capture
