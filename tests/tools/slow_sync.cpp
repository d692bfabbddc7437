// Preloaded: makes each sync slow, as on SD cards and eMMC. BOLO_SLOW_SYNC_MS: shortest and longest time in ms, e.g.
// "700,1500".
#include <dlfcn.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <thread>

namespace {

void take_time() {
  int least_ms = 0;
  int most_ms = 0;
  const char* text = std::getenv("BOLO_SLOW_SYNC_MS");
  if (text == nullptr || std::sscanf(text, "%d,%d", &least_ms, &most_ms) != 2) return;
  thread_local std::mt19937 random(std::random_device{}());
  const int ms = std::uniform_int_distribution<int>(least_ms, most_ms)(random);
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

int after_a_while(const char* sync, int descriptor) {
  take_time();
  return reinterpret_cast<int (*)(int)>(dlsym(RTLD_NEXT, sync))(descriptor);
}

}  // namespace

extern "C" int fsync(int descriptor) { return after_a_while("fsync", descriptor); }
extern "C" int fdatasync(int descriptor) { return after_a_while("fdatasync", descriptor); }
