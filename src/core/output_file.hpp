// The rule for every file that our programs write: no output is an input, nothing existing is replaced without the
// user's permission, and a file gets its name only when complete and on disk. So neither a kill nor a full disk costs a
// file.
#pragma once

#include <filesystem>
#include <string_view>
#include <utility>
#include <vector>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo {

enum class Replace {
  kNothing,
  kExisting,  // --overwrite
};

struct OutputFile {
  OutputFile() = default;
  OutputFile(std::filesystem::path file, Replace what = Replace::kNothing)  // NOLINT(google-explicit-constructor)
      : path(std::move(file)), replace(what) {}
  bool empty() const { return path.empty(); }

  std::filesystem::path path;
  Replace replace = Replace::kNothing;
};

// Creates the folder of outputs if it does not exist. Errors: kBadInput. Thread: any.
Status make_folder(const std::filesystem::path& folder);

// The same for a verb that may still be refused: the destructor removes its empty folders. Thread: any one at a time.
class OutputFolder {
 public:
  static Result<OutputFolder> make(const std::filesystem::path& folder);
  OutputFolder(OutputFolder&&) noexcept = default;
  OutputFolder& operator=(OutputFolder&&) = delete;
  ~OutputFolder();

 private:
  OutputFolder() = default;
  std::vector<std::filesystem::path> made_;  // innermost first
};

// Checks that `output` can be written: its folder takes files, and its name belongs to no folder or device, nor to a
// link to one, nor to a file that may not be replaced. Errors: kBadInput. Thread: any.
Status check_output(const OutputFile& output);

// The folder of a file, held open: if the folder's name is given to something else meanwhile, a link for instance,
// nothing is written there or removed from there. Thread: any.
class HeldFolder {
 public:
  HeldFolder() = default;
  explicit HeldFolder(const std::filesystem::path& file);
  // The file, or one beside it, in the held folder; its name as given if the folder or /proc is missing.
  std::filesystem::path place_of(const std::filesystem::path& file) const;
  // False once another folder, or none, has the name.
  bool is_folder_of(const std::filesystem::path& file) const;

 private:
  UniqueFd folder_;
};

// For a verb, before any work: each output can be written, is none of the inputs (by inode, so through links too) and
// none of the other outputs; nor is any temporary file, under an output's name and ".part" or beside it. Empty names
// are skipped. Errors: kBadInput. Thread: any.
Status check_outputs(const std::vector<std::filesystem::path>& outputs,
                     const std::vector<std::filesystem::path>& inputs, Replace replace);

// Renames `written` (closed, in the same folder, which is `folder`) to `output` once it is on disk. If the name was
// taken meanwhile and may not be replaced, or the folder changed, `written` stays, with an error. Thread: any.
Status publish(const HeldFolder& folder, const std::filesystem::path& written, const OutputFile& output);

// Makes names given or removed in the file's folder durable. False on failure. Thread: any.
bool sync_folder_of(const std::filesystem::path& file);

// A temporary file beside an output, filled through opened() or descriptor(); publish() keeps it. Until then it has no
// name wherever the file system allows that: whatever ends the process takes the file along. Thread: any one at a time.
class FileBeside {
 public:
  // Errors: check_output()'s; a folder that takes no file (kBadInput); a full disk (kFailed).
  static Result<FileBeside> create(OutputFile output);
  FileBeside(FileBeside&&) noexcept = default;
  FileBeside& operator=(FileBeside&&) = delete;
  ~FileBeside();

  // Its name until it is given the output's.
  const std::filesystem::path& path() const { return path_; }
  // A path that leads to the file itself, also in a child process, even if path() belongs to another or to none.
  std::filesystem::path opened() const;
  int descriptor() const { return file_.get(); }
  // Appends. Errors: a disk that takes only a part (kFailed).
  Status write(std::string_view content);
  // Call once, after all other users of the file have closed it.
  Status publish();

 private:
  FileBeside(HeldFolder folder, OutputFile output, std::filesystem::path path, UniqueFd file)
      : folder_(std::move(folder)), output_(std::move(output)), path_(std::move(path)), file_(std::move(file)) {}
  int give_name_beside();

  HeldFolder folder_;
  OutputFile output_;
  std::filesystem::path path_;
  UniqueFd file_;  // none after publish()
  bool named_ = false;
};

// Writes a whole file. Errors: FileBeside's; kFailed when the disk takes only a part. Thread: any.
Status write_file(const OutputFile& output, std::string_view content);

}  // namespace bolo
