// Preloaded into a daemon: leaks the smallest possible allocation 200 times a second, like one leak per frame.
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <thread>

namespace {

constexpr std::size_t kBytes = 24;

[[gnu::constructor]] void lose() {
  std::thread([] {
    for (;;) {
      void* volatile lost = std::malloc(kBytes);
      std::memset(lost, 1, kBytes);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }).detach();
}

}  // namespace
