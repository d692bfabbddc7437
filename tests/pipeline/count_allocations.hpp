// Counts what the whole program allocates while armed: operator new and, where no sanitizer owns it, malloc. Linked
// into a test program, count_allocations.cpp replaces both. Thread: any.
#pragma once

#include <cstdint>

namespace bolo::test {

void arm_allocation_count() noexcept;
void disarm_allocation_count() noexcept;

// Counted so far while armed, but for what Aravis and GLib take for themselves, which is the second; reset sets both to
// zero.
std::uint64_t allocation_count() noexcept;
std::uint64_t library_allocation_count() noexcept;
void reset_allocation_count() noexcept;

// True if a malloc outside operator new is counted.
bool counts_malloc() noexcept;

}  // namespace bolo::test
