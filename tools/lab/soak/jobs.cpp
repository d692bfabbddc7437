#include "tools/lab/soak/jobs.hpp"

#include <chrono>
#include <csignal>
#include <fstream>
#include <sstream>
#include <thread>

#include "src/capture/capture.hpp"

namespace bolo::tools::soak {
namespace {

constexpr double kEndLimit_s = 20.0;  // for a disk and processors that others use as well

std::string contents(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

void pause(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

// The first plane that is wrong, in words; empty: none.
std::string what_is_wrong(const std::filesystem::path& file, const Truth& truth) {
  const auto reader = capture::CaptureReader::open(file);
  if (!reader) return reader.error().message;
  if (reader->info().frames == 0) return file.filename().string() + ": no frame in it";
  std::vector<std::uint16_t> plane(reader->info().format.geometry.pixels());
  Truth::Scratch scratch;
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    const std::string frame = file.filename().string() + ", frame " + std::to_string(i);
    if (const Status read = reader->read_frame(i, plane.data()); !read) return frame + ": " + read.error().message;
    const auto seen = truth.recognise(plane.data(), scratch);
    if (!seen || seen->manner.swapped || seen->manner.metadata) return frame + ": no plane of the camera's";
  }
  return {};
}

void judge_file(const std::filesystem::path& file, const RecordingJob& job, Findings& findings) {
  const std::string wrong = what_is_wrong(file, *job.truth);
  findings.require(Invariant::kRecordings, wrong.empty(), wrong);
  std::error_code ignored;
  std::filesystem::remove(file, ignored);
}

// Ends it as the job says; what its exit code should be.
int end_recording(Process& recorder, RecordingEnd end) {
  switch (end) {
    case RecordingEnd::kInterrupted:
      recorder.signal(SIGINT);
      return 0;
    case RecordingEnd::kKilled:
      recorder.signal(SIGKILL);
      return 128 + SIGKILL;
    case RecordingEnd::kDiskFull:
      break;
  }
  return 1;
}

bool recovered(const RecordingJob& job, Findings& findings) {
  const std::filesystem::path part = job.file.string() + ".part";
  auto recover = Process::start({{job.programs.bolo, "recover", part}, job.file.string() + ".recover"});
  const auto code = recover ? recover->wait(kEndLimit_s) : std::nullopt;
  const bool saved =
      findings.require(Invariant::kRecordings, code == 0,
                       "bolo recover of a killed recording: " + contents(job.file.string() + ".recover.err"));
  for (const char* const end : {"", ".journal", ".live"}) {
    std::error_code ignored;
    std::filesystem::remove(part.string() + end, ignored);
  }
  return saved;
}

}  // namespace

void record_and_judge(const RecordingJob& job, Findings& findings) {
  const std::filesystem::path log = job.file.string() + ".log";
  auto recorder = Process::start(
      {{job.programs.bolo, "record", job.daemon, "-o", job.file, "--buffer-mb", "32"}, log, job.most_bytes});
  if (!findings.require(Invariant::kRecordings, recorder.has_value(), recorder ? "" : recorder.error().message)) return;
  pause(job.seconds);
  const int expected = end_recording(*recorder, job.end);
  const auto code = recorder->wait(kEndLimit_s);
  const std::string said = contents(log.string() + ".err");
  const std::string ending = code ? "exit code " + std::to_string(*code) : std::string("no end");
  if (!findings.require(Invariant::kRecordings, code == expected,
                        "bolo record: " + ending + " instead of " + std::to_string(expected) + ": " + said)) {
    return;
  }
  if (job.end == RecordingEnd::kDiskFull) {
    findings.require(Invariant::kRecordings, said.find("no room to write") != std::string::npos,
                     "a full disk was called: " + said);
  }
  if (job.end == RecordingEnd::kKilled && !recovered(job, findings)) return;
  judge_file(job.file, job, findings);
}

void correct_and_judge(const Programs& programs, const std::string& daemon, const std::filesystem::path& log,
                       Findings& findings) {
  auto command = Process::start({{programs.bolo, "nuc", daemon}, log});
  const auto code = command ? command->wait(kEndLimit_s) : std::nullopt;
  findings.require(Invariant::kCommands, code == 0, "bolo nuc: " + contents(log.string() + ".err"));
}

void take_processors(double seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  std::vector<std::thread> burners;
  for (unsigned i = 0; i < std::max(1U, std::thread::hardware_concurrency()); ++i) {
    burners.emplace_back([end] {
      while (std::chrono::steady_clock::now() < end) {
        for (volatile int spin = 0; spin < 10'000;) spin = spin + 1;
      }
    });
  }
  for (std::thread& burner : burners) burner.join();
}

void take_memory(double seconds, std::uint64_t bytes) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  std::vector<char> memory(bytes);
  constexpr std::size_t kPage = 4096;
  for (char value = 1; std::chrono::steady_clock::now() < end; ++value) {
    for (std::size_t i = 0; i < memory.size() && std::chrono::steady_clock::now() < end; i += 256 * kPage) {
      for (std::size_t k = i; k < std::min<std::size_t>(i + 256 * kPage, memory.size()); k += kPage) memory[k] = value;
    }
  }
}

}  // namespace bolo::tools::soak
