#include "drivers/genicam/aravis_limits.hpp"

#include <dlfcn.h>
#include <gio/gio.h>
#ifdef __x86_64__
#include <ucontext.h>
#endif

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <span>

#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"

namespace bolo::genicam {
namespace {

constexpr std::int64_t kSearchNs = 3000 * kNsPerMs;  // cameras answer within one second
constexpr std::int64_t kBusyMs = 5000;               // maximum waiting time that a camera may request, per:
constexpr std::int64_t kBusyWithinMs = 30'000;

thread_local std::int64_t search_until_ns = 0;  // 0: no search
thread_local std::int64_t busy_until_ms = -kBusyWithinMs;

// `packet`: as received. A PENDING_ACK beyond the remaining time becomes a reply to no command, which Aravis ignores.
void shorten_pending(std::span<std::uint8_t> packet) {
  constexpr std::size_t kCommandAt = 2;
  constexpr std::uint16_t kPendingAck = 0x0089;
  constexpr std::size_t kTimeAt = 8;  // ms
  if (packet.size() < kTimeAt + 4 || load_u16(packet, kCommandAt) != kPendingAck) return;
  const std::int64_t now_ms = monotonic_ns() / kNsPerMs;
  if (now_ms > busy_until_ms + kBusyWithinMs - kBusyMs) busy_until_ms = now_ms + kBusyMs;
  const std::int64_t left_ms = std::min<std::int64_t>(load_u32(packet, kTimeAt), busy_until_ms - now_ms);
  if (left_ms <= 0) return store_u16(packet, kCommandAt, 0);
  store_u32(packet, kTimeAt, static_cast<std::uint32_t>(left_ms));
}

#ifdef __x86_64__
struct sigaction g_before {};

// The dividend is in RDX and RAX; the division is repeated after the handler returns.
void on_fault(int /*signal*/, siginfo_t* /*info*/, void* context) {
  auto& registers = static_cast<ucontext_t*>(context)->uc_mcontext.gregs;
  if (registers[REG_RAX] == INT64_MIN && registers[REG_RDX] == -1) {
    registers[REG_RAX] = registers[REG_RDX] = 0;
  } else {
    sigaction(SIGFPE, &g_before, nullptr);
  }
}

bool take_faults() noexcept {
  struct sigaction action {};
  action.sa_sigaction = on_fault;
  action.sa_flags = SA_SIGINFO;
  return sigaction(SIGFPE, &action, &g_before) == 0;
}
#endif

}  // namespace

SearchLimit::SearchLimit() noexcept { search_until_ns = monotonic_ns() + kSearchNs; }
SearchLimit::~SearchLimit() { search_until_ns = 0; }

void survive_division_of_smallest() noexcept {
#ifdef __x86_64__
  [[maybe_unused]] static const bool installed = take_faults();
#endif
}

}  // namespace bolo::genicam

// Replacements of GLib functions, for Aravis.
extern "C" gint g_poll(GPollFD* descriptors, guint count, gint timeout_ms) {
  static const auto original = reinterpret_cast<decltype(&g_poll)>(dlsym(RTLD_NEXT, __func__));
  using namespace bolo;
  if (genicam::search_until_ns != 0 && monotonic_ns() > genicam::search_until_ns) return 0;
  return original(descriptors, count, timeout_ms);
}

extern "C" gssize g_socket_receive(GSocket* socket, gchar* buffer, gsize size, GCancellable* cancellable,
                                   GError** error) {
  static const auto original = reinterpret_cast<decltype(&g_socket_receive)>(dlsym(RTLD_NEXT, __func__));
  const gssize bytes = original(socket, buffer, size, cancellable, error);
  if (bytes > 0) {
    bolo::genicam::shorten_pending({reinterpret_cast<std::uint8_t*>(buffer), static_cast<std::size_t>(bytes)});
  }
  return bytes;
}
