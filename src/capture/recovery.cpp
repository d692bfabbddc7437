#include "src/capture/recovery.hpp"

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>

#include "src/capture/capture.hpp"
#include "src/capture/commit_records.hpp"
#include "src/capture/power_commit.hpp"

namespace bolo::capture {
namespace {

// As the file promises where it keeps its promise, else what can be found in it.
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

// One frame after the other; what cannot be read is passed over, and said by a "gap" at the next one.
class FrameCopy {
 public:
  FrameCopy(const CaptureReader& reader, CaptureWriter& writer, Recovered& done)
      : reader_(reader),
        writer_(writer),
        done_(done),
        plane_(plane_bytes(reader.info().format.geometry, reader.info().format.type)),
        truth_(reader.info().has_truth ? reader.info().format.geometry.pixels() : 0) {}

  Status copy(std::size_t i) {
    const bool readable =
        reader_.read_frame(i, plane_.data()) && (truth_.empty() || reader_.read_truth(i, truth_.data()));
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
    return writer_.append(t_s, reader_.frame_id()[i], plane_.data(), truth_.empty() ? nullptr : truth_.data());
  }

 private:
  const CaptureReader& reader_;
  CaptureWriter& writer_;
  Recovered& done_;
  std::vector<std::byte> plane_;
  std::vector<float> truth_;
  bool after_gap_ = false;
};

tl::unexpected<Error> nothing_readable(const std::filesystem::path& file) {
  return bad_input(file.string() + ": none of its frames can be read");
}

Result<Recovered> write_copy(const std::filesystem::path& damaged, const std::filesystem::path& out,
                             const std::function<bool(std::uint64_t, std::uint64_t)>& progress) {
  Recovered done;
  const Result<CaptureReader> reader = open_damaged(damaged, done.remarks);
  if (!reader) return tl::unexpected<Error>(reader.error());
  WriterOptions options;
  options.truth = reader->info().has_truth;
  Result<CaptureWriter> writer = CaptureWriter::create(out, reader->info(), options);
  if (!writer) return tl::unexpected<Error>(writer.error());
  Status good = copy_extras(*reader, *writer);
  for (std::size_t i = 0; good && i < reader->events().size(); ++i) good = writer->add_event(reader->events()[i]);
  FrameCopy frames(*reader, *writer, done);
  for (std::size_t i = 0; good && i < reader->info().frames; ++i) {
    good = frames.copy(i);
    if (good && progress && !progress(i + 1, reader->info().frames)) good = failed(out.string() + ": interrupted");
  }
  if (good && done.frames == 0) good = nothing_readable(damaged);
  if (good) good = writer->close();
  if (!good) return tl::unexpected<Error>(good.error());
  done.remarks.insert(done.remarks.end(), reader->warnings().begin(), reader->warnings().end());
  return done;
}

// Beside `out` and not under its name: the ".part" of that name may be the damaged file.
std::filesystem::path copy_name(const std::filesystem::path& out) {
  return out.parent_path() / (out.stem().string() + ".recovering" + out.extension().string());
}

}  // namespace

Result<Recovered> recover_copy(const std::filesystem::path& damaged, const std::filesystem::path& out,
                               const std::function<bool(std::uint64_t, std::uint64_t)>& progress) {
  const std::filesystem::path copy = copy_name(out);
  Result<Recovered> done = write_copy(damaged, copy, progress);
  std::error_code error;
  if (done) {
    std::filesystem::rename(copy, out, error);
    if (error) return failed(copy.string() + ": cannot be renamed to " + out.string() + ": " + error.message());
  } else {
    std::filesystem::remove(copy.string() + ".part", error);
    remove_records(copy.string() + ".part");
  }
  return done;
}

Result<Recovered> recover_in_place(const std::filesystem::path& part, const std::filesystem::path& out) {
  Recovered done;
  {
    const Result<CaptureReader> reader = CaptureReader::open(part);
    if (!reader) return tl::unexpected<Error>(reader.error());
    if (!reader->warnings().empty()) {
      return bad_input(part.string() + ": " + reader->warnings().front() + "; recover it to another file");
    }
    done.frames = reader->info().frames;
    done.first_t_s = reader->t().front();
    done.last_t_s = reader->t().back();
  }
  if (!settle(part)) {
    const std::string why = errno == EWOULDBLOCK ? "another program has it open" : std::strerror(errno);
    return failed(part.string() + ": cannot be finished: " + why);
  }
  std::error_code error;
  std::filesystem::rename(part, out, error);
  if (error) return failed(part.string() + ": cannot be renamed to " + out.string() + ": " + error.message());
  sync_folder_of(out);
  remove_records(part);
  return done;
}

}  // namespace bolo::capture
