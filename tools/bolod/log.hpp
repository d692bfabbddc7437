// The log: messages on standard error or in systemd's journal, written by a thread of their own.
#pragma once

#include <sys/uio.h>

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <spdlog/logger.h>
#include <spdlog/sinks/sink.h>

#include "src/pipeline/notices.hpp"
#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// A logger that writes one line or one entry of the journal a message, on a thread of its own: callers never wait.
// `name`: of the daemon, a field in the journal. Thread: setup; the logger: any, but never the hot path.
std::shared_ptr<spdlog::logger> make_log(const LogOptions& options, const std::string& name);

// --- systemd's journal: messages with fields that programs can ask for ---

// Hands the fields of one message on; negative: the journal did not take it. Thread: any.
using SendFields = std::function<int(const std::vector<iovec>& fields)>;

// Standard error is the journal (JOURNAL_STREAM names it), as for a service. Thread: any.
bool stderr_is_journal();

// A journal listens on this computer. Thread: any.
bool journal_listens();

// Writes MESSAGE, PRIORITY, SYSLOG_IDENTIFIER=bolod, BOLO_NAME and, of a notice, BOLO_EVENT and its counts in capitals
// (BOLO_LOST_MISSING=3). Messages refused by the journal go to standard error as "<6>message". Thread: any.
std::shared_ptr<spdlog::sinks::sink> make_journal_sink(std::string name, SendFields send);

// sd_journal_sendv(3). Thread: any.
int send_to_journal(const std::vector<iovec>& fields);

// While it lives, the notice, or none, is what this thread logs. spdlog itself carries text only. Thread: any.
class NoticeOnThisThread {
 public:
  explicit NoticeOnThisThread(const pipeline::Notice* notice);
  ~NoticeOnThisThread();
  NoticeOnThisThread(const NoticeOnThisThread&) = delete;
  NoticeOnThisThread& operator=(const NoticeOnThisThread&) = delete;
};
// Null: none.
const pipeline::Notice* notice_on_this_thread();

// Logs a notice; sinks that know fields write its event and counts, too. Thread: any.
void log_notice(spdlog::logger& log, spdlog::level::level_enum level, const pipeline::Notice& notice);

// --- the queue: a journal, terminal or pipe that takes nothing keeps nobody waiting ---

// Hands messages, each with the notice that log_notice() is logging, to `inner` on a thread that the first one starts.
// Logging never waits. Beyond `most` that wait they are dropped, and their number is logged once `inner` takes messages
// again. Its end waits for what is left, but not longer than `patience`. Thread: any.
std::shared_ptr<spdlog::sinks::sink> make_queued_sink(std::shared_ptr<spdlog::sinks::sink> inner,
                                                      std::size_t most = 1000,
                                                      std::chrono::milliseconds patience = std::chrono::seconds(1));

// Onto standard error past stdio, whose lock a thread that hangs there (a pipe that nobody reads) would hold: the end
// of the program takes that lock. What standard error does not take in time is dropped; -1: it is waited for. Thread:
// any.
void write_to_stderr(std::string_view text, int patience_ms);

}  // namespace bolo::daemon
