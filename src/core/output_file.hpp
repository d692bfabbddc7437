// One rule for every file that a program of ours writes: no output is an input, nothing that exists is replaced without
// the user's leave, and a file gets its name only when it is whole and on the disk. So neither a kill nor a full disk
// costs a file that was there before.
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

// The folder of outputs, made where it is not there. Errors: kBadInput. Thread: any.
Status make_folder(const std::filesystem::path& folder);

// The same of a verb that may still be refused: in the end, folders that were made and have nothing in them are gone.
// Thread: any one at a time.
class OutputFolder {
 public:
  static Result<OutputFolder> make(const std::filesystem::path& folder);
  OutputFolder(OutputFolder&&) noexcept = default;
  OutputFolder& operator=(OutputFolder&&) = delete;
  ~OutputFolder();

 private:
  OutputFolder() = default;
  std::vector<std::filesystem::path> made_;  // the innermost first
};

// Nothing stands in the way of `output`: it is a name in a folder that takes files, no folder or device has it, nor a
// link to one, and no file that is not to be replaced. Errors: kBadInput. Thread: any.
Status check_output(const OutputFile& output);

// The folder of a file, held open: what others put in the place of the folder meanwhile, a link to another one for
// instance, gets nothing and loses nothing. Thread: any.
class HeldFolder {
 public:
  HeldFolder() = default;
  explicit HeldFolder(const std::filesystem::path& file);
  // The file, or one beside it, in the held folder. Its name as given where the folder or /proc is not there.
  std::filesystem::path place_of(const std::filesystem::path& file) const;
  // False once another folder, or none, has the name.
  bool is_folder_of(const std::filesystem::path& file) const;

 private:
  UniqueFd folder_;
};

// For a verb, before any work: each output may be written, is none of the inputs (by inode, so through links too) and
// none of the others; neither is what is written meanwhile under an output's name and ".part", and beside it. Empty
// names are passed over. Errors: kBadInput. Thread: any.
Status check_outputs(const std::vector<std::filesystem::path>& outputs,
                     const std::vector<std::filesystem::path>& inputs, Replace replace);

// Gives `written` (closed, in the same folder, which is `folder`) the name of `output` once it is on the disk. A name
// that was taken meanwhile is left alone unless it may be replaced: `written` then stays, whole, with an error, as it
// does where the folder is another one now. Thread: any.
Status publish(const HeldFolder& folder, const std::filesystem::path& written, const OutputFile& output);

// Makes names durable that were given or taken in the file's folder. False on failure. Thread: any.
bool sync_folder_of(const std::filesystem::path& file);

// A file beside an output, to be filled through its name or its descriptor. Without publish() it is gone at the end.
// Thread: any one at a time.
class FileBeside {
 public:
  // Errors: check_output()'s; a folder that takes no file (kBadInput); a full disk (kFailed).
  static Result<FileBeside> create(OutputFile output);
  FileBeside(FileBeside&&) noexcept = default;
  FileBeside& operator=(FileBeside&&) = delete;
  ~FileBeside();

  const std::filesystem::path& path() const { return path_; }
  // For those who open it by a name: it leads to the file itself, also in a child, whatever has path() by then.
  std::filesystem::path opened() const;
  int descriptor() const { return file_.get(); }
  // Appends. Errors: a disk that takes only a part (kFailed).
  Status write(std::string_view content);
  // Once; all other users of the file have closed it.
  Status publish();

 private:
  FileBeside(HeldFolder folder, OutputFile output, std::filesystem::path path, UniqueFd file)
      : folder_(std::move(folder)), output_(std::move(output)), path_(std::move(path)), file_(std::move(file)) {}

  HeldFolder folder_;
  OutputFile output_;
  std::filesystem::path path_;
  UniqueFd file_;  // none once it was published
};

// A whole file at once. Errors as of FileBeside; kFailed when the disk takes only a part. Thread: any.
Status write_file(const OutputFile& output, std::string_view content);

}  // namespace bolo
