#include "drivers/genicam/division_trap.hpp"

#ifdef __x86_64__
#include <ucontext.h>

#include <csignal>
#include <cstdint>
#endif

namespace bolo::genicam {

#ifdef __x86_64__

namespace {

struct sigaction g_before {};

// The dividend is in RDX and RAX, and the division is done again after this.
void on_fault(int /*signal*/, siginfo_t* /*info*/, void* context) {
  auto& registers = static_cast<ucontext_t*>(context)->uc_mcontext.gregs;
  if (registers[REG_RAX] == INT64_MIN && registers[REG_RDX] == -1) {
    registers[REG_RAX] = registers[REG_RDX] = 0;
  } else {
    sigaction(SIGFPE, &g_before, nullptr);
  }
}

bool install() noexcept {
  struct sigaction action {};
  action.sa_sigaction = on_fault;
  action.sa_flags = SA_SIGINFO;
  return sigaction(SIGFPE, &action, &g_before) == 0;
}

}  // namespace

void survive_division_of_smallest() noexcept { [[maybe_unused]] static const bool installed = install(); }

#else

void survive_division_of_smallest() noexcept {}

#endif

}  // namespace bolo::genicam
