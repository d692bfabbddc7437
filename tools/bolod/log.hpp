// The log: messages to standard error or systemd's journal, written by a separate thread.
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

// Creates a logger that writes one line or journal entry per message on its own thread: callers never wait. `name`: of
// the daemon, a field in the journal. Thread: setup; the logger: any, but never the hot path.
std::shared_ptr<spdlog::logger> make_log(const LogOptions& options, const std::string& name);

// --- systemd's journal: messages with structured fields ---

// Sends the fields of one message; negative: refused by the journal. Thread: any.
using SendFields = std::function<int(const std::vector<iovec>& fields)>;

// True if standard error is the journal (JOURNAL_STREAM), as for a service. Thread: any.
bool stderr_is_journal();

// True if a journal listens on this computer. Thread: any.
bool journal_listens();

// Writes MESSAGE, PRIORITY, SYSLOG_IDENTIFIER=bolod, BOLO_NAME and, for a notice, BOLO_EVENT and its counts in capitals
// (BOLO_LOST_MISSING=3). Messages refused by the journal go to standard error as "<6>message". Thread: any.
std::shared_ptr<spdlog::sinks::sink> make_journal_sink(std::string name, SendFields send);

// sd_journal_sendv(3). Thread: any.
int send_to_journal(const std::vector<iovec>& fields);

// While it lives, `notice` (null: none) goes with this thread's messages, as spdlog carries text only. Thread: any.
class NoticeOnThisThread {
 public:
  explicit NoticeOnThisThread(const pipeline::Notice* notice);
  ~NoticeOnThisThread();
  NoticeOnThisThread(const NoticeOnThisThread&) = delete;
  NoticeOnThisThread& operator=(const NoticeOnThisThread&) = delete;
};
// Null: none.
const pipeline::Notice* notice_on_this_thread();

// Logs a notice; sinks with fields also write its event and counts. Thread: any.
void log_notice(spdlog::logger& log, spdlog::level::level_enum level, const pipeline::Notice& notice);

// --- Queue: a blocked journal, terminal or pipe never blocks a caller ---

// Passes messages, each with its notice from log_notice(), to `inner` on a thread started by the first message. Logging
// never waits. More than `most` pending messages are dropped; their number is logged once `inner` accepts messages
// again. The destructor waits for pending ones for at most `patience`. Thread: any.
std::shared_ptr<spdlog::sinks::sink> make_queued_sink(std::shared_ptr<spdlog::sinks::sink> inner,
                                                      std::size_t most = 1000,
                                                      std::chrono::milliseconds patience = std::chrono::seconds(1));

// Writes to standard error without stdio, whose lock a thread blocked there (on a pipe that nobody reads) would hold,
// and which the program's exit needs. What is not accepted within patience_ms is dropped; -1: waits. Thread: any.
void write_to_stderr(std::string_view text, int patience_ms);

}  // namespace bolo::daemon
