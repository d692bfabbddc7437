// A file that grows and is rewritten in places, and of which a killed process or a cut of power leaves exactly the
// state of a commit, whatever part of the later writes reached the disk: a killed process that of the last one, a cut
// of power that of the last one that the disk had time for.
//
// Pages that existed at the last commit are never written before it is durable: such writes wait in memory. What lies
// beyond is written at once, for the committed state doesn't know of it. Each commit() is one for the process (P), and
// begins one for the disk (C) when none is under way, with all pages that wait, on a thread of its own, so that the
// writer never waits for the disk, however slow it is:
//
// - P:  all that waits and all that is on its way to the disk goes to FILE.live, in one record with a checksum, without
//       a sync: the kernel keeps what was written. From here on the new state is the one that a kill leaves.
// - C1: the file is synced: what is new beyond the committed pages is there, and so is C4 of the last time.
// - C2: the pages on their way go to FILE.journal, in one record with a checksum.
// - C3: the journal is synced. From here on the new state is the one that a cut of power leaves.
// - C4: the pages are written to the file. Reading them finds them in memory until then.
//
//   writer: P1 begin ... P2 ... P3 ... P4: C has ended, begin ... P5 ...
//   disk:      C1 ------- C2 C3 ---- C4                 C1 ------- C2 ...
//
// A cut before C3 finds a journal that is torn, or that of the last time, which changes nothing: C1 made its C4 whole.
// A cut after C3 finds the journal whole; opening lays its pages over the file, whatever C4 had come to. The live
// record names the kernel that wrote it, and is passed over by another one: what it builds on is gone. A kill finds the
// last P, whose record is never older than the pages of C4: opening lays it over journal and file. A kill within P
// finds the record of the P before, and the file as that left it but for C4's pages, which it has.
//
// Files that only are to survive the process do C2 and C4 themselves, in place of P.
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

class CrashSafeFile {
 public:
  // Creates the file and its records, or empties one that may be replaced, and locks it. A link in the place of any of
  // them is refused, and what it stands for not touched. Errors: kBadInput with the cause; what was made is gone then.
  // Thread: setup.
  static Result<std::unique_ptr<CrashSafeFile>> create(const std::filesystem::path& file, SurvivesCut survives,
                                                       Replace replace);
  // For reading, as the last commit left it. Thread: setup.
  static Result<std::unique_ptr<CrashSafeFile>> open(const std::filesystem::path& file);
  CrashSafeFile(const CrashSafeFile&) = delete;
  CrashSafeFile& operator=(const CrashSafeFile&) = delete;
  ~CrashSafeFile() = default;  // waits for the disk

  // The file may grow to `end` bytes, and somewhat beyond for HDF5's own structures: "disk full" is learnt before a
  // write fails half-way and leaves the structure torn. Errors: kFailed with the cause (disk full, quota, file size
  // limit); what was reserved before stays. Thread of this and all below: any one at a time.
  Status reserve(std::uint64_t end);

  // False on failure, errno tells why. What lies beyond size() is read as zeros; what the file had when it was opened
  // for reading, and has no longer, is a failure.
  bool read(std::uint64_t offset, std::size_t bytes, void* out) const;
  bool write(std::uint64_t offset, std::size_t bytes, const void* data);
  // The file is at least `end` bytes long afterwards. Tells what failed on the disk since the last commit, too; after a
  // failure it can be called again.
  bool commit(std::uint64_t end);
  // The file is on the disk afterwards and needs no records, as long as the last commit said; what was reserved beyond
  // is given back.
  bool finish();

  // False once another program removed the file, gave its name to another, or cut it off.
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
  LiveRecord live_;   // none but for SurvivesCut::kPower
  bool power_ = false;
  std::uint64_t reserved_ = 0;
  std::uint64_t size_ = 0;
  std::uint64_t length_ = 0;        // of the file itself: without what waits
  std::uint64_t opened_bytes_ = 0;  // that the file had; 0 when writing
  std::uint64_t end_ = 0;           // that the last commit was told
  std::uint64_t committed_pages_ = 0;
  std::uint64_t sequence_ = 0;
  Pages waiting_;               // of a file that is read: what the records lay over it
  PageRecord on_way_;           // to the disk; both threads read it until end_disk()
  bool names_durable_ = false;  // of write_commit()
  std::future<int> disk_;       // of C1 to C4, while they are under way: 0 or an errno. Last: it ends first
};

}  // namespace bolo::capture
