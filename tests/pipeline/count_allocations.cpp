#include "tests/pipeline/count_allocations.hpp"

#include <dlfcn.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <new>

// The sanitizers own malloc; otherwise glibc's is called by its other name.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BOLO_COUNTS_MALLOC 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define BOLO_COUNTS_MALLOC 0
#endif
#endif
#ifndef BOLO_COUNTS_MALLOC
#define BOLO_COUNTS_MALLOC 1
#endif

namespace {

std::atomic<bool> g_armed{false};
std::atomic<std::uint64_t> g_allocations{0};

std::atomic<std::uint64_t> g_of_libraries{0};

bool of_a_library_of_the_camera(const void* caller) noexcept {
  constexpr std::array<const char*, 4> kLibraries{"/libaravis-", "/libglib-", "/libgobject-", "/libgio-"};
  Dl_info info{};
  if (dladdr(caller, &info) == 0 || info.dli_fname == nullptr) return false;
  for (const char* library : kLibraries) {
    if (std::strstr(info.dli_fname, library) != nullptr) return true;
  }
  return false;
}

void note(const void* caller) noexcept {
  if (!g_armed.load(std::memory_order_relaxed)) return;
  auto& count = of_a_library_of_the_camera(caller) ? g_of_libraries : g_allocations;
  count.fetch_add(1, std::memory_order_relaxed);
}

void* take(std::size_t size, std::size_t alignment, const void* caller) {
  note(caller);
  void* p = nullptr;
  if (posix_memalign(&p, alignment, size < 1 ? 1 : size) != 0) throw std::bad_alloc();
  return p;
}

}  // namespace

namespace bolo::test {

void arm_allocation_count() noexcept { g_armed.store(true); }
void disarm_allocation_count() noexcept { g_armed.store(false); }
std::uint64_t allocation_count() noexcept { return g_allocations.load(); }
std::uint64_t library_allocation_count() noexcept { return g_of_libraries.load(); }
void reset_allocation_count() noexcept {
  g_allocations.store(0);
  g_of_libraries.store(0);
}
bool counts_malloc() noexcept { return BOLO_COUNTS_MALLOC != 0; }

}  // namespace bolo::test

void* operator new(std::size_t size) { return take(size, alignof(std::max_align_t), __builtin_return_address(0)); }
void* operator new[](std::size_t size) { return take(size, alignof(std::max_align_t), __builtin_return_address(0)); }
void* operator new(std::size_t size, std::align_val_t align) {
  return take(size, static_cast<std::size_t>(align), __builtin_return_address(0));
}
void* operator new[](std::size_t size, std::align_val_t align) {
  return take(size, static_cast<std::size_t>(align), __builtin_return_address(0));
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete[](void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
void operator delete[](void* p, std::size_t) noexcept { std::free(p); }
void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }

#if BOLO_COUNTS_MALLOC
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* p, std::size_t size);

void* malloc(std::size_t size) {
  note(__builtin_return_address(0));
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  note(__builtin_return_address(0));
  return __libc_calloc(count, size);
}
void* realloc(void* p, std::size_t size) {
  note(__builtin_return_address(0));
  return __libc_realloc(p, size);
}
}
#endif
