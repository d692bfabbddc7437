// bolo blind: hides effects in simulated captures, diagnoses them without knowing, and scores.
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "bolo/plot/sheet.hpp"
#include "tools/blind/check.hpp"
#include "tools/blind/tables.hpp"
#include "tools/verbs/cli.hpp"
#include "tools/verbs/verbs.hpp"

namespace bolo::tools {
namespace {

using Given = cxxopts::ParseResult;
using Words = std::vector<std::string>;

cxxopts::Options declare() {
  cxxopts::Options options(
      "bolo blind",
      "Draws bench sessions with hidden effects, seals the answers, diagnoses the captures in processes that cannot\n"
      "read them, opens the answers and scores. A session is six captures of about 2,000 frames in all.");
  const auto number = [](const char* value) { return cxxopts::value<double>()->default_value(value); };
  const auto count = [](const char* value) { return cxxopts::value<std::int64_t>()->default_value(value); };
  options.add_options("Sessions")("kind", "effect-free, single, pair, outside, withheld, forms, or all; repeatable",
                                  cxxopts::value<Words>()->default_value("all"))(
      "sessions", "Of each kind", count("29"))("first", "Index of the first session of each kind", count("0"))(
      "only", "The effect of every session", cxxopts::value<std::string>(), "EFFECT")(
      "imperfect", "The stimuli have errors of their own")("magnitude", "Of the effects' strength, 1: realistic",
                                                           number("1"))(
      "seed", "The same sessions each time", cxxopts::value<std::uint64_t>()->default_value("1"))(
      "width", "Pixels", cxxopts::value<int>()->default_value("32"))(
      "height", "Pixels", cxxopts::value<int>()->default_value("24"))("frames-scale", "Of the captures' lengths",
                                                                      number("1"));
  options.add_options("Run")("jobs", "Sessions at the same time", cxxopts::value<int>()->default_value("2"))(
      "keep", "Keep captures, reports and answers here", cxxopts::value<std::string>(), "DIR")(
      "html", "Write the score as a page", cxxopts::value<std::string>(), "FILE")("json", "Print the score as JSON");
  return options;
}

Result<blind::DrawOptions> draw_of(const Given& given) {
  blind::DrawOptions draw;
  draw.seed = given["seed"].as<std::uint64_t>();
  draw.geometry = {given["width"].as<int>(), given["height"].as<int>()};
  draw.frames_scale = given["frames-scale"].as<double>();
  draw.magnitude = given["magnitude"].as<double>();
  draw.imperfect = given.count("imperfect") != 0;
  if (given.count("only") != 0) draw.only = given["only"].as<std::string>();
  if (draw.geometry.width < 8 || draw.geometry.height < 8 || draw.geometry.pixels() > std::size_t{640} * 480) {
    return bad_input("--width, --height: expected at least 8 and at most 640x480 pixels");
  }
  if (!(draw.frames_scale >= 0.1 && draw.frames_scale <= 10.0)) return bad_input("--frames-scale: expected 0.1 to 10");
  if (!(draw.magnitude > 0.0 && draw.magnitude <= 2.0)) return bad_input("--magnitude: expected above 0, up to 2");
  return draw;
}

Result<std::vector<blind::Kind>> kinds_of(const Given& given) {
  std::vector<blind::Kind> kinds;
  for (const std::string& name : given["kind"].as<Words>()) {
    const auto kind = blind::kind_named(name);
    for (std::size_t i = 0; name == "all" && i < blind::kKinds; ++i) kinds.push_back(static_cast<blind::Kind>(i));
    if (kind) kinds.push_back(*kind);
    if (!kind && name != "all") {
      return bad_input("--kind " + name + ": expected effect-free, single, pair, outside, withheld, forms or all");
    }
  }
  return kinds;
}

Result<std::vector<blind::Session>> sessions_of(const Given& given, const blind::DrawOptions& draw) {
  const auto kinds = kinds_of(given);
  if (!kinds) return tl::unexpected(kinds.error());
  const auto first = given["first"].as<std::int64_t>();
  const auto count = given["sessions"].as<std::int64_t>();
  if (first < 0 || count < 1 || count > 100'000)
    return bad_input("--first, --sessions: expected 0 or more, 1 to 100000");
  std::vector<blind::Session> sessions;
  for (const blind::Kind kind : *kinds) {
    for (std::int64_t i = first; i < first + count; ++i) {
      auto session = blind::draw_session(draw, kind, static_cast<std::size_t>(i));
      if (!session) return tl::unexpected(session.error());
      sessions.push_back(std::move(*session));
    }
  }
  return sessions;
}

Result<blind::CheckOptions> check_options(const Given& given) {
  blind::CheckOptions options;
  options.jobs = given["jobs"].as<int>();
  if (options.jobs < 1 || options.jobs > 64) return bad_input("--jobs: expected 1 to 64");
  std::error_code error;
  options.program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return failed("/proc/self/exe: " + error.message());
  if (given.count("keep") == 0) return options;
  options.keep = std::filesystem::absolute(given["keep"].as<std::string>());
  std::filesystem::create_directories(options.keep, error);
  if (error) return bad_input(options.keep.string() + ": cannot be made a folder: " + error.message());
  return options;
}

Status keep_answers(const std::filesystem::path& folder, const blind::Opened& opened) {
  if (folder.empty()) return {};
  Status status = plot::write_text(folder / "answers.json", opened.answers);
  if (status) status = plot::write_text(folder / "nonce.txt", opened.nonce);
  return status ? plot::write_text(folder / "seal.txt", opened.digest + "  sha256 of answers.json and nonce.txt\n")
                : status;
}

// The answers are sealed and the seal shown before anything is diagnosed.
Result<blind::Seal> sealed(const std::vector<blind::Session>& sessions, bool json) {
  auto seal = blind::Seal::close(sessions);
  if (!seal) return seal;
  std::FILE* const where = json ? stderr : stdout;
  std::fprintf(where, "sealed %zu answers: sha256 %s\n", sessions.size(), seal->digest().c_str());
  std::fflush(where);
  return seal;
}

bool any_broken(const blind::Score& score) {
  for (const auto& [kind, of_kind] : score.kinds) {
    if (of_kind.broken > 0) return true;
  }
  return false;
}

Status run(const Given& given) {
  const auto started = std::chrono::steady_clock::now();
  const auto draw = draw_of(given);
  if (!draw) return tl::unexpected(draw.error());
  const auto options = check_options(given);
  if (!options) return tl::unexpected(options.error());
  const auto sessions = sessions_of(given, *draw);
  if (!sessions) return tl::unexpected(sessions.error());
  const bool json = given.count("json") != 0;
  const auto seal = sealed(*sessions, json);
  if (!seal) return tl::unexpected(seal.error());

  catch_interrupts();
  auto trials = [&] {
    Progress progress("blind", sessions->size());
    return run_trials(
        *sessions, *options, [&progress](std::size_t done) { progress.update(done); }, interrupted());
  }();
  if (!trials) return tl::unexpected(trials.error());
  const auto opened = seal->open(*sessions);
  if (!opened) return tl::unexpected(opened.error());
  if (Status kept = keep_answers(options->keep, *opened); !kept) return kept;

  const blind::Score score = blind::score(*trials);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - started;
  const blind::Setting setting{*draw, seal->digest(), took.count()};
  if (given.count("html") != 0) {
    if (Status page = plot::write_text(given["html"].as<std::string>(), score_html(score, setting)); !page) return page;
  }
  if (json) {
    std::cout << score_json(score, setting).dump(2) << '\n';
  } else {
    std::cout << "opened: the answers are those that were sealed\n" << score_text(score, setting);
  }
  return any_broken(score) ? failed("some diagnoses broke; they are listed among the failed") : Status{};
}

}  // namespace

int blind_main(int argc, char** argv) {
  cxxopts::Options options = declare();
  Given given;
  if (const auto code = parse(options, argc, argv, given)) return *code;
  try {
    const Status status = run(given);
    return status ? kExitDone : report("blind", status.error());
  } catch (const std::bad_alloc&) {
    return report("blind", Error{ErrorKind::kFailed, "not enough memory; take fewer sessions"});
  }
}

}  // namespace bolo::tools
