#include "tools/bolod/log.hpp"

#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#define SD_JOURNAL_SUPPRESS_LOCATION  // source locations are useless to the reader
#include <systemd/sd-journal.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <mutex>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include <spdlog/details/log_msg_buffer.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>

#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/rt/thread.hpp"

namespace bolo::daemon {
namespace {

constexpr const char* kJournalSocket = "/run/systemd/journal/socket";

// Fields of the message that this thread is logging; spdlog carries text only.
thread_local const pipeline::Notice* current_notice = nullptr;

char priority(spdlog::level::level_enum level) {
  if (level >= spdlog::level::err) return '3';
  if (level == spdlog::level::warn) return '4';
  return level == spdlog::level::info ? '6' : '7';
}

std::string field(std::string_view name, std::string_view value) {
  std::string text(name);
  return text.append("=").append(value);
}

// "lost_missing" is BOLO_LOST_MISSING.
std::string count_field(const std::pair<std::string, std::uint64_t>& count) {
  std::string name = "BOLO_" + count.first;
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::toupper(letter)); });
  return field(name, std::to_string(count.second));
}

class JournalSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  JournalSink(std::string name, SendFields send) : name_(std::move(name)), send_(std::move(send)) {}

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    const std::string text = message_line({message.payload.data(), message.payload.size()});
    std::vector<std::string> fields{field("MESSAGE", text), std::string("PRIORITY=") + priority(message.level),
                                    "SYSLOG_IDENTIFIER=bolod", field("BOLO_NAME", name_)};
    if (current_notice != nullptr) {
      if (!current_notice->event.empty()) fields.push_back(field("BOLO_EVENT", current_notice->event));
      for (const auto& count : current_notice->counts) fields.push_back(count_field(count));
    }
    std::vector<iovec> vectors;
    vectors.reserve(fields.size());
    for (std::string& one : fields) vectors.push_back({one.data(), one.size()});
    if (send_(vectors) >= 0) return;
    write_to_stderr(std::string("<") + priority(message.level) + ">" + text + "\n", -1);
  }
  void flush_() override {}

 private:
  const std::string name_;
  const SendFields send_;
};

struct Entry {
  spdlog::details::log_msg_buffer message;
  std::optional<pipeline::Notice> notice;
};

// Outlives the sink if its thread is blocked.
struct Queue {
  std::shared_ptr<spdlog::sinks::sink> inner;
  std::size_t most = 0;
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<Entry> waiting;
  std::uint64_t dropped = 0;
  bool started = false;
  bool closing = false;
  bool done = false;
};

void log_entry(spdlog::sinks::sink& to, const Entry& entry) {
  const NoticeOnThisThread notice(entry.notice ? &*entry.notice : nullptr);
  to.log(entry.message);
  to.flush();
}

void log_dropped(spdlog::sinks::sink& to, std::uint64_t dropped) {
  const std::string text = std::to_string(dropped) + " messages were dropped: the log took none";
  to.log(spdlog::details::log_msg("bolod", spdlog::level::warn, text));
  to.flush();
}

void write_all(Queue& queue) {
  (void)rt::apply_to_this_thread({.name = "bolo-log"});  // setting only a name cannot fail
  std::unique_lock lock(queue.mutex);
  for (;;) {
    queue.changed.wait(lock, [&queue] { return queue.closing || !queue.waiting.empty(); });
    const std::vector<Entry> entries = std::exchange(queue.waiting, {});
    lock.unlock();
    const auto untold = std::ranges::count_if(
        entries, [&queue](const Entry& entry) { return !attempt([&] { log_entry(*queue.inner, entry); }); });
    lock.lock();
    queue.dropped += static_cast<std::uint64_t>(untold);
    if (!queue.waiting.empty()) continue;
    const std::uint64_t dropped = std::exchange(queue.dropped, 0);
    if (dropped == 0 && queue.closing) break;
    if (dropped == 0) continue;
    lock.unlock();
    attempt([&] { log_dropped(*queue.inner, dropped); });
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
    if (!queue_->started) start();
    queue_->changed.notify_all();
  }
  void flush() override {}
  void set_pattern(const std::string& pattern) override { queue_->inner->set_pattern(pattern); }
  void set_formatter(std::unique_ptr<spdlog::formatter> formatter) override {
    queue_->inner->set_formatter(std::move(formatter));
  }

 private:
  // Started by the first message, not before: mlockall() has then locked the memory without this thread's stack. If no
  // thread is available, the caller writes.
  void start() {
    try {
      std::thread([queue = queue_] { write_all(*queue); }).detach();
      queue_->started = true;
    } catch (const std::system_error&) {
      for (const Entry& entry : std::exchange(queue_->waiting, {})) log_entry(*queue_->inner, entry);
    }
  }

  const std::shared_ptr<Queue> queue_;
  const std::chrono::milliseconds patience_;
};

// The message made printable: cameras and files contribute text.
class PrintableText final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& to) override {
    const std::string text = message_line({message.payload.data(), message.payload.size()});
    to.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<PrintableText>(); }
};

class TextSink final : public spdlog::sinks::base_sink<std::mutex> {
 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t text;
    formatter_->format(message, text);
    write_to_stderr({text.data(), text.size()}, -1);
  }
  void flush_() override {}
};

spdlog::sink_ptr text_sink() {
  auto sink = std::make_shared<TextSink>();
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableText>('*').set_pattern("%Y-%m-%d %H:%M:%S.%e %l: %*");
  sink->set_formatter(std::move(formatter));
  return sink;
}

// Without a journal, the sink writes to standard error.
spdlog::sink_ptr journal_sink(const std::string& name) {
  if (journal_listens()) return make_journal_sink(name, send_to_journal);
  return make_journal_sink(name, [](const std::vector<iovec>&) { return -1; });
}

}  // namespace

bool stderr_is_journal() {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat there {};
  if (stream == nullptr || fstat(STDERR_FILENO, &there) != 0) return false;
  return stream == std::to_string(there.st_dev) + ":" + std::to_string(there.st_ino);
}

bool journal_listens() {
  struct stat there {};
  return stat(kJournalSocket, &there) == 0 && S_ISSOCK(there.st_mode);
}

std::shared_ptr<spdlog::sinks::sink> make_journal_sink(std::string name, SendFields send) {
  return std::make_shared<JournalSink>(std::move(name), std::move(send));
}

int send_to_journal(const std::vector<iovec>& fields) {
  return sd_journal_sendv(fields.data(), static_cast<int>(fields.size()));
}

NoticeOnThisThread::NoticeOnThisThread(const pipeline::Notice* notice) { current_notice = notice; }
NoticeOnThisThread::~NoticeOnThisThread() { current_notice = nullptr; }

const pipeline::Notice* notice_on_this_thread() { return current_notice; }

void log_notice(spdlog::logger& log, spdlog::level::level_enum level, const pipeline::Notice& notice) {
  const NoticeOnThisThread current(&notice);
  log.log(level, notice.text);
}

std::shared_ptr<spdlog::sinks::sink> make_queued_sink(std::shared_ptr<spdlog::sinks::sink> inner, std::size_t most,
                                                      std::chrono::milliseconds patience) {
  return std::make_shared<QueuedSink>(std::move(inner), most, patience);
}

std::shared_ptr<spdlog::logger> make_log(const LogOptions& options, const std::string& name) {
  const bool journal = options.format == LogFormat::kJournal ||
                       (options.format == LogFormat::kAuto && stderr_is_journal() && journal_listens());
  auto log = std::make_shared<spdlog::logger>("bolod", make_queued_sink(journal ? journal_sink(name) : text_sink()));
  log->set_level(options.level);
  log->flush_on(spdlog::level::trace);
  return log;
}

void write_to_stderr(std::string_view text, int patience_ms) {
  pollfd event{STDERR_FILENO, POLLOUT, 0};
  while (!text.empty()) {
    const int ready = poll(&event, 1, patience_ms);
    if (ready == 0) return;
    // A writable pipe accepts PIPE_BUF bytes without blocking.
    const ssize_t done =
        ready < 0 ? -1 : ::write(STDERR_FILENO, text.data(), std::min<std::size_t>(text.size(), PIPE_BUF));
    if (done < 0 && errno != EINTR) return;
    if (done > 0) text.remove_prefix(static_cast<std::size_t>(done));
  }
}

}  // namespace bolo::daemon
