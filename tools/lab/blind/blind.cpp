#include "tools/lab/blind/blind.hpp"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <utility>

#include <glib.h>

#include "tools/cli/process.hpp"
#include "tools/lab/blind/diagnosis.hpp"
#include "tools/lab/blind/score.hpp"
#include "tools/lab/blind/session.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools::blind {
namespace {

namespace fs = std::filesystem;
using Given = cxxopts::ParseResult;
using Words = std::vector<std::string>;

// Sorted keys, no blanks, shortest numbers that read back the same: one text for one set of answers.
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
  fs::path program;               // whose `diagnose` is checked
  fs::path keep;                  // empty: captures and reports are deleted
  int jobs = 2;
  Replace replace = Replace::kNothing;  // of what is kept
  bool json = false;

  fs::path kept(const Session& session) const {
    return keep / (std::string(name_of(session.kind)) + '-' + std::to_string(session.index));
  }
};

constexpr std::array kKeptFiles{"answers.json", "nonce.txt", "seal.txt"};

cxxopts::Options command_line() {
  cxxopts::Options options(
      "bolo-lab blind",
      "Draws bench sessions with hidden effects, seals the answers, diagnoses the captures in processes that cannot\n"
      "read them, opens the answers and scores. A session is six captures of about 2,000 frames in all.");
  const auto number = [](const char* value) { return cxxopts::value<double>()->default_value(value); };
  const auto count = [](const char* value) { return cxxopts::value<std::int64_t>()->default_value(value); };
  const auto pixels = [](const char* value) { return cxxopts::value<int>()->default_value(value); };
  options.add_options("Sessions")("kind",
                                  "effect-free, single, pair, outside, withheld, forms, bench, or all; repeatable",
                                  cxxopts::value<Words>()->default_value("all"))(
      "sessions", "Of each kind", count("29"))("first", "Index of the first session of each kind", count("0"))(
      "only", "The effect of every session", cxxopts::value<std::string>(), "EFFECT")(
      "imperfect", "The stimuli have errors of their own")(
      "reality", "first: the project's simulator; second: a camera and a bench that share nothing with it",
      cxxopts::value<std::string>()->default_value("first"))("magnitude", "Of the effects' strength, 1: realistic",
                                                             number("1"))(
      "seed", "The same sessions each time", cxxopts::value<std::uint64_t>()->default_value("1"))(
      "width", "Pixels", pixels("32"))("height", "Pixels", pixels("24"))("frames-scale", "Of the captures' lengths",
                                                                         number("1"));
  options.add_options("Run")("bolo", "Whose diagnosis is checked (default: the one beside this program)",
                             cxxopts::value<std::string>(),
                             "PROGRAM")("jobs", "Sessions at the same time", cxxopts::value<int>()->default_value("2"))(
      "keep", "Keep captures, reports and answers here", cxxopts::value<std::string>(), "DIR")(
      "json", "Print the score as JSON");
  add_overwrite_option(options);
  return options;
}

Status read_draw(const Given& given, DrawOptions& draw) {
  draw.seed = given["seed"].as<std::uint64_t>();
  draw.geometry = {given["width"].as<int>(), given["height"].as<int>()};
  draw.frames_scale = given["frames-scale"].as<double>();
  draw.magnitude = given["magnitude"].as<double>();
  draw.imperfect = given.count("imperfect") != 0;
  if (given.count("only") != 0) draw.only = given["only"].as<std::string>();
  const auto reality = given["reality"].as<std::string>();
  if (reality != "first" && reality != "second")
    return bad_input("--reality " + reality + ": expected first or second");
  draw.reality = reality == "second" ? Reality::kSecond : Reality::kFirst;
  if (draw.geometry.width < 8 || draw.geometry.height < 8 || draw.geometry.pixels() > std::size_t{640} * 480) {
    return bad_input("--width, --height: expected at least 8 and at most 640x480 pixels");
  }
  if (!(draw.magnitude > 0.0 && draw.magnitude <= 2.0)) return bad_input("--magnitude: expected above 0, up to 2");
  return within(draw.frames_scale, "frames-scale", 0.1, 10.0);
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
      auto session = draw_session(request.draw, kind, static_cast<std::size_t>(i));
      if (!session) return tl::unexpected(session.error());
      request.sessions.push_back(std::move(*session));
    }
  }
  return {};
}

// Makes the folder that is to keep everything, and sees that nothing stands there in the way.
Status prepare_kept(const Request& request) {
  if (request.keep.empty()) return {};
  std::error_code error;
  fs::create_directories(request.keep, error);
  if (error) return bad_input(request.keep.string() + ": cannot be made a folder: " + error.message());
  std::vector<fs::path> files;
  files.reserve(kKeptFiles.size());
  for (const char* name : kKeptFiles) files.push_back(request.keep / name);
  if (Status good = check_outputs(files, {}, request.replace); !good) return good;
  for (const Session& session : request.sessions) {
    if (request.replace == Replace::kExisting || !fs::exists(request.kept(session), error)) continue;
    return bad_input(request.kept(session).string() + " is there already; choose another folder, or --overwrite it");
  }
  return {};
}

Result<Request> read_request(const Given& given) {
  Request request;
  request.json = given.count("json") != 0;
  request.replace = replace_of(given);
  request.jobs = given["jobs"].as<int>();
  if (given.count("keep") != 0) request.keep = fs::absolute(given["keep"].as<std::string>());
  auto program = given.count("bolo") != 0 ? Result<fs::path>(fs::absolute(given["bolo"].as<std::string>()))
                                          : find_own_program("bolo");
  if (!program) return tl::unexpected(program.error());
  request.program = std::move(*program);
  Status status = within(request.jobs, "jobs", 1, 64);
  if (status) status = read_draw(given, request.draw);
  if (status) status = draw_sessions(given, request);
  if (status) status = prepare_kept(request);
  if (!status) return tl::unexpected(status.error());
  return request;
}

// Gives the folder a name instead of removing it.
Status keep_as(ScratchFolder& folder, const fs::path& target, Replace replace) {
  std::error_code error;
  if (replace == Replace::kExisting) fs::remove_all(target, error);
  fs::rename(folder.path(), target, error);
  // Somebody else has just kept the same session there, which is as good.
  if (error == std::errc::directory_not_empty || error == std::errc::file_exists) return {};
  if (error) return failed(target.string() + ": cannot be made: " + error.message());
  folder.keep();
  return {};
}

// Simulates and diagnoses one session in a folder that only this user can enter, named after nothing. A diagnosis that
// broke is a trial without a finding; kFailed: the disk, the simulator, or an interrupt.
Result<Trial> run_trial(const Session& session, const Request& request) {
  const auto started = std::chrono::steady_clock::now();
  auto folder = request.keep.empty() ? ScratchFolder::make() : ScratchFolder::make(request.keep);
  if (!folder) return tl::unexpected(folder.error());
  auto captures = write_captures(session, folder->path());
  if (!captures) return tl::unexpected(captures.error());
  const ChildWork work{request.program, std::move(*captures), folder->path() / "report", session.withheld};
  const Status ran = run_child(work, interrupted());
  if (interrupted()) return failed("interrupted; nothing was scored");
  Trial trial{session, std::nullopt, {}, 0.0};
  auto finding = ran ? read_finding(work.folder / "report.json") : tl::unexpected(ran.error());
  finding ? void(trial.finding = std::move(*finding)) : void(trial.error = finding.error().message);
  trial.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  if (request.keep.empty()) return trial;
  const Status kept = keep_as(*folder, request.kept(session), request.replace);
  return kept ? Result<Trial>(std::move(trial)) : tl::unexpected(kept.error());
}

Result<std::vector<Trial>> run_trials(const Request& request) {
  std::vector<std::optional<Trial>> places(request.sessions.size());
  Jobs jobs;
  for (std::size_t i = 0; i < places.size(); ++i) {
    jobs.add(keep(places[i], [&request, i] { return run_trial(request.sessions[i], request); }));
  }
  Progress progress("blind", places.size());
  std::uint64_t done = 0;
  if (Status ran = jobs.run(request.jobs, progress, done); !ran) return tl::unexpected(ran.error());
  std::vector<Trial> trials;
  trials.reserve(places.size());
  for (std::optional<Trial>& place : places) trials.push_back(std::move(*place));
  return trials;
}

Status keep_answers(const Request& request, const Opened& opened) {
  if (request.keep.empty()) return {};
  const std::array texts{opened.answers, opened.nonce, opened.digest + "  sha256 of answers.json and nonce.txt\n"};
  for (std::size_t i = 0; i < texts.size(); ++i) {
    if (Status kept = write_file({request.keep / kKeptFiles[i], request.replace}, texts[i]); !kept) return kept;
  }
  return {};
}

// The seal is shown before anything is diagnosed, beside the JSON, which is alone on stdout.
Status draw_and_score(const Request& request) {
  const auto started = std::chrono::steady_clock::now();
  const auto seal = Seal::close(request.sessions);
  if (!seal) return tl::unexpected(seal.error());
  std::FILE* const where = request.json ? stderr : stdout;
  std::fprintf(where, "sealed %zu answers: sha256 %s\n", request.sessions.size(), seal->digest().c_str());
  std::fflush(where);
  const auto trials = run_trials(request);
  if (!trials) return tl::unexpected(trials.error());
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - started;
  const auto opened = seal->open(request.sessions);
  if (!opened) return tl::unexpected(opened.error());
  if (Status kept = keep_answers(request, *opened); !kept) return kept;
  const Score scored = score(*trials);
  const Setting setting{request.draw, seal->digest(), took.count()};
  if (request.json) {
    // A broken diagnosis may have said anything, no UTF-8 included.
    std::cout << score_json(scored, setting).dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
  } else {
    std::cout << "opened: the answers are those that were sealed\n" << score_text(scored, setting);
  }
  std::cout.flush();
  if (std::ranges::all_of(*trials, [](const Trial& trial) { return trial.finding.has_value(); })) return {};
  return failed("some diagnoses broke; they are listed among the failed");
}

}  // namespace

std::string sha256(const std::string& text) {
  const std::unique_ptr<char, decltype(&g_free)> digest(
      g_compute_checksum_for_data(G_CHECKSUM_SHA256, reinterpret_cast<const unsigned char*>(text.data()), text.size()),
      &g_free);
  return digest.get();
}

Result<Seal> Seal::close(const std::vector<Session>& sessions) {
  auto nonce = fresh_nonce();
  if (!nonce) return tl::unexpected(nonce.error());
  Seal seal;
  seal.nonce_ = std::move(*nonce);
  seal.digest_ = sha256(canonical(sessions) + seal.nonce_);
  return seal;
}

Result<Opened> Seal::open(const std::vector<Session>& sessions) const {
  Opened opened{canonical(sessions), nonce_, {}};
  opened.digest = sha256(opened.answers + nonce_);
  if (opened.digest != digest_) return failed("the answers are not those that were sealed; the check is void");
  return opened;
}

int blind_main(int argc, char** argv) {
  return run_verb("blind", command_line(), argc, argv, [](const Given& given) -> Status {
    const auto request = read_request(given);
    return request ? draw_and_score(*request) : tl::unexpected(request.error());
  });
}

}  // namespace bolo::tools::blind
