// bolo-lab blind: hides effects in simulated captures, diagnoses them without knowing, and scores.
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
#include "tools/cli/cli.hpp"
#include "tools/lab/blind/check.hpp"
#include "tools/lab/blind/request.hpp"
#include "tools/lab/blind/seal.hpp"
#include "tools/lab/blind/tables.hpp"
#include "tools/lab/verbs.hpp"

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

Status draw_and_score(const BlindRequest& request) {
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

int run(const cxxopts::ParseResult& args) {
  const auto request = blind::read_blind_request(args);
  if (!request) return report("blind", request.error());
  catch_interrupts();
  const Status status = draw_and_score(*request);
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
