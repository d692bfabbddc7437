#include "tools/bolod/queued_sink.hpp"

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include <spdlog/details/log_msg_buffer.h>

#include "src/rt/thread.hpp"
#include "tools/bolod/journal_sink.hpp"

namespace bolo::daemon {
namespace {

struct Entry {
  spdlog::details::log_msg_buffer message;
  std::optional<pipeline::Notice> notice;
};

// Outlives the sink where its thread is held up.
struct Queue {
  std::shared_ptr<spdlog::sinks::sink> inner;
  std::size_t most = 0;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Entry> waiting;
  std::uint64_t dropped = 0;
  bool started = false;
  bool closing = false;
  bool done = false;
};

void write(spdlog::sinks::sink& to, const Entry& entry) {
  const NoticeOnThisThread notice(entry.notice ? &*entry.notice : nullptr);
  to.log(entry.message);
  to.flush();
}

void log_dropped(spdlog::sinks::sink& to, std::uint64_t dropped) {
  const std::string text = std::to_string(dropped) + " messages were dropped: the log took none";
  to.log(spdlog::details::log_msg("bolod", spdlog::level::warn, text));
  to.flush();
}

// Of the thread.
void write_all(Queue& queue) {
  (void)rt::apply_to_this_thread({.name = "bolo-log"});  // a name alone is never refused
  std::unique_lock lock(queue.mutex);
  for (;;) {
    queue.changed.wait(lock, [&queue] { return queue.closing || !queue.waiting.empty(); });
    std::deque<Entry> entries = std::exchange(queue.waiting, {});
    lock.unlock();
    for (const Entry& entry : entries) write(*queue.inner, entry);
    lock.lock();
    if (!queue.waiting.empty()) continue;
    const std::uint64_t dropped = std::exchange(queue.dropped, 0);
    if (dropped == 0 && queue.closing) break;
    if (dropped == 0) continue;
    lock.unlock();
    log_dropped(*queue.inner, dropped);
    lock.lock();
  }
  queue.done = true;
  queue.changed.notify_all();
}

class QueuedSink final : public spdlog::sinks::sink {
 public:
  QueuedSink(std::shared_ptr<spdlog::sinks::sink> inner, std::size_t most, std::chrono::milliseconds patience)
      : queue_(std::make_shared<Queue>()), patience_(patience) {
    queue_->inner = std::move(inner);
    queue_->most = most;
  }
  ~QueuedSink() override {
    std::unique_lock lock(queue_->mutex);
    if (!queue_->started) return;
    queue_->closing = true;
    queue_->changed.notify_all();
    queue_->changed.wait_for(lock, patience_, [this] { return queue_->done; });
  }
  QueuedSink(const QueuedSink&) = delete;
  QueuedSink& operator=(const QueuedSink&) = delete;

  void log(const spdlog::details::log_msg& message) override {
    const pipeline::Notice* const notice = notice_on_this_thread();
    const std::scoped_lock lock(queue_->mutex);
    if (queue_->waiting.size() >= queue_->most) {
      ++queue_->dropped;
      return;
    }
    queue_->waiting.push_back(
        {spdlog::details::log_msg_buffer(message), notice != nullptr ? std::optional(*notice) : std::nullopt});
    // Not before: what is locked in memory by then has no stack of this thread.
    if (!std::exchange(queue_->started, true)) std::thread([queue = queue_] { write_all(*queue); }).detach();
    queue_->changed.notify_all();
  }
  void flush() override {}
  void set_pattern(const std::string& pattern) override { queue_->inner->set_pattern(pattern); }
  void set_formatter(std::unique_ptr<spdlog::formatter> formatter) override {
    queue_->inner->set_formatter(std::move(formatter));
  }

 private:
  const std::shared_ptr<Queue> queue_;
  const std::chrono::milliseconds patience_;
};

}  // namespace

std::shared_ptr<spdlog::sinks::sink> make_queued_sink(std::shared_ptr<spdlog::sinks::sink> inner, std::size_t most,
                                                      std::chrono::milliseconds patience) {
  return std::make_shared<QueuedSink>(std::move(inner), most, patience);
}

}  // namespace bolo::daemon
