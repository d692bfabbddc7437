// Counts the whole program's allocations while armed: operator new and, where no sanitizer owns it, malloc.
// count_allocations.cpp replaces both in the program it is linked into. Thread: any.
#pragma once

#include <cstdint>

namespace bolo::test {

void arm_allocation_count() noexcept;
void disarm_allocation_count() noexcept;

// Allocations so far while armed, without those of Aravis and GLib, which the second counts; reset clears both.
std::uint64_t allocation_count() noexcept;
std::uint64_t library_allocation_count() noexcept;
void reset_allocation_count() noexcept;

// True if malloc is counted outside of operator new.
bool counts_malloc() noexcept;

}  // namespace bolo::test
