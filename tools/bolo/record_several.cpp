#include "tools/bolo/record_several.hpp"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/shm/shm_object.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/process.hpp"
#include "tools/cli/scratch_folder.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRecordSeveralVerb = "record";
constexpr auto kLook = std::chrono::milliseconds(50);

struct Recorder {
  std::string name;
  Process process;
  LineTail errors;
};

Status check_names(const std::vector<std::string>& names) {
  std::set<std::string> seen;
  for (const std::string& name : names) {
    if (const auto good = shm::object_path(name); !good) return tl::unexpected<Error>(good.error());
    if (!seen.insert(name).second) return bad_input("'" + name + "' is named twice");
  }
  return {};
}

Status make_folder(const cxxopts::ParseResult& parsed, fs::path& folder) {
  if (parsed.count("output") == 0) return bad_input("where to? usage: bolo record NAME NAME... -o FOLDER");
  folder = parsed["output"].as<std::string>();
  std::error_code error;
  if (folder.extension() == ".h5" && !fs::is_directory(folder, error)) {
    return bad_input(folder.string() + ": several cameras are recorded into a folder, this is a file's name");
  }
  fs::create_directories(folder, error);
  return error ? bad_input(folder.string() + ": cannot be made: " + error.message()) : Status{};
}

// The options that every recording gets.
std::vector<std::string> common_words(const cxxopts::ParseResult& parsed) {
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
    command.words = {program, kRecordSeveralVerb, name, "-o", (folder / (name + ".h5")).string()};
    command.words.insert(command.words.end(), common.begin(), common.end());
    command.log = logs / name;
    auto process = Process::start(command);
    if (!process) return tl::unexpected<Error>(process.error());
    recorders.push_back({name, std::move(*process), LineTail(command.log.string() + ".err")});
  }
  return recorders;
}

void show_errors(Recorder& recorder) {
  for (const std::string& line : recorder.errors.take()) {
    if (!line.starts_with("recording")) std::fprintf(stderr, "%s: %s\n", recorder.name.c_str(), line.c_str());
  }
}

// Until all have ended. An interrupt is passed on, and each ends its file in good order.
int wait_for(std::vector<Recorder>& recorders) {
  bool told = false;
  for (bool running = true; running;) {
    std::this_thread::sleep_for(kLook);
    if (interrupted().load(std::memory_order_relaxed) && !std::exchange(told, true)) {
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
    std::ifstream said(recorder.process.log().string() + ".out");
    for (std::string line; std::getline(said, line);) std::printf("%s\n", line.c_str());
    worst = std::max(worst, *recorder.process.ended());
  }
  return worst > kExitUsage ? kExitFailed : worst;
}

}  // namespace

int record_several(const cxxopts::ParseResult& parsed) {
  const auto names = parsed["name"].as<std::vector<std::string>>();
  fs::path folder;
  Status good = check_names(names);
  if (good) good = make_folder(parsed, folder);
  if (!good) return report(kRecordSeveralVerb, good.error());
  const auto logs = ScratchFolder::make();
  if (!logs) return report(kRecordSeveralVerb, logs.error());
  catch_interrupts();
  auto recorders = start(names, common_words(parsed), folder, logs->path());
  if (!recorders) return report(kRecordSeveralVerb, recorders.error());
  return wait_for(*recorders);
}

}  // namespace bolo::tools
