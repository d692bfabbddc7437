// Preloaded into a daemon: while the file BOLO_REFUSE exists, one allocation in BOLO_REFUSE_EVERY fails. While the file
// BOLO_HANG exists, the disk of the configuration hangs.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <new>
#include <string_view>

void* operator new(std::size_t bytes) {
  static std::atomic<unsigned> calls{0};
  static const char* const when = std::getenv("BOLO_REFUSE");
  static const char* const every = std::getenv("BOLO_REFUSE_EVERY");
  const bool refuses = when != nullptr && access(when, F_OK) == 0;
  if (refuses && calls++ % static_cast<unsigned>(std::atoi(every)) == 0) throw std::bad_alloc();
  void* const memory = std::malloc(bytes != 0 ? bytes : 1);
  return memory != nullptr ? memory : throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

extern "C" int stat(const char* path, struct stat* info) noexcept {
  static const char* const when = std::getenv("BOLO_HANG");
  while (std::string_view(path).ends_with(".toml") && when != nullptr && access(when, F_OK) == 0) usleep(10'000);
  return fstatat(AT_FDCWD, path, info, 0);
}
