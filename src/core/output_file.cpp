#include "src/core/output_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstring>
#include <optional>
#include <set>
#include <system_error>

namespace bolo {
namespace {

namespace fs = std::filesystem;

constexpr int kMostNames = 1000;
constexpr std::size_t kMostLetters = NAME_MAX - (sizeof ".new-4194304-999" - 1);  // room for a suffix

fs::path folder_of(const fs::path& file) { return file.has_parent_path() ? file.parent_path() : fs::path("."); }

// Path of an open descriptor of this process, usable by its children too.
fs::path own_descriptor(int descriptor) {
  return fs::path("/proc") / std::to_string(::getpid()) / "fd" / std::to_string(descriptor);
}

// Device and inode: the same through every name and link. Nothing if there is no such file.
using FileId = std::pair<dev_t, ino_t>;
std::optional<FileId> id_of(const fs::path& file) {
  struct stat info {};
  if (::stat(file.c_str(), &info) != 0) return std::nullopt;
  return FileId{info.st_dev, info.st_ino};
}

bool is_one_of(const std::set<FileId>& files, const fs::path& file) {
  const auto id = id_of(file);
  return id && files.contains(*id);
}

// True if the name may be replaced: a file, or a link to one. Replacing any other link would lose it: to a folder, a
// device, or a file that a process has open (/dev/stdout).
bool is_file(const fs::path& there) {
  std::error_code error;
  const fs::file_status status = fs::status(there, error);
  if (fs::exists(status) && !fs::is_regular_file(status)) return false;
  return !fs::read_symlink(there, error).native().starts_with("/proc/");
}

// Bad input if another name would help, otherwise a failure.
tl::unexpected<Error> not_written(const fs::path& file, int error) {
  const std::string line = file.string() + ": cannot be written: " + std::strerror(error);
  for (const int place : {ENOENT, ENOTDIR, EACCES, EPERM, EROFS, ENAMETOOLONG, ELOOP, EISDIR, EINVAL}) {
    if (error == place) return bad_input(line + "; choose another place");
  }
  return failed(line);
}

// Some file systems and folders cannot be flushed (EINVAL): not an error.
bool flush(int descriptor) { return descriptor >= 0 && (::fsync(descriptor) == 0 || errno == EINVAL); }

// Fallback for network file systems without RENAME_NOREPLACE: a hard link, which replaces nothing either.
int rename_to_free_name(const fs::path& from, const fs::path& to) {
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS) return errno;
  if (::link(from.c_str(), to.c_str()) != 0) return errno;
  return ::unlink(from.c_str()) == 0 ? 0 : errno;
}

// A private file stays private when it is replaced.
void keep_private(int written, const fs::path& replaced) {
  struct stat before {};
  struct stat now {};
  if (::lstat(replaced.c_str(), &before) != 0 || !S_ISREG(before.st_mode) || ::fstat(written, &now) != 0) return;
  ::fchmod(written, now.st_mode & before.st_mode & (S_IRWXU | S_IRWXG | S_IRWXO));
}

// 0, or an errno; EEXIST: the name was taken meanwhile.
int give_name(const HeldFolder& folder, const fs::path& written, const OutputFile& output) {
  const fs::path from = folder.place_of(written);
  const fs::path to = folder.place_of(output.path);
  const UniqueFd file(::open(from.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (output.replace == Replace::kExisting) keep_private(file.get(), to);
  if (!flush(file.get())) return errno;
  if (!folder.is_folder_of(output.path)) return ENOENT;
  int error = 0;
  if (output.replace == Replace::kNothing) {
    error = rename_to_free_name(from, to);
  } else if (::rename(from.c_str(), to.c_str()) != 0) {
    error = errno;
  }
  if (error == 0) sync_folder_of(to);
  return error;
}

fs::path beside(const fs::path& output, int number) {
  return output.string() + ".new-" + std::to_string(::getpid()) + "-" + std::to_string(number);
}

// A file in the folder that has no name yet; none if the file system does not know such files, or if it could not be
// written and named by the path of its descriptor.
UniqueFd nameless_file(const HeldFolder& folder, const fs::path& output) {
  UniqueFd file(::open(folder_of(folder.place_of(output)).c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666));
  return file && ::access(own_descriptor(file.get()).c_str(), F_OK) == 0 ? std::move(file) : UniqueFd();
}

Status to_status(int error, const fs::path& written, const OutputFile& output) {
  if (error == EEXIST) {
    return failed(output.path.string() +
                  " was made by another program meanwhile and stays; what was written is whole in " + written.string());
  }
  if (error == 0) return {};
  return failed(output.path.string() + ": cannot be made from " + written.string() + ": " + std::strerror(error));
}

}  // namespace

Status make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error) return {};
  return bad_input(folder.string() + ": cannot be made a folder: " + error.message() + "; choose another");
}

Result<OutputFolder> OutputFolder::make(const fs::path& folder) {
  OutputFolder out;
  std::error_code error;
  const auto is_missing = [&](const fs::path& at) { return fs::status(at, error).type() == fs::file_type::not_found; };
  for (fs::path at = folder; !at.empty() && is_missing(at); at = at.parent_path()) out.made_.push_back(at);
  RETURN_IF_ERROR(make_folder(folder));
  return out;
}

OutputFolder::~OutputFolder() {
  for (const fs::path& folder : made_) ::rmdir(folder.c_str());  // fails unless it is empty
}

HeldFolder::HeldFolder(const fs::path& file)
    : folder_(::open(folder_of(file).c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC)) {
  if (::access(place_of(".").c_str(), F_OK) != 0) folder_ = UniqueFd();
}

fs::path HeldFolder::place_of(const fs::path& file) const {
  return folder_ ? own_descriptor(folder_.get()) / file.filename() : file;
}

bool HeldFolder::is_folder_of(const fs::path& file) const {
  struct stat held {};
  struct stat named {};
  if (!folder_ || ::fstat(folder_.get(), &held) != 0) return true;
  if (::stat(folder_of(file).c_str(), &named) != 0) return errno != ENOENT && errno != ENOTDIR;
  return held.st_dev == named.st_dev && held.st_ino == named.st_ino;
}

Status check_output(const OutputFile& output) {
  const std::string name = output.path.string();
  if (!output.path.has_filename()) return bad_input("'" + name + "': is no name of a file; give one");
  if (::faccessat(AT_FDCWD, (folder_of(output.path) / ".").c_str(), W_OK | X_OK, AT_EACCESS) != 0) {
    return not_written(output.path, errno);
  }
  if (output.path.filename().native().size() > kMostLetters) return not_written(output.path, ENAMETOOLONG);
  std::error_code error;
  const fs::file_status there = fs::symlink_status(output.path, error);
  if (!fs::status_known(there) || !fs::exists(there)) return {};
  if (!is_file(output.path)) return bad_input(name + ": is not a file; nothing can be written there");
  if (output.replace == Replace::kExisting) return {};
  return bad_input(name + " is there already; choose another name, or --overwrite it");
}

Status check_outputs(const std::vector<fs::path>& outputs, const std::vector<fs::path>& inputs, Replace replace) {
  std::set<FileId> read;
  for (const fs::path& input : inputs) {
    if (const auto id = id_of(input)) read.insert(*id);
  }
  std::set<std::pair<std::optional<FileId>, std::string>> names;  // with the folder of each
  for (const fs::path& output : outputs) {
    if (output.empty()) continue;
    const std::string name = output.string();
    if (is_one_of(read, output)) return bad_input(name + ": is both read and written; choose another name");
    for (const char* ending : {".part", ".part.journal", ".part.live"}) {
      std::string meanwhile = name + ending;
      if (is_one_of(read, meanwhile)) {
        return bad_input(
            meanwhile.append(": is read, and written while ").append(name).append(" is made; choose another name"));
      }
    }
    if (!names.emplace(id_of(folder_of(output)), output.filename()).second) {
      return bad_input(name + ": would be written twice; choose another name");
    }
    if (Status good = check_output({output, replace}); !good) return good;
  }
  return {};
}

bool sync_folder_of(const fs::path& file) {
  const UniqueFd folder(::open(folder_of(file).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  return flush(folder.get());
}

Status publish(const HeldFolder& folder, const fs::path& written, const OutputFile& output) {
  return to_status(give_name(folder, written, output), written, output);
}

Result<FileBeside> FileBeside::create(OutputFile output) {
  HeldFolder folder(output.path);
  RETURN_IF_ERROR(check_output(output));
  UniqueFd file = nameless_file(folder, output.path);
  fs::path path = beside(output.path, 0);
  FileBeside made(std::move(folder), std::move(output), std::move(path), std::move(file));
  const int error = made.file_ ? 0 : made.give_name_beside();
  if (error != 0) return not_written(made.output_.path, error);
  return made;
}

FileBeside::~FileBeside() {
  if (file_ && named_) ::unlink(folder_.place_of(path_).c_str());
}

// Links the file, or creates it if there is none. 0, or an errno.
int FileBeside::give_name_beside() {
  for (int i = 0; i < kMostNames; ++i) {
    path_ = beside(output_.path, i);
    const fs::path place = folder_.place_of(path_);
    if (file_) {
      named_ = ::linkat(AT_FDCWD, own_descriptor(file_.get()).c_str(), AT_FDCWD, place.c_str(), AT_SYMLINK_FOLLOW) == 0;
    } else {
      file_ = UniqueFd(::open(place.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
      named_ = static_cast<bool>(file_);
    }
    if (named_) return 0;
    if (errno != EEXIST) break;
  }
  return errno;
}

fs::path FileBeside::opened() const {
  fs::path name = own_descriptor(file_.get());
  return ::access(name.c_str(), F_OK) == 0 ? name : path_;
}

Status FileBeside::publish() {
  if (!named_) {
    const int unnamed = flush(file_.get()) ? give_name_beside() : errno;
    if (unnamed != 0) return failed(output_.path.string() + ": cannot be written: " + std::strerror(unnamed));
  }
  const int error = give_name(folder_, path_, output_);
  if (error == 0 || error == EEXIST) file_ = UniqueFd();  // complete, and kept
  return to_status(error, path_, output_);
}

Status FileBeside::write(std::string_view content) {
  while (!content.empty()) {
    const ssize_t done = ::write(file_.get(), content.data(), content.size());
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) return failed(output_.path.string() + ": cannot be written: " + std::strerror(errno));
    content.remove_prefix(static_cast<std::size_t>(done));
  }
  return {};
}

Status write_file(const OutputFile& output, std::string_view content) {
  ASSIGN_OR_RETURN(FileBeside file, FileBeside::create(output));
  if (Status good = file.write(content); !good) return good;
  return file.publish();
}

}  // namespace bolo
