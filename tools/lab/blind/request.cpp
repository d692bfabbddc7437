#include "tools/lab/blind/request.hpp"

#include <string>
#include <system_error>
#include <utility>

#include "tools/cli/cli.hpp"
#include "tools/cli/process.hpp"

namespace bolo::tools::blind {
namespace {

using Given = cxxopts::ParseResult;
using Words = std::vector<std::string>;

Status read_draw(const Given& given, DrawOptions& draw) {
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
  return {};
}

Status read_kinds(const Given& given, std::vector<Kind>& kinds) {
  for (const std::string& name : given["kind"].as<Words>()) {
    const auto kind = kind_named(name);
    for (std::size_t i = 0; name == "all" && i < kKinds; ++i) kinds.push_back(static_cast<Kind>(i));
    if (kind) kinds.push_back(*kind);
    if (!kind && name != "all") {
      return bad_input("--kind " + name + ": expected effect-free, single, pair, outside, withheld, forms or all");
    }
  }
  return {};
}

Status draw_sessions(const Given& given, BlindRequest& request) {
  if (Status status = read_kinds(given, request.kinds); !status) return status;
  request.first = given["first"].as<std::int64_t>();
  request.count = given["sessions"].as<std::int64_t>();
  if (request.first < 0 || request.count < 1 || request.count > 100'000) {
    return bad_input("--first, --sessions: expected 0 or more, 1 to 100000");
  }
  for (const Kind kind : request.kinds) {
    for (std::int64_t i = request.first; i < request.first + request.count; ++i) {
      auto session = draw_session(request.draw, kind, static_cast<std::size_t>(i));
      if (!session) return tl::unexpected(session.error());
      request.sessions.push_back(std::move(*session));
    }
  }
  return {};
}

Status read_check(const Given& given, CheckOptions& options) {
  options.jobs = given["jobs"].as<int>();
  if (options.jobs < 1 || options.jobs > 64) return bad_input("--jobs: expected 1 to 64");
  std::error_code error;
  if (given.count("bolo") != 0) {
    options.program = std::filesystem::absolute(given["bolo"].as<std::string>(), error);
  } else {
    auto found = find_own_program("bolo");
    if (!found) return tl::unexpected(found.error());
    options.program = std::move(*found);
  }
  if (given.count("keep") == 0) return {};
  options.keep = std::filesystem::absolute(given["keep"].as<std::string>());
  std::filesystem::create_directories(options.keep, error);
  if (error) return bad_input(options.keep.string() + ": cannot be made a folder: " + error.message());
  return {};
}

Status check_kept(const BlindRequest& request) {
  const CheckOptions& check = request.check;
  std::vector<std::filesystem::path> files{request.html.path};
  if (!check.keep.empty()) {
    const KeptAnswers kept = kept_answers(check);
    files.insert(files.end(), {kept.answers, kept.nonce, kept.seal});
  }
  if (Status good = check_outputs(files, {}, check.replace); !good) return good;
  if (check.keep.empty() || check.replace == Replace::kExisting) return {};
  for (const Session& session : request.sessions) {
    const std::filesystem::path folder = kept_folder(session, check);
    std::error_code ignored;
    if (std::filesystem::exists(folder, ignored)) {
      return bad_input(folder.string() + " is there already; choose another folder, or --overwrite it");
    }
  }
  return {};
}

}  // namespace

cxxopts::Options blind_command_line() {
  cxxopts::Options options(
      "bolo-lab blind",
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
  options.add_options("Run")("bolo", "Whose diagnosis is checked (default: the one beside this program)",
                             cxxopts::value<std::string>(),
                             "PROGRAM")("jobs", "Sessions at the same time", cxxopts::value<int>()->default_value("2"))(
      "keep", "Keep captures, reports and answers here", cxxopts::value<std::string>(), "DIR")(
      "html", "Write the score as a page", cxxopts::value<std::string>(), "FILE")("json", "Print the score as JSON");
  add_overwrite_option(options);
  return options;
}

Result<BlindRequest> read_blind_request(const cxxopts::ParseResult& args) {
  BlindRequest request;
  request.json = args.count("json") != 0;
  request.check.replace = replace_of(args);
  if (args.count("html") != 0) request.html = {args["html"].as<std::string>(), request.check.replace};
  Status status = read_draw(args, request.draw);
  if (status) status = read_check(args, request.check);
  if (status) status = draw_sessions(args, request);
  if (status) status = check_kept(request);
  if (!status) return tl::unexpected(status.error());
  return request;
}

}  // namespace bolo::tools::blind
