#include "tools/record/file_writer.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <climits>
#include <cstdio>
#include <fstream>
#include <limits>
#include <string_view>
#include <system_error>
#include <utility>

#include "src/capture/crash_safe_file.hpp"
#include "src/core/clock.hpp"
#include "src/core/threads.hpp"
#include "src/rt/thread.hpp"

namespace bolo::tools {
namespace {

constexpr std::int64_t kIdle_ns = 100'000'000;
// Most that a kill may lose.
constexpr std::int64_t kCommitAfter_ns = 150'000'000;
constexpr std::size_t kFewestSlots = 16;

std::size_t slots_for(const FileWriterOptions& options) {
  const StreamFormat& format = options.info.format;
  const std::size_t motion = options.motion ? motion_blocks(format.geometry).pixels() * sizeof(BlockMotion) : 0;
  return std::max(kFewestSlots, options.buffer_bytes / (plane_bytes(format.geometry, format.type) + motion));
}

bool is_taken(const std::filesystem::path& file) {
  std::error_code ignored;
  return std::ranges::any_of(std::array{"", ".part", ".part.journal", ".part.live"}, [&](const char* suffix) {
    return std::filesystem::exists(std::filesystem::symlink_status(file.string() + suffix, ignored));
  });
}

// Attributes for the time, host and program version of a recording.
std::vector<capture::Attribute> origin() {
  std::array<char, HOST_NAME_MAX + 1> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
  return {{"recorded_at", utc_text(realtime_ns())},
          {"host_name", std::string(host.data())},
          {"bolo_version", std::string(BOLO_VERSION)}};
}

// Above its memory limit the kernel kills the process without a message.
void warn_of_limit(const FileWriterOptions& options) {
  constexpr std::uint64_t kOtherBytes = std::uint64_t{8} << 20U;  // 5 MB without the buffer, and a reserve for the file
  const std::uint64_t limit = memory_limit();
  if (limit >= kOtherBytes && limit - kOtherBytes >= options.buffer_bytes) return;
  options.log("the buffer takes " + std::to_string(options.buffer_bytes >> 20U) +
              " MB, and this service or container may have " + std::to_string(limit >> 20U) +
              " MB in all: make it smaller with --buffer-mb, or the kernel ends the recording");
}

double seconds_of(std::int64_t ns) { return static_cast<double>(ns) / kNsPerSecond; }

}  // namespace

std::uint64_t memory_limit(const std::filesystem::path& tree, const std::filesystem::path& own) {
  constexpr std::string_view kVersion2 = "0::/";
  std::uint64_t least = std::numeric_limits<std::uint64_t>::max();
  std::ifstream groups(own);
  for (std::string line; std::getline(groups, line);) {
    if (!line.starts_with(kVersion2)) continue;
    std::filesystem::path group = tree;
    for (const std::filesystem::path& part : std::filesystem::path("/") / line.substr(kVersion2.size())) {
      if (part != "/") group /= part;
      std::uint64_t limit = 0;
      if (std::ifstream(group / "memory.max") >> limit) least = std::min(least, limit);  // "max" does not parse
    }
  }
  return least;
}

std::filesystem::path file_of_part(const FileWriterOptions& options, std::size_t index) {
  if (options.split_s <= 0.0) return options.file;
  std::array<char, 16> number{};
  std::snprintf(number.data(), number.size(), "_%03zu", index + 1);
  std::filesystem::path name = options.file.stem();
  name += number.data();
  name += options.file.extension();
  return options.file.parent_path() / name;
}

Status check_first_file(const FileWriterOptions& options) {
  const std::filesystem::path file = file_of_part(options, 0);
  if (Status good = check_output({file, options.replace}); !good) return good;
  if (options.replace == Replace::kExisting) return {};
  const std::string part = file.string() + ".part";
  return at(part, capture::check_unfinished(part));
}

FileWriter::FileWriter(FileWriterOptions options)
    : options_(std::move(options)),
      pool_(options_.info.format, slots_for(options_)),
      blocks_(options_.motion ? motion_blocks(options_.info.format.geometry).pixels() : 0),
      motion_(pool_.size() * blocks_),
      queue_(pool_.size()) {}

Result<std::unique_ptr<FileWriter>> FileWriter::start(FileWriterOptions options) {
  std::unique_ptr<FileWriter> writer;
  warn_of_limit(options);
  try {
    writer.reset(new FileWriter(std::move(options)));
  } catch (const std::bad_alloc&) {
    return bad_input("not enough memory for the buffer; make it smaller with --buffer-mb");
  }
  RETURN_IF_ERROR(writer->open_next());
  writer->last_commit_ns_ = monotonic_ns();
  try {
    writer->thread_ = std::thread([self = writer.get()] { self->run(); });
  } catch (const std::system_error& e) {
    return failed("nothing can be recorded: " + describe_exception(e));
  }
  return writer;
}

FileWriter::~FileWriter() {
  if (thread_.joinable()) finish();
}

void FileWriter::put(rt::FrameSlot& slot, std::uint32_t marks, double period_s) noexcept {
  queue_.try_push({slot.index, marks, period_s});  // never full: it has room for every slot
}

FileWriterResult FileWriter::finish() {
  ending_.store(true, std::memory_order_release);  // partner: the load in run()
  queue_.wake();
  thread_.join();
  return std::move(result_);
}

// An existing file's number is skipped, so that no frame is lost.
Status FileWriter::open_next() {
  std::size_t part = next_part_;
  auto created = create(part);
  while (!created && part > 0 && is_taken(file_of_part(options_, part))) created = create(++part);
  if (!created) return tl::unexpected<Error>(created.error());
  current_ = file_of_part(options_, part);
  if (part != next_part_) {
    options_.log(file_of_part(options_, next_part_).string() + " is there already, and stays: going on with " +
                 current_.filename().string());
  }
  capture_.emplace(std::move(*created));
  next_part_ = part + 1;
  frames_in_file_ = 0;
  if (Status good = capture_->write_attributes(origin()); !good) return good;
  return capture_->write_attributes(options_.attributes);
}

Result<capture::CaptureWriter> FileWriter::create(std::size_t part) const {
  capture::WriterOptions how;
  how.survives_power_cut = true;
  how.replace = options_.replace;
  how.motion = options_.motion;
  how.times = true;
  return capture::CaptureWriter::create(file_of_part(options_, part), options_.info, how);
}

// A file without frames is no capture: it is discarded.
Status FileWriter::close_current() {
  if (!capture_) return {};
  Status good;
  if (frames_in_file_ == 0) {
    capture_->discard();
  } else if (good = capture_->complete(); good) {
    const auto close = [capture = std::make_shared<capture::CaptureWriter>(std::move(*capture_))] {
      return tried([&] { return capture->close(); });
    };
    // If no thread can be started, take_closed() closes the file on this one.
    closing_.push_back({current_, std::async(close)});
  } else {
    result_.parts.emplace_back(current_.string() + ".part");
  }
  capture_.reset();
  return good;
}

// Records the outcome of files closed so far, or of all if `wait`.
void FileWriter::take_closed(bool wait) {
  while (!closing_.empty()) {
    Closing& oldest = closing_.front();
    if (!wait && oldest.outcome.wait_for(std::chrono::seconds(0)) == std::future_status::timeout) return;
    Status good = oldest.outcome.get();
    std::filesystem::path part = oldest.file.string() + ".part";
    std::error_code ignored;
    if (good || !std::filesystem::exists(part, ignored)) {  // renamed to its final name, whatever failed afterwards
      result_.files.push_back(std::move(oldest.file));
    } else {
      result_.parts.push_back(std::move(part));
    }
    if (!good && result_.status) result_.status = std::move(good);  // later frames go to files of their own
    closing_.pop_front();
  }
}

void FileWriter::run() noexcept {
  (void)rt::apply_to_this_thread({.name = "bolo-record"});  // setting only a name never fails
  for (Item item{};;) {
    const bool ending = ending_.load(std::memory_order_acquire);  // partner: the store in finish()
    if (queue_.pop_wait(item, ending ? 0 : kIdle_ns)) {
      rt::FrameSlot& slot = pool_.slot(item.slot);
      write(slot, item);
      pool_.give_back(slot);
    } else if (ending) {
      break;
    } else {
      commit_if_idle();
    }
  }
  if (Status good = tried([this] { return close_current(); }); !good) fail(std::move(good));
  const Status taken = tried([this] {
    take_closed(true);
    return Status{};
  });
  if (!taken) fail(taken);
}

void FileWriter::write(rt::FrameSlot& slot, const Item& item) {
  if (broken()) {
    ++result_.unwritten;
    return;
  }
  const std::int64_t begin_ns = monotonic_ns();
  Status good = tried([&] { return append(slot, item); });
  result_.longest_write_ms =
      std::max(result_.longest_write_ms, static_cast<double>(monotonic_ns() - begin_ns) * kMsPerNs);
  if (good) {
    written_.store(++result_.frames, std::memory_order_relaxed);
    return;
  }
  ++result_.unwritten;
  fail(std::move(good));
}

Status FileWriter::append(const rt::FrameSlot& slot, const Item& item) {
  const double t_s = seconds_of(slot.meta.camera_ns);
  const double half_s = 0.5 * options_.info.format.frame_period_s;
  if (options_.split_s > 0.0 && frames_in_file_ > 0 && t_s - file_begin_s_ + half_s >= options_.split_s) {
    if (Status good = close_current(); !good) return good;
    if (Status good = open_next(); !good) return good;
    take_closed(false);
  }
  if (std::exchange(options_.info.format.frame_period_s, item.period_s) != item.period_s) {
    if (Status good = capture_->state_period(item.period_s); !good) return good;
  }
  for (const auto& [mark, kind] :
       {std::pair{kMarkReconnect, "reconnect"}, {kMarkGap, "gap"}, {kMarkNuc, "nuc"}, {kMarkClockStep, "clock_step"}}) {
    if ((item.marks & mark) == 0) continue;
    if (Status good = capture_->add_event({t_s, kind}); !good) return good;
  }
  const BlockMotion* motion = (item.marks & kMarkMotion) != 0 ? motion_of(slot) : nullptr;
  const capture::FrameTimes times{seconds_of(host_time_ns(slot.meta)), seconds_of(slot.meta.utc_ns),
                                  seconds_of(slot.meta.utc_uncertainty_ns)};
  if (Status good = capture_->append(t_s, slot.meta.frame_id, slot.data, nullptr, motion, &times); !good) return good;
  if (frames_in_file_++ == 0) file_begin_s_ = t_s;
  if (result_.frames == 0) result_.first_t_s = t_s;
  result_.last_t_s = t_s;
  result_.bytes += pool_.plane_bytes() + blocks_ * sizeof(BlockMotion);
  if (const std::int64_t now_ns = monotonic_ns(); now_ns - last_commit_ns_ >= kCommitAfter_ns) {
    last_commit_ns_ = now_ns;
    return capture_->commit();
  }
  return {};
}

// Frames before a pause of the stream are committed without waiting for its end.
void FileWriter::commit_if_idle() {
  if (broken() || monotonic_ns() - last_commit_ns_ < kCommitAfter_ns) return;
  last_commit_ns_ = monotonic_ns();
  if (Status good = tried([this] { return capture_->commit(); }); !good) fail(std::move(good));
}

// Reports the first failure only; frames already appended remain, and their file is closed properly.
void FileWriter::fail(Status status) {
  if (result_.status) result_.status = std::move(status);
  broken_.store(true, std::memory_order_relaxed);
}

}  // namespace bolo::tools
