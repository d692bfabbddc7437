// `bolo demo`: simulated camera, daemon and live page in one command, compared with the simulation's truth.
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/text.hpp"
#include "src/report/plot.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/process.hpp"
#include "tools/demo/live_check.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr auto kStartLimit = 30s;
constexpr double kEndLimit_s = 10.0;
constexpr double kLongest_s = 86400.0;
// The paper's solver first; the page shows the last.
constexpr std::array kSolvers{"admm", "motion"};
constexpr std::array kLogs{"simulate", "fakecam", "bolod", "view"};  // .out and .err for each

Status check_room(const fs::path& named) {
  constexpr std::uintmax_t kNeeded = 400;  // MB: the capture with its truth has 370
  std::error_code error;
  fs::path folder = named.empty() ? fs::temp_directory_path(error) : fs::absolute(named, error);
  while (folder.has_relative_path() && !fs::exists(folder, error)) folder = folder.parent_path();
  const fs::space_info room = fs::space(folder, error);
  const std::uintmax_t free = room.available / 1'000'000;
  if (error || room.capacity == 0 || free >= kNeeded) return {};  // a tmpfs without a limit states no size
  return bad_input(folder.string() + ": " + std::to_string(free) + " MB are free, and the demonstration needs " +
                   std::to_string(kNeeded) + " MB; name a folder with more by -o FOLDER, or by TMPDIR");
}

class Demonstration {
 public:
  Demonstration(fs::path folder, bool stays, Replace replace)
      : folder_(std::move(folder)), stays_(stays), replace_(replace) {}

  Status run(double seconds, bool with_page) {
    std::vector<fs::path> outputs{capture(), picture(), configuration()};
    for (const std::string log : kLogs) {
      for (const char* ending : {".out", ".err"}) outputs.push_back(folder_ / (log + ending));
    }
    RETURN_IF_ERROR(check_outputs(outputs, {}, replace_));
    for (const auto& [name, path] : {std::pair{"bolo", &bolo_}, std::pair{"bolod", &bolod_}}) {
      ASSIGN_OR_RETURN(*path, find_own_program(name));
    }
    RETURN_IF_ERROR(simulate());
    RETURN_IF_ERROR(start_camera());
    std::printf("camera at %s as GigE Vision packets; bolod deblurs it live into shared memory \"%s\"\n",
                address().c_str(), name().c_str());
    for (const char* solver : kSolvers) {
      if (daemon_) {
        RETURN_IF_ERROR(end_daemon());
      }
      RETURN_IF_ERROR(start_daemon(solver));
      RETURN_IF_ERROR(measure(solver, seconds));
    }
    RETURN_IF_ERROR(conclude());
    return with_page ? show_page() : end_daemon();
  }

 private:
  Status simulate() {
    std::puts("simulating a street that a 640x120 microbolometer pans along at 300 px/s, 200 frames/s");
    std::fflush(stdout);
    std::vector<std::string> words{bolo_,      "simulate", "-o",     capture(), "--scene",  "street", "--width", "640",
                                   "--height", "120",      "--rate", "200",     "--frames", "800",    "--speed", "300"};
    if (replace_ == Replace::kExisting) words.emplace_back("--overwrite");  // also what an interrupted run left
    auto simulation = start(std::move(words), "simulate");
    if (!simulation) return tl::unexpected(simulation.error());
    while (!simulation->ended()) {
      if (interrupted()) return failed("interrupted");
      std::this_thread::sleep_for(20ms);
    }
    return *simulation->ended() == 0 ? Status{} : ended_early("bolo simulate", *simulation);
  }

  Status start_camera() {
    ASSIGN_OR_RETURN(
        auto camera,
        start({bolo_, "fakecam", capture(), "--rate", "200", "--loop", "--interface", address()}, "fakecam"));
    camera_.emplace(std::move(camera));
    return wait_for(*camera_, "fakecam.out", "serving", "the fake camera");
  }

  Status start_daemon(const std::string& solver) {
    const std::string text = "name = \"" + name() + "\"\n\n[source]\ntype = \"genicam\"\naddress = \"" + address() +
                             "\"\nwidth = 640\nheight = 120\nrate_hz = 200.0\n\n[deblur]\nsolver = \"" + solver +
                             "\"\n";
    RETURN_IF_ERROR(write_file({configuration(), replace_configuration_}, text));
    replace_configuration_ = Replace::kExisting;  // from now on it is this demonstration's own
    ASSIGN_OR_RETURN(auto daemon, start({bolod_, "--config", configuration()}, "bolod"));
    daemon_.emplace(std::move(daemon));
    return wait_for(*daemon_, "bolod.err", "frames arrive", "bolod");
  }

  Status measure(const char* solver, double seconds) {
    std::printf("\nsolver = \"%s\"\n", solver);
    std::fflush(stdout);
    // All solvers are shown with the same frame of the capture.
    const auto shown = outcomes_.empty() ? std::nullopt : std::optional(outcomes_.front().shown.shown().index);
    ASSIGN_OR_RETURN(auto outcome, check_live(name(), capture(), seconds, shown));
    print_text(to_json(outcome));
    std::fflush(stdout);
    outcomes_.push_back(std::move(outcome));
    return {};
  }

  // Results before and after each solver; the image omits solvers that did not process the first one's frame.
  Status conclude() {
    std::printf("\nRMSE against truth   before %.3f K", outcomes_.front().error.rmse_before());
    std::vector<LiveResult> results;
    std::string solvers;
    for (std::size_t i = 0; i < outcomes_.size(); ++i) {
      const LiveOutcome& o = outcomes_[i];
      std::printf(", %s %.3f K", kSolvers[i], o.error.rmse_after());
      if (o.shown.waits()) continue;
      results.push_back(
          {&o.shown.shown(),
           {kSolvers[i], o.error.rmse_before(), o.error.rmse_after(), o.first.frame_period_s, o.latency_ms}});
      solvers += std::string(solvers.empty() ? "" : "; ") + o.first.solver;
    }
    std::puts("");
    std::fflush(stdout);
    if (!stays_) return {};
    plot::Sheet sheet = sheet_of(results);
    sheet.how = "bolo demo: " + solvers + ". " + describe_machine() + ".";
    RETURN_IF_ERROR(save(sheet, {picture(), replace_}));
    std::printf("before and after     %s\n", printable(picture().string()).c_str());
    return {};
  }

  Status show_page() {
    ASSIGN_OR_RETURN(auto page, start({bolo_, "view", name(), "--port", "0"}, "view"));
    RETURN_IF_ERROR(wait_for(page, "view.out", "http://", "bolo view"));
    std::printf("\n%s", contents(folder_ / "view.out").c_str());
    std::fflush(stdout);
    while (!interrupted()) {
      if (page.ended()) return ended_early("bolo view", page);
      if (camera_->ended()) return ended_early("the fake camera", *camera_);
      if (daemon_->ended()) return ended_early("bolod", *daemon_);
      std::this_thread::sleep_for(50ms);
    }
    return end_daemon();
  }

  Status end_daemon() {
    daemon_->signal(SIGTERM);
    const auto code = daemon_->wait(kEndLimit_s);
    daemon_.reset();
    if (code && *code == 0) return {};
    return failed("bolod did not end cleanly:\n" + contents(folder_ / "bolod.err"));
  }

  Result<Process> start(std::vector<std::string> words, const std::string& log) {
    std::error_code ignored;  // logs are appended to
    fs::remove(folder_ / (log + ".out"), ignored);
    fs::remove(folder_ / (log + ".err"), ignored);
    return Process::start({std::move(words), folder_ / log});
  }

  Status wait_for(Process& process, const std::string& log, const std::string& word, const std::string& what) {
    const auto deadline = std::chrono::steady_clock::now() + kStartLimit;
    while (contents(folder_ / log).find(word) == std::string::npos) {
      if (interrupted()) return failed("interrupted");
      if (process.ended()) return ended_early(what, process);
      if (std::chrono::steady_clock::now() > deadline) {
        return failed(what + " did not start within 30 s: " + last_line_of(process));
      }
      std::this_thread::sleep_for(20ms);
    }
    return {};
  }

  static Status ended_early(const std::string& what, const Process& process) {
    return failed(what + " ended early: " + last_line_of(process));
  }

  // Unique to this process, so that two demonstrations do not interfere.
  static std::string name() { return "demo-" + std::to_string(getpid()); }
  static std::string address() { return "127.0.77." + std::to_string(1 + getpid() % 250); }
  fs::path capture() const { return folder_ / "street.h5"; }
  fs::path picture() const { return folder_ / "before_after.svg"; }
  fs::path configuration() const { return folder_ / "bolod.toml"; }

  fs::path folder_;
  bool stays_;  // the folder is the user's, not a temporary one
  Replace replace_;
  Replace replace_configuration_ = replace_;  // of configuration()
  fs::path bolo_;
  fs::path bolod_;
  std::optional<Process> camera_;
  std::optional<Process> daemon_;
  std::vector<LiveOutcome> outcomes_;  // in the order of kSolvers
};

}  // namespace

int demo_main(int argc, char** argv) {
  cxxopts::Options options(
      "bolo demo",
      "Try Bolo without hardware: a simulated camera sends real GigE Vision packets, bolod deblurs "
      "them live, first with the solver admm, then with motion, and the frames are compared with "
      "the simulation's truth. Then a live page shows them until Ctrl-C.");
  add_option<double>(options, "seconds", "Duration of each solver's comparison", "10", "S");
  add_option<std::string>(options, "o,output", "Keep capture, logs and a picture in this folder", nullptr, "FOLDER");
  add_option<bool>(options, "no-page", "Exit after the comparison, without the live page");
  add_overwrite_option(options);
  return run_verb("demo", std::move(options), argc, argv, [](const cxxopts::ParseResult& given) -> Status {
    const auto seconds = given["seconds"].as<double>();
    if (!(seconds > 0.0 && seconds <= kLongest_s)) return bad_input("--seconds must lie in 0 to 86400");
    const fs::path named = given.count("output") != 0 ? given["output"].as<std::string>() : "";
    RETURN_IF_ERROR(check_room(named));
    std::optional<ScratchFolder> scratch;
    if (named.empty()) {
      ASSIGN_OR_RETURN(auto made, ScratchFolder::make());
      scratch.emplace(std::move(made));
    } else {
      RETURN_IF_ERROR(make_folder(named));
    }
    const fs::path folder = scratch ? scratch->path() : fs::absolute(named);
    return Demonstration(folder, !scratch, replace_of(given)).run(seconds, given.count("no-page") == 0);
  });
}

}  // namespace bolo::tools
