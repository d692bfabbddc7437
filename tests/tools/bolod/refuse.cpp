// Preloaded into a daemon: while the file BOLO_REFUSE is there, one allocation in three is refused, but for the main
// thread, which may end the daemon with a line.
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <new>

void* operator new(std::size_t bytes) {
  static std::atomic<unsigned> calls{0};
  static const char* const when = std::getenv("BOLO_REFUSE");
  const bool refuses = gettid() != getpid() && when != nullptr && access(when, F_OK) == 0;
  if (refuses && calls++ % 3 == 0) throw std::bad_alloc();
  void* const memory = std::malloc(bytes != 0 ? bytes : 1);
  return memory != nullptr ? memory : throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
