// bolo blind: hides effects in simulated captures, diagnoses them without knowing, and scores.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "src/report/sheet.hpp"
#include "tools/bolo/cli.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cluster/job_run.hpp"
#include "tools/lab/blind/blind_job.hpp"
#include "tools/lab/blind/check.hpp"
#include "tools/lab/blind/request.hpp"
#include "tools/lab/blind/tables.hpp"

namespace bolo::tools {
namespace {

using blind::BlindRequest;

Status keep_answers(const blind::CheckOptions& check, const blind::Opened& opened) {
  if (check.keep.empty()) return {};
  const blind::KeptAnswers files = blind::kept_answers(check);
  Status status = write_file({files.answers, check.replace}, opened.answers);
  if (status) status = write_file({files.nonce, check.replace}, opened.nonce);
  if (!status) return status;
  return write_file({files.seal, check.replace}, opened.digest + "  sha256 of answers.json and nonce.txt\n");
}

// Where people read: beside the JSON, which is alone on stdout.
std::FILE* words_of(const BlindRequest& request) { return request.json ? stderr : stdout; }

// The seal is shown before anything is diagnosed.
void publish(const BlindRequest& request, const blind::Seal& seal) {
  std::FILE* const where = words_of(request);
  std::fprintf(where, "sealed %zu answers: sha256 %s\n", request.sessions.size(), seal.digest().c_str());
  std::fflush(where);
}

// Opens the answers and prints the score.
Status open_and_score(const BlindRequest& request, const blind::Seal& seal, const std::vector<blind::Trial>& trials,
                      double seconds) {
  const auto opened = seal.open(request.sessions);
  if (!opened) return tl::unexpected(opened.error());
  if (Status kept = keep_answers(request.check, *opened); !kept) return kept;
  const blind::Score score = blind::score(trials);
  const blind::Setting setting{request.draw, seal.digest(), seconds};
  if (!request.html.empty()) {
    if (Status page = write_file(request.html, score_html(score, setting)); !page) return page;
  }
  if (request.json) {
    std::cout << score_json(score, setting).dump(2) << '\n';
  } else {
    std::cout << "opened: the answers are those that were sealed\n" << score_text(score, setting);
  }
  std::cout.flush();
  return {};
}

bool broke(const blind::Trial& trial) { return !trial.finding; }

Status run_at_once(const BlindRequest& request) {
  const auto started = std::chrono::steady_clock::now();
  const auto seal = blind::Seal::close(request.sessions);
  if (!seal) return tl::unexpected(seal.error());
  publish(request, *seal);
  const auto trials = [&] {
    Progress progress("blind", request.sessions.size());
    return run_trials(
        request.sessions, request.check, [&progress](std::size_t done) { progress.update(done); }, interrupted());
  }();
  if (!trials) return tl::unexpected(trials.error());
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - started;
  if (Status status = open_and_score(request, *seal, *trials, took.count()); !status) return status;
  if (std::ranges::none_of(*trials, broke)) return {};
  return failed("some diagnoses broke; they are listed among the failed");
}

// Of a process that leaves sessions to others, or to another time.
void print_left(const BlindRequest& request, const blind::BlindJob& job, std::size_t left) {
  if (request.json) {
    const nlohmann::ordered_json json{{"bolo_blind", 1},
                                      {"sealed_sha256", job.seal().digest()},
                                      {"sessions", request.sessions.size()},
                                      {"left", left},
                                      {"job", request.sharing.job.string()}};
    std::puts(json.dump(2).c_str());
    return;
  }
  std::printf("%zu of %zu sessions are left; %s has the records, and the answers stay sealed until all are there\n",
              left, request.sessions.size(), request.sharing.job.c_str());
}

// Broken diagnoses have records too, and stay as they are.
Status broken_ones(const BlindRequest& request, const blind::BlindJob& job, const std::vector<blind::Trial>& trials) {
  std::string first;
  std::size_t count = 0;
  for (std::size_t i = 0; i < trials.size(); ++i) {
    if (!broke(trials[i])) continue;
    if (count++ == 0) first = job.work().pieces()[i].name;
  }
  if (count == 0) return {};
  return failed(std::to_string(count) +
                " diagnoses broke; they are listed among the failed; to try one again remove "
                "its record (" +
                (request.sharing.job / "done" / (first + ".json")).string() + ") and start again");
}

int end_of(const BlindRequest& request, const blind::BlindJob& job, const cluster::JobResult& result) {
  int code = kExitDone;
  for (const cluster::Failure& failure : result.failures) {
    const std::string& name = job.work().pieces()[failure.piece].name;
    code = std::max(code, report("blind", {failure.error.kind, failure.error.message + " (" + name + ")"}));
  }
  std::fprintf(words_of(request), "%zu sessions done in %.1f s, %zu done before\n", result.did, result.seconds,
               result.before);
  if (!result.ranks.empty()) std::fprintf(words_of(request), "%s\n", cluster::ranks_text(result).c_str());
  std::fflush(words_of(request));
  const std::vector<blind::Trial> trials = job.finish();
  if (trials.size() < request.sessions.size()) {
    print_left(request, job, request.sessions.size() - trials.size());
    return code;
  }
  Status status = open_and_score(request, job.seal(), trials, result.seconds);
  if (status) status = broken_ones(request, job, trials);
  return status ? code : report("blind", status.error());
}

int run_in_job(const BlindRequest& request) {
  blind::BlindJob job(request, [&request](const blind::Seal& seal) { publish(request, seal); });
  if (!request.ranks) {
    const auto result = cluster::run_alone(job, request.sharing, "blind", request.check.jobs);
    return result ? end_of(request, job, *result) : report("blind", result.error());
  }
  const auto result = cluster::run_ranks(job, request.sharing, "blind");
  if (!result) return cluster::report_rank("blind", result.error());
  return *result ? end_of(request, job, **result) : kExitDone;
}

int run(const cxxopts::ParseResult& args) {
  const auto request = blind::read_blind_request(args);
  if (!request) return cluster::report_once("blind", request.error());
  catch_interrupts();
  if (!request->sharing.job.empty()) return run_in_job(*request);
  const Status status = run_at_once(*request);
  return status ? kExitDone : report("blind", status.error());
}

}  // namespace

int blind_main(int argc, char** argv) {
  cxxopts::Options options = blind::blind_command_line();
  cxxopts::ParseResult args;
  if (const auto code = parse(options, argc, argv, args)) return *code;
  try {
    return run(args);
  } catch (const std::bad_alloc&) {
    return report("blind", Error{ErrorKind::kFailed, "not enough memory; take fewer sessions"});
  }
}

}  // namespace bolo::tools
