#include "tools/bolod/journal_sink.hpp"

#include <sys/stat.h>
#include <unistd.h>

#define SD_JOURNAL_SUPPRESS_LOCATION  // where in our code a message comes from is of no use to its reader
#include <systemd/sd-journal.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string_view>
#include <utility>

#include <spdlog/sinks/base_sink.h>

#include "src/core/printable.hpp"

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
    const std::string_view text(message.payload.data(), message.payload.size());
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
    std::fprintf(stderr, "<%c>%s\n", priority(message.level), printable(text).c_str());
  }
  void flush_() override {}

 private:
  const std::string name_;
  const SendFields send_;
};

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

}  // namespace bolo::daemon
