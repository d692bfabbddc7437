#include "tools/bolod/log.hpp"

#include <sys/uio.h>

#include <ctime>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>

#include "src/core/printable.hpp"
#include "tools/bolod/journal_sink.hpp"
#include "tools/bolod/queued_sink.hpp"

namespace bolo::daemon {
namespace {

spdlog::level::level_enum spdlog_level(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarning:
      return spdlog::level::warn;
    case LogLevel::kError:
      break;
  }
  return spdlog::level::err;
}

// A message as it may be shown: cameras and files have a say in it.
class PrintableText final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& to) override {
    const std::string text = printable({message.payload.data(), message.payload.size()});
    to.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<PrintableText>(); }
};

spdlog::sink_ptr text_sink() {
  auto sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableText>('*').set_pattern("%Y-%m-%d %H:%M:%S.%e %l: %*");
  sink->set_formatter(std::move(formatter));
  return sink;
}

// Without a journal the sink writes to standard error.
spdlog::sink_ptr journal_sink(const std::string& name) {
  if (journal_listens()) return make_journal_sink(name, send_to_journal);
  return make_journal_sink(name, [](const std::vector<iovec>&) { return -1; });
}

}  // namespace

std::shared_ptr<spdlog::logger> make_log(const LogOptions& options, const std::string& name) {
  const bool journal = options.format == LogFormat::kJournal ||
                       (options.format == LogFormat::kAuto && stderr_is_journal() && journal_listens());
  auto log = std::make_shared<spdlog::logger>("bolod", make_queued_sink(journal ? journal_sink(name) : text_sink()));
  set_level(*log, options.level);
  log->flush_on(spdlog::level::trace);
  return log;
}

void set_level(spdlog::logger& log, LogLevel level) { log.set_level(spdlog_level(level)); }

}  // namespace bolo::daemon
