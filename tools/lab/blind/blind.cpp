#include <sys/random.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include <glib.h>

#include "src/core/statistics.hpp"
#include "tools/lab/blind/blind.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::blind {
namespace {

namespace fs = std::filesystem;
using Given = cxxopts::ParseResult;
using Words = std::vector<std::string>;

// Sorted keys, no blanks, shortest round-trip numbers: the text is unique for a set of answers.
std::string canonical(const std::vector<Session>& sessions) {
  nlohmann::json out = nlohmann::json::array();
  for (const Session& session : sessions) out.push_back(to_json(session));
  return out.dump();
}

// 64 hexadecimal digits.
Result<std::string> fresh_nonce() {
  std::array<unsigned char, 32> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    return failed("the system gives no random numbers to seal the answers with");
  }
  std::string text;
  for (const unsigned char byte : bytes) text += plot::format("%02x", static_cast<unsigned>(byte));
  return text;
}

struct Request {
  DrawOptions draw;
  std::vector<Session> sessions;  // drawn
  fs::path program;               // provides the tested `diagnose`
  fs::path keep;                  // empty: captures and reports are deleted
  int jobs = 2;
  Replace replace = Replace::kNothing;  // of kept files
  bool json = false;

  fs::path kept(const Session& session) const {
    return keep / (std::string(name_of(session.kind)) + '-' + std::to_string(session.index));
  }
};

constexpr std::array kKeptFiles{"answers.json", "nonce.txt"};

cxxopts::Options command_line() {
  cxxopts::Options options(
      "bolo-lab blind",
      "Draws bench sessions with hidden effects, seals the answers, diagnoses the captures in processes that cannot\n"
      "read them, opens the answers and scores. A session is six captures of about 2,000 frames in all.");
  const char* group = "Sessions";
  add_option<Words>(options, "kind", "effect-free, single, pair, outside, withheld, forms, bench, or all; repeatable",
                    "all", "", group);
  add_option<std::int64_t>(options, "sessions", "Of each kind", "29", "", group);
  add_option<std::int64_t>(options, "first", "Index of the first session of each kind", "0", "", group);
  add_option<std::string>(options, "only", "The effect of every session", nullptr, "EFFECT", group);
  add_option<bool>(options, "imperfect", "The stimuli have errors of their own", nullptr, "", group);
  add_option<std::string>(options, "reality",
                          "first: the project's simulator; second: a camera and a bench that share nothing with it",
                          "first", "", group);
  add_option<std::uint64_t>(options, "seed", "The same sessions each time", "1", "", group);
  add_option<int>(options, "width", "Pixels", "32", "", group);
  add_option<int>(options, "height", "Pixels", "24", "", group);
  add_option<double>(options, "frames-scale", "Of the captures' lengths", "1", "", group);
  group = "Run";
  add_option<std::string>(options, "bolo", "Whose diagnosis is checked (default: the one beside this program)", nullptr,
                          "PROGRAM", group);
  add_option<int>(options, "jobs", "Sessions at the same time", "2", "", group);
  add_option<std::string>(options, "keep", "Keep captures, reports and answers here", nullptr, "DIR", group);
  add_option<bool>(options, "json", "Print the score as JSON", nullptr, "", group);
  add_overwrite_option(options);
  return options;
}

Status read_draw(const Given& given, DrawOptions& draw) {
  draw.seed = given["seed"].as<std::uint64_t>();
  draw.geometry = {given["width"].as<int>(), given["height"].as<int>()};
  draw.imperfect = given.count("imperfect") != 0;
  if (given.count("only") != 0) draw.only = given["only"].as<std::string>();
  const auto reality = given["reality"].as<std::string>();
  if (reality != "first" && reality != "second")
    return bad_input("--reality " + reality + ": expected first or second");
  draw.reality = reality == "second" ? Reality::kSecond : Reality::kFirst;
  if (draw.geometry.width < 8 || draw.geometry.height < 8 || draw.geometry.pixels() > std::size_t{640} * 480) {
    return bad_input("--width, --height: expected at least 8 and at most 640x480 pixels");
  }
  ASSIGN_OR_RETURN(draw.frames_scale, number_of<double>(given, "frames-scale", 0.1, 10.0));
  return {};
}

Status draw_sessions(const Given& given, Request& request) {
  std::vector<Kind> kinds;
  for (const std::string& name : given["kind"].as<Words>()) {
    const auto kind = kind_named(name);
    for (std::size_t i = 0; name == "all" && i < kKinds; ++i) kinds.push_back(static_cast<Kind>(i));
    if (kind) kinds.push_back(*kind);
    if (!kind && name != "all") {
      return bad_input("--kind " + name +
                       ": expected effect-free, single, pair, outside, withheld, forms, bench or all");
    }
  }
  const auto first = given["first"].as<std::int64_t>();
  const auto count = given["sessions"].as<std::int64_t>();
  if (first < 0 || count < 1 || count > 100'000) {
    return bad_input("--first, --sessions: expected 0 or more, 1 to 100000");
  }
  for (const Kind kind : kinds) {
    for (std::int64_t i = first; i < first + count; ++i) {
      ASSIGN_OR_RETURN(auto session, draw_session(request.draw, kind, static_cast<std::size_t>(i)));
      request.sessions.push_back(std::move(session));
    }
  }
  return {};
}

// Makes the folder of kept files and checks that nothing in it would be overwritten.
Status prepare_kept(const Request& request) {
  if (request.keep.empty()) return {};
  RETURN_IF_ERROR(make_folder(request.keep));
  const auto files = mapped(kKeptFiles, [&](const char* name) { return request.keep / name; });
  RETURN_IF_ERROR(check_outputs(files, {}, request.replace));
  for (const Session& session : request.sessions) {
    std::error_code error;
    if (request.replace == Replace::kExisting || !fs::exists(request.kept(session), error)) continue;
    return bad_input(request.kept(session).string() + " is there already; choose another folder, or --overwrite it");
  }
  return {};
}

Result<Request> read_request(const Given& given) {
  Request request;
  request.json = given.count("json") != 0;
  request.replace = replace_of(given);
  if (given.count("keep") != 0) request.keep = fs::absolute(given["keep"].as<std::string>());
  ASSIGN_OR_RETURN(request.program, given.count("bolo") != 0
                                        ? Result<fs::path>(fs::absolute(given["bolo"].as<std::string>()))
                                        : find_own_program("bolo"));
  ASSIGN_OR_RETURN(request.jobs, number_of<int>(given, "jobs", 1, 64));
  RETURN_IF_ERROR(read_draw(given, request.draw));
  RETURN_IF_ERROR(draw_sessions(given, request));
  RETURN_IF_ERROR(prepare_kept(request));
  return request;
}

// Renames the folder instead of removing it.
Status keep_as(ScratchFolder& folder, const fs::path& target, Replace replace) {
  std::error_code error;
  if (replace == Replace::kExisting) fs::remove_all(target, error);
  fs::rename(folder.path(), target, error);
  // Another process has kept the same session in the meantime.
  if (error == std::errc::directory_not_empty || error == std::errc::file_exists) return {};
  if (error) return failed(target.string() + ": cannot be made: " + error.message());
  folder.keep();
  return {};
}

// Simulates and diagnoses one session in a private folder of a random name. A failed diagnosis is a trial without a
// finding; kFailed: disk, simulator or interrupt.
Result<Trial> run_trial(const Session& session, const Request& request) {
  ASSIGN_OR_RETURN(auto folder, request.keep.empty() ? ScratchFolder::make() : ScratchFolder::make(request.keep));
  ASSIGN_OR_RETURN(const auto captures, write_captures(session, folder.path()));
  const ChildWork work{request.program, captures, folder.path() / "report", session.withheld};
  const Status ran = run_child(work, interrupted());
  if (interrupted()) return failed("interrupted; nothing was scored");
  Trial trial{session, std::nullopt, {}};
  auto finding = ran ? read_finding(work.folder / "report.json") : tl::unexpected(ran.error());
  finding ? void(trial.finding = std::move(*finding)) : void(trial.error = finding.error().message);
  if (!request.keep.empty()) RETURN_IF_ERROR(keep_as(folder, request.kept(session), request.replace));
  return trial;
}

Result<std::vector<Trial>> run_trials(const Request& request) {
  std::vector<Trial> trials(request.sessions.size());
  Jobs jobs;
  for (std::size_t i = 0; i < trials.size(); ++i) {
    jobs.add(keep(trials[i], [&request, i] { return run_trial(request.sessions[i], request); }));
  }
  Progress progress("blind", trials.size());
  std::uint64_t done = 0;
  RETURN_IF_ERROR(jobs.run(request.jobs, progress, done));
  return trials;
}

Status keep_answers(const Request& request, const Opened& opened) {
  if (request.keep.empty()) return {};
  RETURN_IF_ERROR(write_file({request.keep / kKeptFiles[0], request.replace}, opened.answers));
  return write_file({request.keep / kKeptFiles[1], request.replace}, opened.nonce);
}

// Prints the seal before any diagnosis; with --json to stderr, as stdout carries the JSON only.
Status draw_and_score(const Request& request) {
  const auto started = std::chrono::steady_clock::now();
  ASSIGN_OR_RETURN(const auto seal, Seal::close(request.sessions));
  std::FILE* const where = request.json ? stderr : stdout;
  std::fprintf(where, "sealed %zu answers: sha256 %s\n", request.sessions.size(), seal.digest().c_str());
  std::fflush(where);
  ASSIGN_OR_RETURN(const auto trials, run_trials(request));
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - started;
  ASSIGN_OR_RETURN(const auto opened, seal.open(request.sessions));
  RETURN_IF_ERROR(keep_answers(request, opened));
  const Json scored = score(trials, {request.draw, seal.digest(), took.count()});
  if (!request.json) std::puts("opened: the answers are those that were sealed");
  print_report(scored, request.json);
  if (std::ranges::all_of(trials, [](const Trial& trial) { return trial.finding.has_value(); })) return {};
  return failed("some diagnoses broke; they are listed among the failed");
}

std::vector<std::string> words_of(const ChildWork& work) {
  std::vector<std::string> words{work.program.string(), "diagnose", "-o", work.folder.string(), "--threads", "1"};
  if (!work.withheld.empty()) words.insert(words.end(), {"--withhold", work.withheld});
  for (const auto& file : work.captures) words.push_back(file.string());
  return words;
}

std::vector<std::string> environment() {
  std::vector<std::string> out;
  for (const char* name : {"PATH", "HOME", "TMPDIR", "ASAN_OPTIONS", "LSAN_OPTIONS", "TSAN_OPTIONS", "UBSAN_OPTIONS"}) {
    if (const char* value = std::getenv(name); value != nullptr) out.push_back(std::string(name) + '=' + value);
  }
  return out;
}

std::string last_line(const std::filesystem::path& log) {
  std::ifstream in(log);
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) last = line;
  }
  return last;
}

using nlohmann::json;

// null: not measured.
double number(const json& value) {
  return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

Named named_of(const json& effect) {
  Named named{effect.at("name").get<std::string>(), {}};
  for (const auto& [key, estimate] : effect.at("parameters").items()) {
    const json& ends = estimate.at("ci95");
    named.parameters[key] = {number(estimate.at("value")), number(ends.at(0)), number(ends.at(1))};
  }
  return named;
}

}  // namespace

std::string sha256(const std::string& text) {
  const std::unique_ptr<char, decltype(&g_free)> digest(
      g_compute_checksum_for_data(G_CHECKSUM_SHA256, reinterpret_cast<const unsigned char*>(text.data()), text.size()),
      &g_free);
  return digest.get();
}

Result<Seal> Seal::close(const std::vector<Session>& sessions) {
  Seal seal;
  ASSIGN_OR_RETURN(seal.nonce_, fresh_nonce());
  seal.digest_ = sha256(canonical(sessions) + seal.nonce_);
  return seal;
}

Result<Opened> Seal::open(const std::vector<Session>& sessions) const {
  Opened opened{canonical(sessions), nonce_};
  if (sha256(opened.answers + nonce_) != digest_)
    return failed("the answers are not those that were sealed; the check is void");
  return opened;
}

Status run_child(const ChildWork& work, const std::atomic<bool>& stop) {
  const std::filesystem::path folder = work.folder.parent_path();
  ASSIGN_OR_RETURN(
      auto child,
      Process::start(
          {.words = words_of(work), .log = folder / "diagnose", .folder = folder, .variables = environment()}));
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(work.limit_s);
  std::optional<int> code;
  while (!(code = child.wait(0.02))) {
    if (stop) return failed("interrupted");
    if (std::chrono::steady_clock::now() > deadline) return failed("the diagnosis took too long");
  }
  if (*code == 0) return {};
  const std::string ending =
      *code > 128 ? "signal " + std::to_string(*code - 128) : "exit code " + std::to_string(*code);
  const std::string said = last_line(folder / "diagnose.err");
  return failed("the diagnosis ended with " + ending + (said.empty() ? "" : ": " + said));
}

Result<Finding> parse_finding(const std::string& text) {
  try {
    const json report = json::parse(text);
    if (report.at("bolo_report") != 1) return failed("report.json: not a report of version 1");
    return Finding{report.at("verdict").get<std::string>(), mapped(report.at("effects"), named_of)};
  } catch (const json::exception& e) {
    return failed(std::string("report.json: ") + e.what());
  }
}

Result<Finding> read_finding(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return failed(file.filename().string() + ": the diagnosis wrote none");
  std::ostringstream text;
  text << in.rdbuf();
  return parse_finding(text.str());
}

}  // namespace bolo::tools::blind

int bolo::tools::blind_main(int argc, char** argv) {
  return run_verb("blind", blind::command_line(), argc, argv, [](const blind::Given& given) -> Status {
    ASSIGN_OR_RETURN(const auto request, blind::read_request(given));
    return blind::draw_and_score(request);
  });
}
