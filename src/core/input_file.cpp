#include "src/core/input_file.hpp"

#include <fcntl.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/vfs.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace bolo {
namespace {

constexpr std::size_t kPiece = std::size_t{1} << 16U;

const char* kind_of(mode_t mode) {
  if (S_ISDIR(mode)) return "a folder";
  if (S_ISFIFO(mode)) return "a pipe";
  if (S_ISSOCK(mode)) return "a socket";
  return "a device";
}

tl::unexpected<Error> unreadable(const std::filesystem::path& file, int error) {
  return bad_input(file.string() + ": cannot be opened for reading: " + std::strerror(error));
}

tl::unexpected<Error> no_file(const std::filesystem::path& file, mode_t mode) {
  return bad_input(file.string() + ": is " + kind_of(mode) + ", not a file");
}

std::string describe_size(std::uint64_t bytes) {
  const bool large = bytes >= std::uint64_t{1} << 20U;
  return std::to_string(bytes >> (large ? 20U : 10U)) + (large ? " MiB" : " KiB");
}

}  // namespace

bool is_kernels_file(const std::filesystem::path& file) {
  struct statfs system {};
  if (::statfs(file.c_str(), &system) != 0) return false;
  return system.f_type == PROC_SUPER_MAGIC || system.f_type == TRACEFS_MAGIC || system.f_type == DEBUGFS_MAGIC;
}

Result<UniqueFd> open_input(const std::filesystem::path& file) {
  // Checked before opening, because opening can affect a device. O_NONBLOCK: a pipe put there meanwhile does not block.
  struct stat info {};
  if (::stat(file.c_str(), &info) == 0 && !S_ISREG(info.st_mode)) return no_file(file, info.st_mode);
  if (is_kernels_file(file)) return bad_input(file.string() + ": is made by the kernel, not a file");
  UniqueFd opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
  if (!opened || ::fstat(opened.get(), &info) != 0) return unreadable(file, errno);
  if (!S_ISREG(info.st_mode)) return no_file(file, info.st_mode);
  return opened;
}

Result<std::ifstream> stream_input(const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(const UniqueFd opened, open_input(file));
  // Opens the file that was checked, even if its name now belongs to another.
  std::ifstream stream("/proc/self/fd/" + std::to_string(opened.get()), std::ios::binary);
  if (!stream) return unreadable(file, errno);
  return stream;
}

Result<std::string> read_input(const std::filesystem::path& file, std::uint64_t most_bytes) {
  ASSIGN_OR_RETURN(const UniqueFd opened, open_input(file));
  std::string text;
  std::array<char, kPiece> piece{};
  for (;;) {
    const ssize_t got = ::read(opened.get(), piece.data(), piece.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return bad_input(file.string() + ": cannot be read: " + std::strerror(errno));
    if (got == 0) return text;
    text.append(piece.data(), static_cast<std::size_t>(got));
    if (text.size() > most_bytes) {
      return bad_input(file.string() + ": is larger than the " + describe_size(most_bytes) + " that it may be");
    }
  }
}

std::string first_line(const std::filesystem::path& file) {
  std::string line;
  std::ifstream in(file);
  std::getline(in, line);
  return line;
}

}  // namespace bolo
