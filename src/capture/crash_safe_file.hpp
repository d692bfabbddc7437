// A file that grows and is rewritten in places. A killed process leaves exactly the state of the last commit, a power
// cut that of the last commit that reached the disk, regardless of later writes that had reached it.
//
// Pages that existed at the last commit are not overwritten before it is durable: such writes wait in memory. Writes
// beyond them go out at once, since the committed state does not include them. Each commit() is one for the process
// (P), and, if none is under way, begins one for the disk (C) of all waiting pages on a thread of its own: the writer
// never waits for the disk, however slow it is.
//
// - P:  pages that wait or are on their way to the disk go to FILE.live, in one record with a checksum, without a
//       sync: the kernel keeps the writes. From here on a kill leaves the new state.
// - C1: the file is synced: data beyond the committed pages is durable, and so is C4 of the previous commit.
// - C2: the pages on their way go to FILE.journal, in one record with a checksum.
// - C3: the journal is synced. From here on a power cut leaves the new state.
// - C4: the pages are written to the file. Reads find them in memory until then.
//
//   writer: P1 begin ... P2 ... P3 ... P4: C has ended, begin ... P5 ...
//   disk:      C1 ------- C2 C3 ---- C4                 C1 ------- C2 ...
//
// A power cut before C3 leaves a torn journal, or the previous one, which changes nothing: C1 made its C4 durable. A
// cut after C3 leaves a complete journal; opening writes its pages over the file, however far C4 had come. The live
// record names its boot and is ignored after another: the writes that it builds on are lost. After a kill, opening
// applies the record of the last P, never older than the pages of C4, over journal and file. A kill within P leaves the
// record of the previous P, and the file in its state except for C4's pages, which the record has.
//
// Files that need to survive only the death of the process do C2 and C4 themselves, in place of P.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <future>
#include <memory>
#include <utility>

#include "src/capture/commit_records.hpp"
#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::capture {

enum class SurvivesCut { kProcess, kPower };

// Refuses an existing file (an unfinished recording), as create() does. Errors: kBadInput, without its name.
// Thread: any.
Status check_unfinished(const std::filesystem::path& file);

class CrashSafeFile {
 public:
  // Creates the file and its records, or empties one that may be replaced, and locks it. A link in place of any of them
  // is refused, and its target not touched. Errors: kBadInput with the cause; created files are removed. Thread: setup.
  static Result<std::unique_ptr<CrashSafeFile>> create(const std::filesystem::path& file, SurvivesCut survives,
                                                       Replace replace);
  // Opens for reading, in the state of the last commit. Thread: setup.
  static Result<std::unique_ptr<CrashSafeFile>> open(const std::filesystem::path& file);
  ~CrashSafeFile() = default;  // waits for the disk

  // Lets the file grow to `end` bytes, and somewhat beyond for HDF5's own structures: "disk full" is reported before a
  // write fails half-way and tears the structure. Errors: kFailed with the cause (disk full, quota, file size limit);
  // earlier reservations stay. Thread of this and all below: any one at a time.
  Status reserve(std::uint64_t end);

  // False on failure, with errno. Bytes beyond size() read as zeros; a file truncated since open() is a failure.
  bool read(std::uint64_t offset, std::size_t bytes, void* out) const;
  bool write(std::uint64_t offset, std::size_t bytes, const void* data);
  // The file then has at least `end` bytes. Also reports earlier failures on the disk; can be called again after one.
  bool commit(std::uint64_t end);
  // Makes the last commit durable in the file itself, which then needs no records, and frees reserved space beyond it.
  bool finish();

  // False once another program has removed or truncated the file, or given its name to another.
  bool is_ours() const;
  std::uint64_t size() const noexcept { return size_; }
  int descriptor() const noexcept { return file_.get(); }

 private:
  CrashSafeFile(std::filesystem::path name, UniqueFd file) : name_(std::move(name)), file_(std::move(file)) {}
  Status begin(SurvivesCut survives);
  bool write_through(std::uint64_t offset, std::size_t bytes, const std::byte* data);
  bool defer_write(std::uint64_t offset, std::size_t bytes, const std::byte* data);
  const Page* in_memory(std::uint64_t number) const;
  int write_commit(const PageRecord& record, std::uint64_t end);
  bool commit_here();
  bool commit_for_power();
  void begin_disk();
  bool end_disk();
  bool resize(std::uint64_t end);

  const std::filesystem::path name_;
  UniqueFd file_;
  UniqueFd journal_;  // none when reading
  LiveRecord live_;   // none except for SurvivesCut::kPower
  bool power_ = false;
  std::uint64_t reserved_ = 0;
  std::uint64_t size_ = 0;
  std::uint64_t length_ = 0;        // of the file itself, without waiting pages
  std::uint64_t opened_bytes_ = 0;  // at open; 0 when writing
  std::uint64_t end_ = 0;           // of the last commit
  std::uint64_t committed_pages_ = 0;
  std::uint64_t sequence_ = 0;
  Pages waiting_;               // when reading: pages of the records, which supersede the file's
  PageRecord on_way_;           // to the disk; both threads read it until end_disk()
  bool names_durable_ = false;  // of write_commit()
  std::future<int> disk_;       // C1 to C4, while they are under way: 0 or an errno. Last member: destroyed first
};

}  // namespace bolo::capture
