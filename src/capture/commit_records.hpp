// Pages of a file, and the files of page records beside a file that is being written: FILE.journal holds the last
// durable commit, FILE.live the last commit of all, valid as long as the kernel keeps the writes that have not reached
// the disk. crash_safe_file.hpp describes when each is written.
//
// FILE.live has two pointers in its first page. A record never overwrites the previous one; then the older pointer is
// set to it. So a kill at any time leaves a complete record.
#pragma once

#include <sys/types.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <vector>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::capture {

inline constexpr std::size_t kPageBytes = 4096;
using Page = std::vector<std::byte>;          // kPageBytes of them
using Pages = std::map<std::uint64_t, Page>;  // by page number: the offset is number * kPageBytes

// Complete pwrite(). False on failure, with errno. Thread: any.
bool write_all(int descriptor, std::uint64_t offset, std::size_t bytes, const void* data);
// pread(): fewer bytes than asked for only at the end of the file; -1 on failure. Thread: any.
ssize_t read_some(int descriptor, std::uint64_t offset, std::size_t bytes, void* out);
bool read_all(int descriptor, std::uint64_t offset, std::size_t bytes, void* out);

// Writes pages to their places, nothing at or beyond `end`. False on failure, with errno. Thread: any.
bool write_pages(int descriptor, const Pages& pages, std::uint64_t end);

struct PageRecord {
  std::uint64_t sequence = 0;  // of the commit; a later one has a higher number
  Pages pages;
};

// Serialised: a head with a checksum, the pages' numbers, the pages. Thread: any.
std::vector<std::byte> to_bytes(const PageRecord& record);
// The record that begins at `offset`; none if it is torn or missing. Thread: any.
std::optional<PageRecord> read_record(int descriptor, std::uint64_t offset);

std::filesystem::path journal_of(const std::filesystem::path& file);  // FILE.journal
std::filesystem::path live_of(const std::filesystem::path& file);     // FILE.live

// True if the file is no link and has no other name, or does not exist. Only such a file is written, emptied or
// removed: a link would lead to another file's content. Thread: any.
bool has_one_name(const std::filesystem::path& file);

// Identifies the kernel's page cache of `descriptor`'s disk: boot and disk sequence number; empty if unknown.
// Thread: any.
using CacheName = std::array<char, 64>;
CacheName cache_of(int descriptor);

// One of two pointers, kLivePointerStep bytes apart.
struct LivePointer {
  std::uint64_t magic = 0x3145564c4f4c4f42ULL;  // "BOLOLVE1"
  std::uint64_t offset = 0;                     // of a record
  CacheName cache{};                            // for which the record is valid
};
inline constexpr std::uint64_t kLivePointerStep = 512;

class LiveRecord {
 public:
  LiveRecord() = default;  // writes nothing
  // Empties FILE.live or creates it. Errors state errno. Thread: setup.
  static Result<LiveRecord> create(const std::filesystem::path& file);

  // If there is no room, no record is left, rather than an outdated one. Thread: any one at a time.
  void write(const PageRecord& record);

 private:
  explicit LiveRecord(UniqueFd file);
  UniqueFd file_;
  CacheName cache_{};
  std::size_t turn_ = 0;  // index of the pointer to set next
  std::uint64_t begin_ = kPageBytes;
  std::uint64_t end_ = kPageBytes;
};

// Pages of the last commit that supersede the file's; none if there are no records, or only torn ones. Thread: any.
Pages read_records(const std::filesystem::path& file);

// Applies the last commit to the file itself and waits for the disk: it needs no records then. A kill or a power cut in
// between leaves them valid. False on failure, with errno (EWOULDBLOCK: a writer holds the file). Thread: any.
bool apply_records(const std::filesystem::path& file);

void remove_records(const std::filesystem::path& file);

}  // namespace bolo::capture
