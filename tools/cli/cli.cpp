#include "tools/cli/cli.hpp"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <iostream>
#include <set>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/report/plot.hpp"

namespace bolo::tools {
namespace {

std::atomic<bool> g_interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "the signal handler stores to it");

std::string g_program = "bolo";

// cxxopts reports the unreadable value but not its option: returns "--frames: ", the option before it.
std::string option_of(const std::string& message, int argc, char** argv) {
  const std::string before = "Argument " + cxxopts::LQUOTE;
  const std::string after = cxxopts::RQUOTE + " failed to parse";
  if (!message.starts_with(before) || !message.ends_with(after)) return {};
  const std::string value = message.substr(before.size(), message.size() - before.size() - after.size());
  // A whole value or an element of a list, not part of another option's value.
  const auto has_value = [&value](const std::string& given) {
    return ("," + given + ",").find("," + value + ",") != std::string::npos;
  };
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t equals = word.find('=');
    const bool both = word.starts_with("--") && equals != std::string::npos;
    if (both && has_value(word.substr(equals + 1))) return word.substr(0, equals) + ": ";
    if (!both && has_value(word) && argv[i - 1][0] == '-') return argv[i - 1] + std::string(": ");
  }
  return {};
}

// The flag that was given a value ("--json=false"), or none.
std::optional<std::string> flag_with_value(const cxxopts::Options& options, const cxxopts::ParseResult& parsed) {
  std::set<std::string> flags;
  for (const std::string& group : options.groups()) {
    for (const auto& option : options.group_help(group).options) {
      if (option.is_boolean) flags.insert(option.l.begin(), option.l.end());
    }
  }
  for (const auto& argument : parsed.arguments()) {
    if (flags.contains(argument.key()) && argument.value() != "true") return argument.key();
  }
  return std::nullopt;
}

void print_usage(const Program& program, std::span<const Verb> verbs, std::FILE* out) {
  const std::string name(program.name);
  std::fprintf(out, "%s: %s\n\nusage: %s VERB [options], %s VERB --help\n\n", name.c_str(),
               std::string(program.summary).c_str(), name.c_str(), name.c_str());
  for (const Verb& verb : verbs) {
    std::fprintf(out, "  %-10.*s %.*s\n", static_cast<int>(verb.name.size()), verb.name.data(),
                 static_cast<int>(verb.summary.size()), verb.summary.data());
  }
}

// A failure to write standard output (full disk) is an error.
int printed(const std::string& who, int code) {
  std::cout.flush();
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good()) return code;
  std::fprintf(stderr, "%s: standard output cannot be written: %s\n", who.c_str(),
               errno != 0 ? std::strerror(errno) : "the disk took only a part");
  return code == kExitDone ? kExitFailed : code;
}

// Exceptions of libraries (out of memory or threads) become an error message and exit code instead of an abort.
int guarded(const std::string& program, const Verb& verb, int argc, char** argv) {
  try {
    grow_stack();
    return verb.run(argc, argv);
  } catch (const std::exception& e) {
    const std::string words = message_line(describe_exception(e));
    std::fprintf(stderr, "%s %s: %s\n", program.c_str(), std::string(verb.name).c_str(), words.c_str());
    return kExitFailed;
  }
}

}  // namespace

void set_program_name(std::string name) { g_program = std::move(name); }

std::optional<int> parse(cxxopts::Options& options, int argc, char** argv, cxxopts::ParseResult& parsed) {
  const std::string word = std::filesystem::path(argv[0]).filename().string();
  const std::string command = word == g_program ? word : g_program + " " + word;  // "bolo deblur"
  options.add_options()("h,help", "Print this help");
  try {
    parsed = options.parse(argc, argv);
    if (parsed.count("help") != 0) {
      std::cout << options.help();
      return kExitDone;
    }
    if (!parsed.unmatched().empty()) {
      std::fprintf(stderr, "%s: unexpected argument '%s'; see %s --help\n", command.c_str(),
                   message_line(parsed.unmatched().front()).c_str(), command.c_str());
      return kExitUsage;
    }
    if (const auto flag = flag_with_value(options, parsed)) {
      std::fprintf(stderr, "%s: --%s takes no value; leave it out instead\n", command.c_str(), flag->c_str());
      return kExitUsage;
    }
  } catch (const cxxopts::exceptions::exception& e) {
    std::fprintf(stderr, "%s: %s%s; see %s --help\n", command.c_str(),
                 message_line(option_of(e.what(), argc, argv)).c_str(), message_line(e.what()).c_str(),
                 command.c_str());
    return kExitUsage;
  }
  return std::nullopt;
}

std::vector<std::string> names_of(const cxxopts::ParseResult& parsed, const std::string& option) {
  std::vector<std::string> names;
  for (const auto& argument : parsed.arguments()) {
    if (argument.key() == option) names.push_back(argument.value());
  }
  return names;
}

std::vector<std::filesystem::path> files_of(const cxxopts::ParseResult& parsed, const std::string& option) {
  const std::vector<std::string> names = names_of(parsed, option);
  return {names.begin(), names.end()};
}

void add_overwrite_option(cxxopts::Options& options) { options.add_options()("overwrite", "Replace existing files"); }

Replace replace_of(const cxxopts::ParseResult& parsed) {
  return parsed.count("overwrite") != 0 ? Replace::kExisting : Replace::kNothing;
}

int report(const std::string& verb, const Error& error) {
  std::fprintf(stderr, "%s %s: %s\n", g_program.c_str(), verb.c_str(), message_line(error.message).c_str());
  return error.exit_code();
}

int exit_code_of(const std::string& verb, const Status& done) { return done ? kExitDone : report(verb, done.error()); }

int exit_code_of(const std::string& verb, const Result<int>& done) { return done ? *done : report(verb, done.error()); }

Status within(double value, const char* option, double low, double high) {
  if (value >= low && value <= high) return {};
  return bad_input(fmt::format("--{} {:g}: expected {:g} to {:g}", option, value, low, high));
}

const std::atomic<bool>& interrupted() { return g_interrupted; }

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = [](int) { g_interrupted.store(true, std::memory_order_relaxed); };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction before {};
  sigaction(SIGHUP, nullptr, &before);
  if (before.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);  // under nohup, keep it ignored
}

Error interrupted_after(std::uint64_t frames, const std::filesystem::path& capture) {
  return {ErrorKind::kFailed,
          fmt::format("interrupted; {} kept in {}.part, which bolo recover finishes",
                      frames == 1 ? "1 frame is" : fmt::format("{} frames are", frames), capture.string())};
}

Progress::Progress(std::string what, std::uint64_t total, double log_every_s)
    : what_(std::move(what)),
      total_(total),
      log_every_s_(log_every_s),
      terminal_(isatty(STDERR_FILENO) == 1),
      own_(terminal_ ? ::open("/proc/self/fd/2", O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC) : -1),
      start_(std::chrono::steady_clock::now()),
      rate_start_(start_),
      last_(start_) {}

Progress::~Progress() {
  if (printed_) show("\n");
}

// A blocked terminal (Ctrl-S, a stalled connection) must not delay the work: a recorder would lose frames.
void Progress::show(std::string_view text) const {
  pollfd event{own_ ? own_.get() : STDERR_FILENO, POLLOUT, 0};
  if (poll(&event, 1, 0) <= 0) return;
  [[maybe_unused]] const ssize_t done = ::write(event.fd, text.data(), text.size());
}

void Progress::start_rate(std::uint64_t done) {
  rate_start_ = std::chrono::steady_clock::now();
  rate_from_ = done;
}

// ", 12.5 a second, 3 s left"; empty while unknown.
std::string Progress::rate(std::uint64_t done, std::chrono::steady_clock::time_point now) const {
  const double seconds = std::chrono::duration<double>(now - rate_start_).count();
  if (done <= rate_from_ || seconds <= 0.0) return {};
  const double a_second = static_cast<double>(done - rate_from_) / seconds;
  const std::string text = fmt::format(", {:.1f} a second", a_second);
  return done < total_ ? fmt::format("{}, {:.0f} s left", text, static_cast<double>(total_ - done) / a_second) : text;
}

void Progress::update(std::uint64_t done) {
  const auto now = std::chrono::steady_clock::now();
  if (!terminal_) {
    log(done, now);
    return;
  }
  if ((done < total_ || total_ == 0) && now - last_ < std::chrono::milliseconds(100)) return;
  last_ = now;
  printed_ = true;
  if (total_ == 0) {
    const double seconds = std::chrono::duration<double>(now - start_).count();
    show(fmt::format("\r{}: {}, {:.1f} s ", what_, done, seconds));
    return;
  }
  // Spaces erase the rest of a longer line.
  const double percent = 100.0 * static_cast<double>(done) / static_cast<double>(total_);
  show(fmt::format("\r{}: {} of {} ({:.0f} %){}    ", what_, done, total_, percent, rate(done, now)));
}

void Progress::log(std::uint64_t done, std::chrono::steady_clock::time_point now) {
  if (log_every_s_ <= 0.0 || std::chrono::duration<double>(now - last_).count() < log_every_s_) return;
  last_ = now;
  const double seconds = std::chrono::duration<double>(now - start_).count();
  std::fprintf(stderr, "%s: %llu of %llu (%.0f %%), %.0f a second, %.0f s\n", what_.c_str(),
               static_cast<unsigned long long>(done), static_cast<unsigned long long>(total_),
               total_ > 0 ? 100.0 * static_cast<double>(done) / static_cast<double>(total_) : 100.0,
               static_cast<double>(done) / seconds, seconds);
}

int dispatch(const Program& program, std::span<const Verb> verbs, int argc, char** argv) {
  hold_standard_streams();
  const std::string name(program.name);
  set_program_name(name);
  if (argc < 2) {
    print_usage(program, verbs, stderr);
    return kExitUsage;
  }
  const std::string_view word = argv[1];
  if (word == "--help" || word == "-h" || word == "help") {
    print_usage(program, verbs, stdout);
    return printed(name, kExitDone);
  }
  if (word == "--version") {
    std::printf("%s " BOLO_VERSION "\n", name.c_str());
    return printed(name, kExitDone);
  }
  for (const Verb& verb : verbs) {
    if (verb.name != word) continue;
    std::signal(SIGXFSZ, SIG_IGN);  // a file size limit then is a reported write error, like a full disk
    return printed(name + " " + std::string(verb.name), guarded(name, verb, argc - 1, argv + 1));
  }
  std::fprintf(stderr, "%s: no verb '%s'; '%s --help' lists them\n", name.c_str(), message_line(argv[1]).c_str(),
               name.c_str());
  return kExitUsage;
}

void add_plot_option(cxxopts::Options& options, const std::string& what) {
  options.add_options()("plot", what + ": a drawing (.svg) or a page with figures (.html)",
                        cxxopts::value<std::string>(), "FILE");
  add_overwrite_option(options);
}

Result<OutputFile> plot_file_of(const cxxopts::ParseResult& given) {
  if (given.count("plot") == 0) return OutputFile();
  OutputFile file(given["plot"].as<std::string>(), replace_of(given));
  Status good = plot::check_sheet_file(file.path);
  if (good) good = check_output(file);
  if (!good) return bad_input("--plot " + good.error().message);
  return file;
}

std::string describe_machine() {
  std::string name = "unknown processor";
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    const std::size_t colon = line.find(": ");
    if (!line.starts_with("model name") || colon == std::string::npos) continue;
    name = line.substr(colon + 2);
    break;
  }
  return name + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads";
}

}  // namespace bolo::tools
