#include "src/core/threads.hpp"

#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <cstdlib>
#include <limits>
#include <new>

namespace bolo {
namespace {

// True if a memory limit refused a thread's stack: pthread_create() reports every refusal by the same error. Other
// threads' stacks may have been freed meanwhile, so room for several is required.
bool no_memory_for_a_stack() {
  constexpr std::size_t kStacks = 8;
  std::size_t bytes = 0;
  pthread_attr_t attributes{};
  if (pthread_getattr_default_np(&attributes) != 0) return false;
  pthread_attr_getstacksize(&attributes, &bytes);
  pthread_attr_destroy(&attributes);
  bytes = std::min(bytes, std::numeric_limits<std::size_t>::max() / kStacks) * kStacks;
  void* const stack = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK, -1, 0);
  if (stack == MAP_FAILED) return true;
  munmap(stack, bytes);
  return false;
}

}  // namespace

std::string describe_exception(const std::exception& e) {
  if (dynamic_cast<const std::bad_alloc*>(&e) != nullptr) return "not enough memory";
  const auto* refused = dynamic_cast<const std::system_error*>(&e);
  if (refused == nullptr || refused->code() != std::errc::resource_unavailable_try_again) return e.what();
  if (no_memory_for_a_stack()) return "no thread can be started: not enough memory for its stack";
  return "no thread can be started: raise 'ulimit -u', or TasksMax= of the systemd unit";
}

[[gnu::noinline]] void grow_stack() {
  constexpr std::size_t kBytes = std::size_t{1} << 20U;
  constexpr std::size_t kPage = 4096;
  rlimit limit{};
  getrlimit(RLIMIT_STACK, &limit);
  const std::size_t bytes = std::min<std::size_t>(kBytes, limit.rlim_cur / 4);
  void* volatile memory = std::malloc(kBytes);  // volatile: otherwise the compiler removes both calls
  std::free(memory);
  if (memory == nullptr) throw std::bad_alloc();
  auto* const block = static_cast<volatile char*>(__builtin_alloca(bytes));
  for (std::size_t i = bytes; i > kPage; i -= kPage) block[i - 1] = 0;
}

}  // namespace bolo
