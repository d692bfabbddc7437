// `bolo record`: records a running daemon's frames to a capture file.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <cxxopts.hpp>
#include <nlohmann/json.hpp>

#include "drivers/shm/shm_object.hpp"
#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/process.hpp"
#include "tools/record/recording.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRecordVerb = "record";
constexpr auto kPoll = std::chrono::milliseconds(50);

struct Recorder {
  std::string name;
  Process process;
  LineTail errors;
};

Status check_names(const std::vector<std::string>& names) {
  std::set<std::string> seen;
  for (const std::string& name : names) {
    RETURN_IF_ERROR(shm::object_path(name));
    if (!seen.insert(name).second) return bad_input("'" + name + "' is named twice");
  }
  return {};
}

Result<fs::path> folder_of(const cxxopts::ParseResult& parsed) {
  if (parsed.count("output") == 0) return bad_input("where to? usage: bolo record NAME NAME... -o FOLDER");
  fs::path folder = parsed["output"].as<std::string>();
  std::error_code error;
  if (folder.extension() == ".h5" && !fs::is_directory(folder, error)) {
    return bad_input(folder.string() + ": several cameras are recorded into a folder, this is a file's name");
  }
  return folder;
}

std::vector<std::string> common_options(const cxxopts::ParseResult& parsed) {
  std::vector<std::string> words;
  for (const cxxopts::KeyValue& option : parsed.arguments()) {
    if (option.key() == "name" || option.key() == "output") continue;
    words.push_back("--" + option.key() + "=" + option.value());
  }
  return words;
}

Result<std::vector<Recorder>> start(const std::vector<std::string>& names, const std::vector<std::string>& common,
                                    const fs::path& folder, const fs::path& logs) {
  std::vector<Recorder> recorders;
  const std::string program = fs::read_symlink("/proc/self/exe").string();
  for (const std::string& name : names) {
    Command command;
    command.words = {program, kRecordVerb, name, "-o", (folder / (name + ".h5")).string()};
    command.words.insert(command.words.end(), common.begin(), common.end());
    command.log = logs / name;
    ASSIGN_OR_RETURN(auto process, Process::start(command));
    recorders.push_back({name, std::move(process), LineTail(command.log.string() + ".err")});
  }
  return recorders;
}

void show_errors(Recorder& recorder) {
  for (const std::string& line : recorder.errors.take()) {
    if (!line.starts_with("recording")) std::fprintf(stderr, "%s: %s\n", recorder.name.c_str(), line.c_str());
  }
}

// Waits until all have ended. Forwards an interrupt, upon which each completes its file.
int wait_for(std::vector<Recorder>& recorders) {
  bool signalled = false;
  for (bool running = true; running;) {
    std::this_thread::sleep_for(kPoll);
    if (interrupted() && !std::exchange(signalled, true)) {
      for (const Recorder& recorder : recorders) recorder.process.signal(SIGTERM);
    }
    running = false;
    for (Recorder& recorder : recorders) {
      show_errors(recorder);
      running = !recorder.process.ended() || running;
    }
  }
  int worst = kExitDone;
  for (Recorder& recorder : recorders) {
    show_errors(recorder);
    std::ifstream output(recorder.process.log().string() + ".out");
    for (std::string line; std::getline(output, line);) std::printf("%s\n", line.c_str());
    worst = std::max(worst, *recorder.process.ended());
  }
  return worst > kExitUsage ? kExitFailed : worst;
}

// Runs a `bolo record` process for each name with the other options into the folder of --output, so that none waits for
// another's disk or daemon. Returns the worst exit code. Thread: setup.
Result<int> record_several(const cxxopts::ParseResult& parsed) {
  const std::vector<std::string> names = names_of(parsed, "name");
  RETURN_IF_ERROR(check_names(names));
  ASSIGN_OR_RETURN(const fs::path folder, folder_of(parsed));
  ASSIGN_OR_RETURN(const auto made, OutputFolder::make(folder));
  ASSIGN_OR_RETURN(const auto logs, ScratchFolder::make());
  ASSIGN_OR_RETURN(auto recorders, start(names, common_options(parsed), folder, logs.path()));
  return wait_for(recorders);
}

constexpr double kMostSeconds = 1e8;
constexpr std::size_t kMostBuffer_mb = std::size_t{64} * 1024;

cxxopts::Options record_options() {
  cxxopts::Options options("bolo record",
                           "Record a running daemon's frames. A kill or a power cut loses only the last fraction of a "
                           "second; see bolo recover.\n");
  options.positional_help("NAME...").show_positional_help();
  add_option<std::vector<std::string>>(options, "name",
                                       "Daemon's name, as in its configuration; several are recorded in parallel");
  add_option<std::string>(options, "o,output",
                          "Capture to write (.h5); of several daemons the folder, for FOLDER/NAME.h5");
  add_option<double>(options, "seconds", "Duration from the first frame on, s");
  add_option<std::uint64_t>(options, "frames", "Number of frames");
  add_option<std::string>(options, "planes", "Planes to record: raw or deblurred", "raw");
  add_option<double>(options, "split-minutes", "Start a new file at this interval, min: FILE_001.h5 ...");
  add_option<std::size_t>(options, "buffer-mb", "Memory for frames that wait for the disk, MB", "256");
  add_option<double>(options, "wait",
                     "Seconds to wait for a lost daemon, or with --seconds for its first frame; if given, also for a "
                     "daemon to start",
                     "30");
  add_option<bool>(options, "json", "Print the outcome as JSON");
  add_overwrite_option(options);
  options.parse_positional({"name"});
  return options;
}

bool in_range(double value, double low, double high) { return value >= low && value <= high; }

Result<RecordRequest> record_request(const cxxopts::ParseResult& parsed) {
  if (parsed.count("name") == 0) return bad_input("which daemon? usage: bolo record NAME -o FILE.h5");
  if (parsed.count("output") == 0) return bad_input("where to? usage: bolo record NAME -o FILE.h5");
  RecordRequest request;
  request.name = names_of(parsed, "name").front();
  FileWriterOptions& writer = request.writer;
  writer.file = parsed["output"].as<std::string>();
  if (writer.file.extension() != ".h5") {
    return bad_input(writer.file.string() + ": a capture is written, and its name ends in .h5");
  }
  if (parsed.count("frames") != 0) {
    request.frames = parsed["frames"].as<std::uint64_t>();
    if (request.frames == 0) return bad_input("--frames must be at least 1");
  }
  const auto seconds_of = [&](const char* name, double unit_s, double least, double& out) -> Status {
    if (parsed.count(name) == 0) return {};
    out = parsed[name].as<double>() * unit_s;
    if (in_range(out, least, kMostSeconds)) return {};
    return bad_input(std::string("--") + name + " must be a number above 0");
  };
  RETURN_IF_ERROR(seconds_of("seconds", 1.0, 1e-3, request.seconds));
  RETURN_IF_ERROR(seconds_of("split-minutes", 60.0, 0.1, writer.split_s));
  request.wait_s = parsed["wait"].as<double>();
  request.wait_at_start = parsed.count("wait") != 0;
  if (!in_range(request.wait_s, 0.0, kMostSeconds)) return bad_input("--wait must be a number of seconds from 0 on");
  const std::size_t buffer_mb = parsed["buffer-mb"].as<std::size_t>();
  if (buffer_mb < 1 || buffer_mb > kMostBuffer_mb) return bad_input("--buffer-mb must be from 1 to 65536");
  writer.buffer_bytes = buffer_mb << 20U;
  const std::string plane = parsed["planes"].as<std::string>();
  if (plane != "raw" && plane != "deblurred") return bad_input("--planes '" + plane + "' is neither raw nor deblurred");
  request.plane = plane == "raw" ? RecordedPlane::kRaw : RecordedPlane::kDeblurred;
  writer.replace = replace_of(parsed);
  writer.log = [](const std::string& line) { std::fprintf(stderr, "bolo record: %s\n", printable(line).c_str()); };
  RETURN_IF_ERROR(check_first_file(writer));  // a recording must not destroy an earlier one
  return request;
}

std::string files_text(const FileWriterResult& written) {
  if (written.files.empty()) return "no file";
  std::string text = written.files.front().string();
  if (written.files.size() > 1) text += " to " + written.files.back().string();
  return text;
}

// Where to find the frames of a recording that ended with an error.
std::string saved_text(const FileWriterResult& written) {
  if (written.files.empty() && written.parts.empty()) return "no file was finished";
  // A file that could not be completed may lack the last appended frames.
  std::string text = (written.parts.empty() ? "" : "up to ") + std::to_string(written.frames) + " frames are in ";
  if (!written.files.empty()) text += files_text(written);
  for (const fs::path& part : written.parts) text += (text.back() == ' ' ? "" : " and ") + part.string();
  if (written.parts.empty()) return text;
  std::error_code ignored;
  const bool there = fs::exists(written.parts.back(), ignored);
  return text + (there ? ", which bolo recover finishes"
                       : ", which is no longer there: if it was moved, bolo recover finishes it");
}

nlohmann::json to_json(const RecordResult& result) {
  const FileWriterResult& w = result.written;
  nlohmann::json files = nlohmann::json::array();
  for (const auto& file : w.files) files.push_back(file.string());
  const double seconds = w.last_t_s - w.first_t_s;
  return {{"files", files},
          {"frames", w.frames},
          {"seconds", seconds},
          {"complete", result.complete},
          {"lost",
           {{"before", result.lost_before},
            {"overwritten", result.lost_overwritten},
            {"no_room", result.lost_no_room},
            {"unwritten", w.unwritten}}},
          {"reconnects", result.reconnects},
          {"mb_per_s", seconds > 0.0 ? static_cast<double>(w.bytes) * 1e-6 / seconds : 0.0},
          {"longest_write_ms", w.longest_write_ms},
          {"buffer_frames", result.buffer_frames},
          {"error", result.status ? nlohmann::json(nullptr) : nlohmann::json(result.status.error().message)}};
}

void print(const RecordResult& result) {
  const FileWriterResult& w = result.written;
  const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  const double seconds = w.last_t_s - w.first_t_s;
  std::printf("%s: %llu frames, %.3f s, %.1f MB/s, longest write %.1f ms\n", printable(files_text(w)).c_str(),
              n(w.frames), seconds, seconds > 0.0 ? static_cast<double>(w.bytes) * 1e-6 / seconds : 0.0,
              w.longest_write_ms);
  std::printf(
      "lost: %llu before the daemon published them, %llu overwritten before they were read, %llu without room\n",
      n(result.lost_before), n(result.lost_overwritten), n(result.lost_no_room + w.unwritten));
  if (result.reconnects > 0) std::printf("the daemon was started again %llu times\n", n(result.reconnects));
}

Result<int> run_record(const cxxopts::ParseResult& given) {
  std::signal(SIGPIPE, SIG_IGN);  // a broken output pipe must not end a recording
  if (given.count("name") > 1) return record_several(given);
  ASSIGN_OR_RETURN(const auto request, record_request(given));
  auto recorded = [&] {
    Progress progress("recording", request.frames);
    return record(request, interrupted(), [&](std::uint64_t frames) { progress.update(frames); });
  }();
  ASSIGN_OR_RETURN(const RecordResult result, std::move(recorded));
  if (given.count("json") != 0) {
    std::cout << json_text(to_json(result)) << '\n';
  } else {
    print(result);
  }
  if (result.status) return kExitDone;
  const FileWriterResult& written = result.written;
  return failed(result.status.error().message + "; " + saved_text(written));
}

}  // namespace

int record_main(int argc, char** argv) { return run_verb(kRecordVerb, record_options(), argc, argv, run_record); }

}  // namespace bolo::tools
