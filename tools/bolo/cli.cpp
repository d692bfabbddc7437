#include "tools/bolo/cli.hpp"

#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <iostream>
#include <utility>

namespace bolo::tools {
namespace {

std::atomic<bool> g_interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "the signal handler stores to it");

OptionsReader g_options_reader;

// What stands in file names must not break a message into lines, nor reach the terminal as a command to it.
std::string one_line(std::string_view text) {
  std::string line;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte != 0x7F) {
      line += c;
    } else if (c == '\n') {
      line += "\\n";
    } else {
      constexpr std::string_view kDigits = "0123456789abcdef";
      line += {'\\', 'x', kDigits[byte >> 4U], kDigits[byte & 15U]};
    }
  }
  return line;
}

// cxxopts says which value it cannot read, not of which option: "--frames: ", of the one before it.
std::string option_of(const std::string& message, int argc, char** argv) {
  const std::string before = "Argument " + cxxopts::LQUOTE;
  const std::string after = cxxopts::RQUOTE + " failed to parse";
  if (!message.starts_with(before) || !message.ends_with(after)) return {};
  const std::string value = message.substr(before.size(), message.size() - before.size() - after.size());
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t equals = word.find('=');
    const bool both = word.starts_with("--") && equals != std::string::npos;
    if (both && word.find(value, equals) != std::string::npos) return word.substr(0, equals) + ": ";
    if (!both && word.find(value) != std::string::npos && argv[i - 1][0] == '-') return argv[i - 1] + std::string(": ");
  }
  return {};
}

}  // namespace

void read_options_with(OptionsReader reader) { g_options_reader = std::move(reader); }

std::optional<int> parse(cxxopts::Options& options, int argc, char** argv, cxxopts::ParseResult& parsed) {
  options.add_options()("h,help", "Print this help");
  if (g_options_reader) {
    g_options_reader(options);
    return kExitDone;
  }
  try {
    parsed = options.parse(argc, argv);
    if (parsed.count("help") != 0) {
      std::cout << options.help();
      return kExitDone;
    }
    if (!parsed.unmatched().empty()) {
      std::fprintf(stderr, "bolo %s: unexpected argument '%s'; see bolo %s --help\n", argv[0],
                   one_line(parsed.unmatched().front()).c_str(), argv[0]);
      return kExitUsage;
    }
  } catch (const cxxopts::exceptions::exception& e) {
    std::fprintf(stderr, "bolo %s: %s%s; see bolo %s --help\n", argv[0], option_of(e.what(), argc, argv).c_str(),
                 one_line(e.what()).c_str(), argv[0]);
    return kExitUsage;
  }
  return std::nullopt;
}

std::vector<std::filesystem::path> files_of(const cxxopts::ParseResult& parsed, const std::string& option) {
  std::vector<std::filesystem::path> files;
  for (const auto& argument : parsed.arguments()) {
    if (argument.key() == option) files.emplace_back(argument.value());
  }
  return files;
}

void add_overwrite_option(cxxopts::Options& options) {
  options.add_options()("overwrite", "Replace files that are there already");
}

Replace replace_of(const cxxopts::ParseResult& parsed) {
  return parsed.count("overwrite") != 0 ? Replace::kExisting : Replace::kNothing;
}

int report(const std::string& verb, const Error& error) {
  std::fprintf(stderr, "bolo %s: %s\n", verb.c_str(), one_line(error.message).c_str());
  return error.exit_code();
}

const std::atomic<bool>& interrupted() { return g_interrupted; }

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = [](int) { g_interrupted.store(true, std::memory_order_relaxed); };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

Progress::Progress(std::string what, std::uint64_t total, double log_every_s)
    : what_(std::move(what)),
      total_(total),
      log_every_s_(log_every_s),
      terminal_(isatty(STDERR_FILENO) == 1),
      start_(std::chrono::steady_clock::now()),
      last_(start_) {}

Progress::~Progress() {
  if (printed_) std::fputc('\n', stderr);
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
  const double seconds = std::chrono::duration<double>(now - start_).count();
  if (total_ == 0) {
    std::fprintf(stderr, "\r%s: %llu, %.1f s ", what_.c_str(), static_cast<unsigned long long>(done), seconds);
    return;
  }
  std::fprintf(stderr, "\r%s: %llu of %llu (%.0f %%), %.1f a second ", what_.c_str(),
               static_cast<unsigned long long>(done), static_cast<unsigned long long>(total_),
               total_ > 0 ? 100.0 * static_cast<double>(done) / static_cast<double>(total_) : 100.0,
               seconds > 0 ? static_cast<double>(done) / seconds : 0.0);
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

}  // namespace bolo::tools
