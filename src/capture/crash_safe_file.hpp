// A file that grows and is rewritten in places, and of which a killed process or a cut of power leaves exactly the
// state of the last commit, whatever part of the later writes reached the disk.
//
// Pages that existed at the last commit are never written before the next one: such writes wait in memory. What lies
// beyond is written at once, for the committed state doesn't know of it. commit() goes in this order:
//
// - C1: the file is synced: what is new beyond the committed pages is there, and so is C4 of the last commit.
// - C2: the waiting pages go to the journal, in one record with a checksum.
// - C3: the journal is synced. From here on the new state is the one that is found.
// - C4: the waiting pages are written to the file.
//
// A cut before C3 finds a record that is torn, or that of the last commit, which changes nothing: C1 made its C4 whole.
// A cut after C3 finds the record whole; opening lays its pages over the file, whatever C4 had come to. Against a
// killed process alone the order is enough and the syncs are left out: the kernel keeps what was written.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <vector>

#include "bolo/core/result.hpp"

namespace bolo::capture {

inline constexpr std::size_t kPageBytes = 4096;
using Page = std::vector<std::byte>;          // kPageBytes of them
using Pages = std::map<std::uint64_t, Page>;  // by number: the offset is number * kPageBytes

std::filesystem::path journal_of(const std::filesystem::path& file);  // FILE.journal

// Makes names durable that were given or taken in the file's folder. False on failure. Thread: any.
bool sync_folder_of(const std::filesystem::path& file);

// The pages of the last commit's record; none when there is no journal or its record is torn. Thread: any.
Pages read_journal(const std::filesystem::path& file);

// Writes the journal's pages to the file and waits for the disk: the last commit no longer needs the journal. False on
// failure, errno tells why. Thread: any.
bool settle(const std::filesystem::path& file);

enum class SurvivesCut { kProcess, kPower };

class CrashSafeFile {
 public:
  // Empties the file, or creates it and its journal, and locks it. Errors: kBadInput with the cause. Thread: setup.
  static Result<std::unique_ptr<CrashSafeFile>> create(const std::filesystem::path& file, SurvivesCut survives);
  // For reading, as the last commit left it. Thread: setup.
  static Result<std::unique_ptr<CrashSafeFile>> open(const std::filesystem::path& file);
  CrashSafeFile(const CrashSafeFile&) = delete;
  CrashSafeFile& operator=(const CrashSafeFile&) = delete;
  ~CrashSafeFile();

  // False on failure, errno tells why. What lies beyond size() is read as zeros. Thread: any one at a time.
  bool read(std::uint64_t offset, std::size_t bytes, void* out) const;
  bool write(std::uint64_t offset, std::size_t bytes, const void* data);
  // The file is at least `end` bytes long afterwards. After a failure it can be called again.
  bool commit(std::uint64_t end);
  // Cuts or extends a committed file to `end` bytes.
  bool resize(std::uint64_t end);

  std::uint64_t size() const noexcept { return size_; }
  int descriptor() const noexcept { return file_; }

 private:
  CrashSafeFile(int file, int journal, SurvivesCut survives) : file_(file), journal_(journal), survives_(survives) {}
  bool write_through(std::uint64_t offset, std::size_t bytes, const std::byte* data);
  bool hold_back(std::uint64_t offset, std::size_t bytes, const std::byte* data);
  bool write_journal();
  bool apply();

  int file_;
  int journal_;  // -1 when reading
  SurvivesCut survives_;
  std::uint64_t size_ = 0;
  std::uint64_t length_ = 0;  // on the disk: without what waits
  std::uint64_t committed_pages_ = 0;
  std::uint64_t sequence_ = 0;
  std::uint64_t not_started_ = 0;  // bytes written through whose way to the disk was not begun
  Pages waiting_;                  // of a file that is read: what the journal lays over it
};

}  // namespace bolo::capture
