// Shared by the verbs: options, exit codes, errors, progress and interruption.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <cxxopts.hpp>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/core/text.hpp"
#include "src/core/unique_fd.hpp"

// cxxopts parses the leading number of a value and ignores the rest: "0,03" became 0.
template <>
inline void cxxopts::values::stringstream_parser<double>(const std::string& text, double& value) {
  const auto whole = bolo::number_of(bolo::trimmed(text));  // a list may have blanks after its commas
  if (!whole) throw exceptions::incorrect_argument_type(text);
  value = *whole;
}

namespace bolo::tools {

inline constexpr int kExitDone = 0;
inline constexpr int kExitFailed = 1;
inline constexpr int kExitUsage = 2;

// Program name in messages: "bolo", or another that uses these functions. Thread: setup.
void set_program_name(std::string name);

// Parses argv; adds --help. --help prints it and returns exit code 0; wrong usage prints one line to stderr and returns
// 2; otherwise returns nothing and fills `parsed`. Refuses undeclared positional arguments, and flags with a value:
// `--overwrite=false` would count as given.
std::optional<int> parse(cxxopts::Options& options, int argc, char** argv, cxxopts::ParseResult& parsed);

// Values of an option that takes names or files, unchanged: a vector of cxxopts would split them at commas.
std::vector<std::string> names_of(const cxxopts::ParseResult& parsed, const std::string& option);
std::vector<std::filesystem::path> files_of(const cxxopts::ParseResult& parsed, const std::string& option);

// --overwrite, for all verbs that write files. Thread: setup.
void add_overwrite_option(cxxopts::Options& options);
Replace replace_of(const cxxopts::ParseResult& parsed);

// Prints "bolo VERB: message" to stderr and returns the error's exit code.
int report(const std::string& verb, const Error& error);

// Exit code of a verb's result: its own, or that of the error, which is reported.
int exit_code_of(const std::string& verb, const Status& done);
int exit_code_of(const std::string& verb, const Result<int>& done);

// Set by SIGINT, SIGTERM, SIGHUP (not under nohup) after catch_interrupts(); long work polls it and ends cleanly.
const std::atomic<bool>& interrupted();
void catch_interrupts();

// Error for work interrupted after `frames` of this capture, which its ".part" keeps. Thread: any.
Error interrupted_after(std::uint64_t frames, const std::filesystem::path& capture);

// Parses, runs `work(given)`, which returns a Status or Result<int> with the exit code, and reports errors. Returns the
// exit code. `interruptible`: the work polls interrupted(). Thread: setup.
template <typename Work>
int run_verb(const char* verb, cxxopts::Options options, int argc, char** argv, Work&& work,
             bool interruptible = true) {
  cxxopts::ParseResult given;
  if (const auto code = parse(options, argc, argv, given)) return *code;
  if (interruptible) catch_interrupts();
  try {
    return exit_code_of(verb, work(given));
  } catch (const std::bad_alloc&) {
    return report(verb, {ErrorKind::kFailed, "not enough memory; ask for less at once"});
  }
}

// Adds an option: description, default (nullptr: none), value's name in the help. bool: a flag. Thread: setup.
template <typename T>
void add_option(cxxopts::Options& options, const char* name, const std::string& words, const char* standard = nullptr,
                const char* argument = "", const char* group = "") {
  auto value = cxxopts::value<T>();
  if (standard != nullptr) value->default_value(standard);
  options.add_option(group, {name, words, value, argument});
}

// kBadInput unless an option's value lies in the range. Thread: any.
Status within(double value, const char* option, double low, double high);

// The value of an option; kBadInput unless it lies in the range. Thread: any.
template <typename T>
Result<T> number_of(const cxxopts::ParseResult& given, const char* option, double low, double high) {
  const T value = given[option].as<T>();
  RETURN_IF_ERROR(within(static_cast<double>(value), option, low, high));
  return value;
}

// Progress on stderr: on a terminal one line, at most ten updates a second; else a line every `log_every_s` (0: none).
class Progress {
 public:
  explicit Progress(std::string what, std::uint64_t total, double log_every_s = 0.0);  // total 0: unknown
  ~Progress();                                                                         // ends the line
  void update(std::uint64_t done);
  // Restarts the rate: earlier work was none, or of another kind.
  void start_rate(std::uint64_t done);

 private:
  std::string rate(std::uint64_t done, std::chrono::steady_clock::time_point now) const;
  void log(std::uint64_t done, std::chrono::steady_clock::time_point now);
  void show(std::string_view text) const;

  std::string what_;
  std::uint64_t total_;
  double log_every_s_;
  bool terminal_;
  UniqueFd own_;  // the terminal opened again for non-blocking writes; invalid if not possible
  bool printed_ = false;
  std::chrono::steady_clock::time_point start_;
  std::chrono::steady_clock::time_point rate_start_;
  std::uint64_t rate_from_ = 0;
  std::chrono::steady_clock::time_point last_;
};

// --- Dispatch from a program's first argument to a verb.

// A verb of a program. argv[0] is the verb; `run` returns the exit code.
struct Verb {
  std::string_view name;
  std::string_view summary;
  int (*run)(int argc, char** argv);
};

struct Program {
  std::string_view name;
  std::string_view summary;
};

// Runs the verb named by argv[1], or answers --help and --version. Returns the exit code. Thread: main.
int dispatch(const Program& program, std::span<const Verb> verbs, int argc, char** argv);

// --- JSON for other programs.

// Replaces invalid UTF-8 by U+FFFD instead of throwing and, if `ascii`, escapes what is not ASCII, so that no text
// reaches a terminal as control characters. `indent`: spaces per level; -1: one line. Thread: any.
template <typename Json>
std::string json_text(const Json& json, int indent = -1, bool ascii = true) {
  return json.dump(indent, ' ', ascii, Json::error_handler_t::replace);
}

// --- --plot FILE.svg|FILE.html of long-running verbs: draws their measurements.

// Also adds --overwrite. `what`: as in "Draw the table". Thread: setup.
void add_plot_option(cxxopts::Options& options, const std::string& what);

// The requested file, or none. kBadInput: neither .svg nor .html, or it must not be written. Thread: any.
Result<OutputFile> plot_file_of(const cxxopts::ParseResult& given);

// Processor and number of threads, for machine-dependent results. Thread: any.
std::string describe_machine();

}  // namespace bolo::tools
