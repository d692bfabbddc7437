// Pages of a file, and the files beside one that is being written, which hold records of pages: FILE.journal, of the
// last commit that was made durable, and FILE.live, of the last commit of all, which counts for as long as the kernel
// keeps what was written to the file and has not reached the disk. crash_safe_file.hpp says when each is written.
//
// FILE.live has two pointers in its first page. A record never overwrites the previous one; then the older pointer is
// set to it. So a process that is killed anywhere leaves a whole record.
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

std::filesystem::path journal_of(const std::filesystem::path& file);  // FILE.journal
std::filesystem::path live_of(const std::filesystem::path& file);     // FILE.live

// True if the file is no link and has no other name, or does not exist. Only such a file is written, emptied or
// removed: a link would lead to another file's content. Thread: any.
bool has_one_name(const std::filesystem::path& file);

// Identifies the kernel's page cache of the disk of `descriptor`: the boot, and the disk's sequence number in it. Empty
// bytes where it is unknown. Thread: any.
using CacheName = std::array<char, 64>;
CacheName cache_of(int descriptor);

// One of two, kLivePointerStep bytes apart.
struct LivePointer {
  std::uint64_t magic = 0x3145564c4f4c4f42ULL;  // "BOLOLVE1"
  std::uint64_t offset = 0;                     // of a record
  CacheName cache{};                            // that the record counts in
};
inline constexpr std::uint64_t kLivePointerStep = 512;

class LiveRecord {
 public:
  LiveRecord() = default;  // none is written
  // Empties FILE.live or creates it. Errors: errno's cause. Thread: setup.
  static Result<LiveRecord> create(const std::filesystem::path& file);

  // Without room for it there is none at all, rather than one that is too old. Thread: any one at a time.
  void write(const PageRecord& record);

 private:
  explicit LiveRecord(UniqueFd file);
  UniqueFd file_;
  CacheName cache_{};
  std::size_t turn_ = 0;  // whose pointer is next
  std::uint64_t begin_ = kPageBytes;
  std::uint64_t end_ = kPageBytes;
};

// Pages that the last commit lays over the file; none when there are no records, or torn ones only. Thread: any.
Pages read_records(const std::filesystem::path& file);

// Brings the last commit into the file itself and waits for the disk: the records are no longer needed. A kill or a cut
// of power in between leaves them good. False on failure, errno tells why (EWOULDBLOCK: a writer has it). Thread: any.
bool apply_records(const std::filesystem::path& file);

void remove_records(const std::filesystem::path& file);

}  // namespace bolo::capture
