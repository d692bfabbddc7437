// A folder for a program's own files while it runs.
#pragma once

#include <filesystem>
#include <utility>

#include "src/core/result.hpp"

namespace bolo::tools {

// A folder of its own, gone afterwards with all that is in it.
class ScratchFolder {
 public:
  // In `parent`, or, where that is empty, where temporary files go. kFailed where none can be made. Thread: any.
  static Result<ScratchFolder> make(std::filesystem::path parent = {});
  ScratchFolder(ScratchFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  ScratchFolder& operator=(ScratchFolder&&) = delete;
  ~ScratchFolder();
  const std::filesystem::path& path() const { return path_; }
  // Gives up the folder: it stays.
  void keep() { path_.clear(); }

 private:
  explicit ScratchFolder(std::filesystem::path path) : path_(std::move(path)) {}
  std::filesystem::path path_;
};

}  // namespace bolo::tools
