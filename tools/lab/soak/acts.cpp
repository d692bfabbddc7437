#include <algorithm>
#include <array>
#include <csignal>
#include <fstream>

#include "src/core/clock.hpp"
#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak {
namespace {

constexpr double kEndLimit_s = 20.0;  // for a shared disk and shared processors

// Kinds that consist of a signal to a process at the beginning and another at the end; 0: none.
struct Signals {
  Kind kind;
  int begin;
  int end;
  Process& (*to)(Rig& rig);
};

const Signals* signals_of(Kind kind) {
  constexpr auto camera = [](Rig& rig) -> Process& { return rig.camera(); };
  constexpr auto daemon = [](Rig& rig) -> Process& { return rig.daemon(); };
  constexpr auto reader = [](Rig& rig) -> Process& { return rig.readers().front(); };
  static constexpr std::array<Signals, 5> kAll{{{Kind::kCameraStopped, SIGSTOP, SIGCONT, camera},
                                                {Kind::kDaemonStopped, SIGSTOP, SIGCONT, daemon},
                                                {Kind::kDaemonKilled, SIGKILL, 0, daemon},
                                                {Kind::kReaderKilled, SIGKILL, 0, reader},
                                                {Kind::kReaderStopped, SIGSTOP, SIGCONT, reader}}};
  const auto* const found = std::ranges::find(kAll, kind, &Signals::kind);
  return found == kAll.end() ? nullptr : found;
}

// Describes the first wrong plane; empty: none.
std::string find_wrong_plane(const std::filesystem::path& file, const Truth& truth) {
  const auto reader = capture::CaptureReader::open(file);
  if (!reader) return reader.error().message;
  if (reader->info().frames == 0) return file.filename().string() + ": no frame in it";
  std::vector<std::uint16_t> plane(reader->info().format.geometry.pixels());
  std::vector<std::uint16_t> scratch;
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    const std::string frame = file.filename().string() + ", frame " + std::to_string(i);
    if (const Status read = reader->read_frame(i, plane.data()); !read) return frame + ": " + read.error().message;
    if (!truth.recognise(plane.data(), scratch)) return frame + ": no plane of the camera's";
  }
  return {};
}

// Ends the recorder as its job requires; returns the expected exit code.
int end_recording(Process& recorder, Kind end) {
  if (end == Kind::kDiskFull) return 1;
  const int number = end == Kind::kRecorderKilled ? SIGKILL : SIGINT;
  recorder.signal(number);
  return number == SIGKILL ? 128 + SIGKILL : 0;
}

bool recovered(const std::filesystem::path& bolo, const std::filesystem::path& file, Findings& findings) {
  const std::filesystem::path part = file.string() + ".part";
  const std::filesystem::path log = file.string() + ".recover";
  auto recover = Process::start({{bolo, "recover", part}, log});
  const auto code = recover ? recover->wait(kEndLimit_s) : std::nullopt;
  const bool saved = findings.require(Invariant::kRecordings, code == 0,
                                      "bolo recover of a killed recording: " + contents(log.string() + ".err"));
  for (const char* const end : {"", ".journal", ".live"}) {
    std::error_code ignored;
    std::filesystem::remove(part.string() + end, ignored);
  }
  return saved;
}

constexpr double kFullAfter_s = 0.8;             // of frames that fit on the disk
constexpr std::uint64_t kLeastDisk = 2U << 20U;  // bytes: more than a capture takes before its first frame

// Records, ends the recorder as the disturbance requires, recovers the file of a killed one, and checks every plane.
// `most_bytes`: size of the disk that becomes full. Blocks.
void record_and_judge(const Rig& rig, const Disturbance& d, const std::filesystem::path& file, std::uint64_t most_bytes,
                      Findings& findings) {
  const std::filesystem::path log = file.string() + ".log";
  const std::filesystem::path& bolo = rig.programs().bolo;
  auto recorder = Process::start({{bolo, "record", rig.name(), "-o", file, "--buffer-mb", "32"}, log, most_bytes});
  if (!findings.require(Invariant::kRecordings, recorder.has_value(), recorder ? "" : recorder.error().message)) return;
  std::this_thread::sleep_for(std::chrono::duration<double>(d.for_s));
  const int expected = end_recording(*recorder, d.kind);
  const auto code = recorder->wait(kEndLimit_s);
  const std::string errors = contents(log.string() + ".err");
  const std::string ending = code ? "exit code " + std::to_string(*code) : std::string("no end");
  if (!findings.require(Invariant::kRecordings, code == expected,
                        "bolo record: " + ending + " instead of " + std::to_string(expected) + ": " + errors)) {
    return;
  }
  if (d.kind == Kind::kDiskFull) {
    findings.require(Invariant::kRecordings, errors.find("no room to write") != std::string::npos,
                     "a full disk was called: " + errors);
  }
  if (d.kind == Kind::kRecorderKilled && !recovered(bolo, file, findings)) return;
  const std::string wrong = find_wrong_plane(file, rig.truth());
  findings.require(Invariant::kRecordings, wrong.empty(), wrong);
  std::error_code ignored;
  std::filesystem::remove(file, ignored);
}

// Runs bolo nuc and judges the result. Blocks.
void correct_and_judge(const Programs& programs, const std::string& daemon, const std::filesystem::path& log,
                       Findings& findings) {
  auto command = Process::start({{programs.bolo, "nuc", daemon}, log});
  const auto code = command ? command->wait(kEndLimit_s) : std::nullopt;
  findings.require(Invariant::kCommands, code == 0, "bolo nuc: " + contents(log.string() + ".err"));
}

}  // namespace

void Acts::begin(const Disturbance& d) {
  using enum Kind;
  const Kind kind = d.kind;
  if (const Signals* signals = signals_of(kind)) signals->to(rig_).signal(signals->begin);
  if (kind == kRecording || kind == kRecorderKilled || kind == kDiskFull) record(d);
  if (kind == kCpuTaken || kind == kMemoryTaken) take(kind);
  if (kind == kReload || kind == kBadReload) write_config(kind == kReload);
  if (kind == kCorrection) {
    const std::filesystem::path log = rig_.file("nuc-" + std::to_string(++count_));
    run_beside([this, log] { correct_and_judge(rig_.programs(), rig_.name(), log, findings_); });
  }
}

void Acts::end(const Disturbance& d) {
  using enum Kind;
  const Kind kind = d.kind;
  if (const Signals* signals = signals_of(kind); signals != nullptr && signals->end != 0) {
    signals->to(rig_).signal(signals->end);
  }
  if (kind == kReaderKilled) findings_.done(Invariant::kProcesses, rig_.replace_reader());
  if (kind == kCpuTaken || kind == kMemoryTaken) give_back();
  if (kind == kBadReload) findings_.done(Invariant::kCommands, write_daemon_file(rig_.daemon_file()));
}

void Acts::record(const Disturbance& d) {
  const std::filesystem::path file = rig_.file("recording-" + std::to_string(++count_) + ".h5");
  const DaemonFile& daemon = rig_.daemon_file();
  const double bytes = kFullAfter_s * kRateHz * static_cast<double>(daemon.geometry.pixels() * 2);
  const std::uint64_t most = d.kind == Kind::kDiskFull ? std::max(kLeastDisk, static_cast<std::uint64_t>(bytes)) : 0;
  run_beside([this, d, file, most] { record_and_judge(rig_, d, file, most, findings_); });
}

// Loads the computer by stress-ng.
void Acts::take(Kind kind) {
  Command command{{rig_.programs().stress, "--quiet"}, rig_.file("stress")};
  if (kind == Kind::kCpuTaken) {
    const unsigned all = std::max(1U, std::thread::hardware_concurrency());
    command.words.insert(command.words.end(), {"--cpu", std::to_string(all)});
  } else {
    command.words.insert(command.words.end(), {"--vm", "1", "--vm-bytes", "512M"});
  }
  auto started = Process::start(command);
  if (!findings_.require(Invariant::kProcesses, started.has_value(), started ? "" : started.error().message)) return;
  helper_.emplace(std::move(*started));
}

// In a thread, since the helper may take longer to end than the schedule allows.
void Acts::give_back() {
  if (!helper_) return;
  run_beside([helper = std::make_shared<Process>(std::move(*helper_))] {
    helper->signal(SIGTERM);
    helper->wait(kEndLimit_s);
  });
  helper_.reset();
}

// Makes the daemon reload its file.
void Acts::write_config(bool right) {
  DaemonFile& file = rig_.daemon_file();
  if (right) file.nuc_interval_s += 1.0;
  Status written = write_daemon_file(file);
  if (written && !right) std::ofstream(config_of(file), std::ios::app) << "\n[nuc_]\ninterval_s = 'never'\n";
  findings_.require(Invariant::kCommands, written.has_value(), written ? "" : written.error().message);
  rig_.daemon().signal(SIGHUP);
}

}  // namespace bolo::tools::soak
