// Shared parts of all verbs: the line of progress, on a terminal, and the end by a library's exception.
#include <fcntl.h>
#include <pty.h>
#include <sys/resource.h>
#include <termios.h>
#include <unistd.h>

#include <new>

#include "tests/child.hpp"
#include "tests/refusal.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools::cli_test {

int run_out_of_memory(int, char**) { throw std::bad_alloc(); }
int fail(int, char**) { throw std::runtime_error("no\nthread"); }
int quote_at_length(int, char**) {
  return report("quote", {ErrorKind::kFailed, "a.h5: '" + std::string(1'000'000, 'x') + "' is none; choose another"});
}
// Recurses deeply, under a limit that leaves no memory.
int go_deep(int, char**) {
  constexpr std::size_t kDeep = 900'000;
  rlim_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  const rlimit all{pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)), RLIM_INFINITY};
  setrlimit(RLIMIT_AS, &all);
  auto* const block = static_cast<volatile char*>(__builtin_alloca(kDeep));
  block[0] = 0;
  return block[0];
}
constexpr std::array<Verb, 4> kVerbs{
    {{"hunger", "", run_out_of_memory}, {"fail", "", fail}, {"quote", "", quote_at_length}, {"deep", "", go_deep}}};

// The line of error; exit code 1 is expected.
std::string ended(std::string verb) {
  std::string program = "bolo";
  std::array<char*, 2> words{program.data(), verb.data()};
  testing::internal::CaptureStderr();
  const int code = dispatch({"bolo", ""}, kVerbs, static_cast<int>(words.size()), words.data());
  std::string output = testing::internal::GetCapturedStderr();
  EXPECT_EQ(code, kExitFailed);
  return output;
}

TEST(Dispatch, AnExceptionIsAFailureInOneLine) {
  EXPECT_EQ(ended("hunger"), "bolo hunger: not enough memory\n");
  EXPECT_EQ(ended("fail"), "bolo fail: no?thread\n");
}

// Both the place, at its beginning, and what to do, at its end, are there.
TEST(Dispatch, AnErrorIsOneLineHoweverLongWhatItQuotes) {
  const std::string line = ended("quote");
  EXPECT_LE(line.size(), 2100U);
  EXPECT_TRUE(line.starts_with("bolo quote: a.h5: 'xxx")) << line;
  EXPECT_TRUE(line.ends_with("xxx' is none; choose another\n")) << line;
}

TEST(Dispatch, TheStackHasItsMemoryBeforeALimitIsReached) {
  std::string program = "bolo";
  std::string verb = "deep";
  std::array<char*, 2> words{program.data(), verb.data()};
  EXPECT_EQ(in_child([&] { return dispatch({"bolo", ""}, kVerbs, 2, words.data()); }), 0);
}

// Exit code and output of parsing words behind a verb's name; no code: they are good.
struct Parsed {
  std::optional<int> code;
  std::string output;
  cxxopts::ParseResult given;
};
Parsed parsed(std::vector<std::string> words) {
  cxxopts::Options options("bolo verb");
  add_option<double>(options, "rate", "a number");
  add_option<std::vector<double>>(options, "list", "numbers");
  add_option<std::string>(options, "name", "any text");
  add_overwrite_option(options);
  words.insert(words.begin(), "verb");
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  Parsed out;
  testing::internal::CaptureStderr();
  out.code = parse(options, static_cast<int>(argv.size()), argv.data(), out.given);
  out.output = testing::internal::GetCapturedStderr();
  return out;
}

TEST(Parse, ANumberIsTheWholeValue) {
  const Parsed right = parsed({"--rate=-1.5e-3", "--list", "1, 2.5"});
  EXPECT_EQ(right.given["rate"].as<double>(), -1.5e-3);
  EXPECT_EQ(right.given["list"].as<std::vector<double>>(), (std::vector<double>{1.0, 2.5}));
  for (const std::string text : {"0,03", "5abc", "0x10", "1_000", "5 6", "", "1e400", "nan", "inf", "1.5.2"}) {
    const Parsed wrong = parsed({"--rate=" + text});
    EXPECT_EQ(wrong.code, kExitUsage) << text;
    expect_parts(wrong.output, {"--rate: ", text, "--help\n"});
  }
  EXPECT_EQ(parsed({"--list", "1,2abc"}).code, kExitUsage);
}

TEST(Parse, TheOptionIsNamedWhoseValueIsNoNumber) {
  const Parsed list = parsed({"--list", "1,x", "--rate", "5"});
  EXPECT_TRUE(list.output.starts_with("bolo verb: --list: ")) << list.output;
  const Parsed name = parsed({"--name", "extra.h5", "--rate", "x"});
  EXPECT_TRUE(name.output.starts_with("bolo verb: --rate: ")) << name.output;
}

TEST(Parse, AFlagThatIsToldFalseIsRefused) {
  EXPECT_EQ(replace_of(parsed({"--overwrite"}).given), Replace::kExisting);
  EXPECT_EQ(replace_of(parsed({}).given), Replace::kNothing);
  const Parsed outcome = parsed({"--overwrite=false"});
  EXPECT_EQ(outcome.code, kExitUsage);
  EXPECT_EQ(outcome.output, "bolo verb: --overwrite takes no value; leave it out instead\n");
}

// Replaces stderr for its lifetime.
class Terminal {
 public:
  Terminal() : stderr_(::dup(STDERR_FILENO)), terminal_(::posix_openpt(O_RDWR | O_NOCTTY)) {
    if (::grantpt(terminal_) != 0 || ::unlockpt(terminal_) != 0) return;
    const int line = ::open(::ptsname(terminal_), O_RDWR | O_NOCTTY);
    ::dup2(line, STDERR_FILENO);
    ::close(line);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;
  ~Terminal() {
    ::dup2(stderr_, STDERR_FILENO);
    ::close(stderr_);
    ::close(terminal_);
  }
  std::string output() const {
    std::string text(4096, '\0');
    const ssize_t count = ::read(terminal_, text.data(), text.size());
    text.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
    return text;
  }

 private:
  int stderr_;
  int terminal_;
};

TEST(Progress, DoesNotWaitForATerminalThatTakesNothing) {
  const int ended = in_child([] {
    int master = -1;
    int slave = -1;
    if (openpty(&master, &slave, nullptr, nullptr, nullptr) != 0) return 1;
    dup2(slave, STDERR_FILENO);
    tcflow(slave, TCOOFF);  // as by Ctrl-S
    alarm(30);
    Progress progress("recording", 0);
    for (int i = 0; i < 3; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(110));
      progress.update(static_cast<std::uint64_t>(i));
    }
    return 0;
  });
  EXPECT_EQ(ended, 0);
}

TEST(Progress, SaysTheRateSinceTheWorkBeganAndTheTimeLeft) {
  const Terminal terminal;
  {
    Progress progress("work", 100);
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    progress.start_rate(50);
    progress.update(50);
    const std::string output = terminal.output();
    expect_parts(output, {"work: 50 of 100"});
    EXPECT_EQ(output.find("second"), std::string::npos) << "no rate before the work began: " << output;
    std::this_thread::sleep_for(std::chrono::milliseconds(250));
    progress.update(51);
  }
  const std::string output = terminal.output();
  expect_parts(output, {"work: 51 of 100 (51 %), ", " s left"});
  const double rate = std::atof(output.c_str() + output.find("%), ") + 4);
  EXPECT_GT(rate, 0.0);
  EXPECT_LE(rate, 4.0) << "one in a quarter of a second or more: " << output;
  const double left_s = std::atof(output.c_str() + output.find(" a second, ") + 11);
  EXPECT_GE(left_s, 12.0) << "49 at that rate: " << output;
}

}  // namespace bolo::tools::cli_test
