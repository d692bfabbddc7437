#include "src/capture/capture.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstring>

#include "src/capture/commit_records.hpp"
#include "src/core/threads.hpp"

namespace bolo::capture {
namespace {

Result<CaptureReader> open_damaged(const std::filesystem::path& file, std::vector<std::string>& remarks) {
  Result<CaptureReader> reader = CaptureReader::open(file);
  if (reader) return reader;
  Result<CaptureReader> salvaged = CaptureReader::salvage(file);
  if (!salvaged) return reader;
  remarks.push_back(reader.error().message);
  return salvaged;
}

Status copy_extras(const CaptureReader& reader, CaptureWriter& writer) {
  if (const auto attributes = reader.attributes()) {
    if (Status good = writer.write_attributes(*attributes); !good) return good;
  }
  if (const auto points = reader.points(); points && !points->empty()) {
    if (Status good = writer.write_points(*points); !good) return good;
  }
  const Result<Stimulus> stimulus = reader.stimulus();
  return stimulus ? writer.write_stimulus(*stimulus) : Status{};
}

// Copies frame by frame; unreadable frames are skipped and marked by a "gap" event at the next one.
class FrameCopy {
 public:
  FrameCopy(const CaptureReader& reader, CaptureWriter& writer, Recovered& done)
      : reader_(reader),
        writer_(writer),
        done_(done),
        plane_(plane_bytes(reader.info().format.geometry, reader.info().format.type)),
        truth_(reader.info().has_truth ? reader.info().format.geometry.pixels() : 0),
        motion_(reader.info().has_motion ? motion_blocks(reader.info().format.geometry).pixels() : 0) {}

  Status copy(std::size_t i) {
    const bool readable = reader_.read_frame(i, plane_.data()) &&
                          (truth_.empty() || reader_.read_truth(i, truth_.data())) &&
                          (motion_.empty() || reader_.read_motion(i, motion_.data()));
    if (!readable) {
      ++done_.unreadable;
      after_gap_ = true;
      return {};
    }
    const double t_s = reader_.t()[i];
    if (after_gap_ && done_.frames > 0) {
      if (Status good = writer_.add_event({t_s, "gap"}); !good) return good;
    }
    after_gap_ = false;
    if (done_.frames++ == 0) done_.first_t_s = t_s;
    done_.last_t_s = t_s;
    const std::optional<FrameTimes> times = times_of(reader_, i);
    return writer_.append(t_s, reader_.frame_id()[i], plane_.data(), truth_.empty() ? nullptr : truth_.data(),
                          motion_.empty() ? nullptr : motion_.data(), times ? &*times : nullptr);
  }

 private:
  const CaptureReader& reader_;
  CaptureWriter& writer_;
  Recovered& done_;
  std::vector<std::byte> plane_;
  std::vector<float> truth_;
  std::vector<BlockMotion> motion_;
  bool after_gap_ = false;
};

// Of a recording that was moved without what belongs to it; empty where its journal is there.
std::string without_journal(const std::filesystem::path& damaged) {
  const std::filesystem::path journal = journal_of(damaged);
  std::error_code ignored;
  if (damaged.extension() != ".part" || std::filesystem::exists(journal, ignored)) return {};
  return journal.string() + " is not there: if the recording was moved, move its .journal and .live beside it, too";
}

// Adds that to what is wrong with the recording.
template <typename T>
Result<T> explained(Result<T> answer, const std::filesystem::path& damaged) {
  const std::string why = without_journal(damaged);
  if (!answer && answer.error().kind == ErrorKind::kBadInput && !why.empty()) answer.error().message += "; " + why;
  return answer;
}

tl::unexpected<Error> nothing_readable(const std::filesystem::path& file) {
  return bad_input(file.string() + ": none of its frames can be read");
}

Result<Recovered> write_copy(const std::filesystem::path& damaged, const std::filesystem::path& out,
                             const std::function<bool(std::uint64_t, std::uint64_t)>& progress) {
  Recovered done;
  ASSIGN_OR_RETURN(const CaptureReader reader, explained(open_damaged(damaged, done.remarks), damaged));
  WriterOptions options;
  options.truth = reader.info().has_truth;
  options.motion = reader.info().has_motion;
  options.times = reader.info().has_times;
  ASSIGN_OR_RETURN(CaptureWriter writer, CaptureWriter::create(out, reader.info(), options));
  RETURN_IF_ERROR(copy_extras(reader, writer));
  for (const Event& event : reader.events()) RETURN_IF_ERROR(writer.add_event(event));
  FrameCopy frames(reader, writer, done);
  for (std::size_t i = 0; i < reader.info().frames; ++i) {
    RETURN_IF_ERROR(frames.copy(i));
    if (progress && !progress(i + 1, reader.info().frames)) return failed(out.string() + ": interrupted");
  }
  if (done.frames == 0) return explained<Recovered>(nothing_readable(damaged), damaged);
  RETURN_IF_ERROR(writer.close());
  done.remarks.insert(done.remarks.end(), reader.warnings().begin(), reader.warnings().end());
  const std::string why = without_journal(damaged);
  if (!done.remarks.empty() && !why.empty()) done.remarks.push_back(why);
  return done;
}

// Beside `out`, not under its name, because that name's ".part" may be the damaged file. With this process's id, so
// that another one's leftovers are not in the way.
std::filesystem::path copy_name(const std::filesystem::path& out) {
  const std::string process = std::to_string(::getpid());
  return out.parent_path() / (out.stem().string() + ".recovering-" + process + out.extension().string());
}

}  // namespace

Result<Recovered> recover_copy(const std::filesystem::path& damaged, const OutputFile& out,
                               const std::function<bool(std::uint64_t, std::uint64_t)>& progress) {
  const HeldFolder folder(out.path);
  RETURN_IF_ERROR(check_output(out));
  const std::filesystem::path copy = copy_name(out.path);
  Result<Recovered> done = tried([&] { return write_copy(damaged, copy, progress); });
  if (!done) {
    std::error_code ignored;
    const std::filesystem::path part = folder.place_of(copy.string() + ".part");
    std::filesystem::remove(part, ignored);
    remove_records(part);
    return done;
  }
  RETURN_IF_ERROR(publish(folder, copy, out));
  return done;
}

Result<Recovered> recover_in_place(const std::filesystem::path& part, const OutputFile& out) {
  const HeldFolder folder(part);
  const std::filesystem::path held = folder.place_of(part);
  RETURN_IF_ERROR(check_output(out));
  std::error_code ignored;
  if (std::filesystem::is_symlink(held, ignored)) {
    return bad_input(part.string() + ": is a link; finish the file that it stands for, or save it to another one");
  }
  for (const auto& written : {part, journal_of(part), live_of(part)}) {
    if (has_one_name(folder.place_of(written))) continue;
    return bad_input(written.string() + ": is a link, has another name too, or is no file; recover to another file");
  }
  Recovered done;
  {
    ASSIGN_OR_RETURN(const CaptureReader reader, explained(CaptureReader::open(part), part));
    if (!reader.warnings().empty()) {
      return explained<Recovered>(
          bad_input(part.string() + ": " + reader.warnings().front() + "; recover it to another file"), part);
    }
    done.frames = reader.info().frames;
    done.first_t_s = reader.t().front();
    done.last_t_s = reader.t().back();
  }
  if (!apply_records(held)) {
    const std::string why = errno == EWOULDBLOCK ? "another program has it open" : std::strerror(errno);
    return failed(part.string() + ": cannot be finished: " + why);
  }
  RETURN_IF_ERROR(publish(folder, part, out));
  remove_records(held);
  return done;
}

}  // namespace bolo::capture
