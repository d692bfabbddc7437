// Messages into systemd's journal, with fields that programs can ask for.
#pragma once

#include <sys/uio.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <spdlog/logger.h>
#include <spdlog/sinks/sink.h>

#include "src/pipeline/notices.hpp"

namespace bolo::daemon {

// Hands the fields of one message on; negative: the journal did not take it. Thread: any.
using SendFields = std::function<int(const std::vector<iovec>& fields)>;

// Standard error is the journal (JOURNAL_STREAM names it), as for a service. Thread: any.
bool stderr_is_journal();

// A journal listens on this computer. Thread: any.
bool journal_listens();

// Writes MESSAGE, PRIORITY, SYSLOG_IDENTIFIER=bolod, BOLO_NAME and, of a notice, BOLO_EVENT and its counts in capitals
// (BOLO_LOST_MISSING=3). What the journal does not take goes to standard error as "<6>message". Thread: any.
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

}  // namespace bolo::daemon
