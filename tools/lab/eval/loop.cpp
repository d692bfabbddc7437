#include "tools/lab/eval/loop.hpp"

#include <cstdlib>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/diagnose/diagnose.hpp"
#include "tools/cli/cli.hpp"
#include "tools/cli/plot_option.hpp"
#include "tools/lab/blind/captures.hpp"
#include "tools/lab/eval/loop_camera.hpp"
#include "tools/lab/eval/loop_plot.hpp"

namespace bolo::tools {
namespace {

using loop::Row;

struct Request {
  std::vector<std::string> effects;
  blind::DrawOptions draw;
  int threads = 2;
  OutputFile plot;
  bool json = false;
};

cxxopts::Options command_line() {
  cxxopts::Options options(
      "bolo-lab eval loop",
      "For each effect: simulates a bench session and a moving scene of one camera, diagnoses the session without "
      "being\n"
      "told, and deblurs the scene with the nominal profile, the diagnosed one, and the true one.");
  options.add_options()("effects", "Of the catalogue, separated by commas (default: all)",
                        cxxopts::value<std::vector<std::string>>(),
                        "A,B")("seed", "Another one draws other strengths and another camera",
                               cxxopts::value<std::uint64_t>()->default_value("1"),
                               "N")("threads", "Of a diagnosis", cxxopts::value<int>()->default_value("2"), "W")(
      "frames-scale", "Of the bench captures' lengths", cxxopts::value<double>()->default_value("1"), "S")(
      "json", "Print the table as JSON");
  add_plot_option(options, "Draw the table");
  return options;
}

Result<Request> read_request(const cxxopts::ParseResult& args) {
  Request request;
  const std::vector<std::string> all = blind::effects_of(blind::Kind::kSingle);
  request.effects = args.count("effects") != 0 ? args["effects"].as<std::vector<std::string>>() : all;
  for (const std::string& name : request.effects) {
    if (std::ranges::find(all, name) == all.end()) {
      return bad_input("--effects " + name + ": no effect of the catalogue; 'bolo simulate --list-effects' names them");
    }
  }
  request.draw.seed = args["seed"].as<std::uint64_t>();
  request.draw.frames_scale = args["frames-scale"].as<double>();
  if (!(request.draw.frames_scale >= 0.1 && request.draw.frames_scale <= 10.0)) {
    return bad_input("--frames-scale: expected 0.1 to 10");
  }
  request.threads = args["threads"].as<int>();
  if (request.threads < 1 || request.threads > 64) return bad_input("--threads: expected 1 to 64");
  auto plot = plot_file_of(args);
  if (!plot) return tl::unexpected(plot.error());
  request.plot = std::move(*plot);
  request.json = args.count("json") != 0;
  return request;
}

// A folder for captures that nobody keeps.
class Scratch {
 public:
  Scratch() : path_((std::filesystem::temp_directory_path() / "bolo-loop-XXXXXX").string()) {
    made_ = mkdtemp(path_.data()) != nullptr;
  }
  ~Scratch() {
    std::error_code ignored;
    if (made_) std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  bool made() const { return made_; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  bool made_ = false;
};

Result<diagnose::Report> diagnosed(const blind::Session& session, const Request& request) {
  const Scratch scratch;
  if (!scratch.made()) return failed("no folder can be made in the temporary directory; set TMPDIR");
  const auto files = blind::write_captures(session, scratch.path());
  if (!files) return tl::unexpected(files.error());
  diagnose::Options options;
  options.threads = request.threads;
  options.maps = true;
  return diagnose::diagnose(*files, options,
                            [](const std::string&, double) { return !interrupted().load(std::memory_order_relaxed); });
}

Result<Row> row_of(const std::string& effect, const Request& request) {
  blind::DrawOptions draw = request.draw;
  draw.only = effect;
  const auto session = blind::draw_session(draw, blind::Kind::kSingle, 0);
  if (!session) return tl::unexpected(session.error());
  const auto report = diagnosed(*session, request);
  if (!report) return tl::unexpected(report.error());
  const auto scene = loop::record_scene(*session, true);
  if (!scene) return tl::unexpected(scene.error());
  const auto clean = loop::record_scene(*session, false);
  if (!clean) return tl::unexpected(clean.error());
  const auto truth = loop::true_profile(*session);
  if (!truth) return tl::unexpected(truth.error());

  Row row;
  row.effect = effect;
  for (const diagnose::FoundEffect& found : report->effects) row.found.push_back(found.name);
  const std::pair<double*, Result<double>> errors[] = {
      {&row.without_k, loop::deblurred_error(*clean, {})},
      {&row.nominal_k, loop::deblurred_error(*scene, {})},
      {&row.diagnosed_k, loop::deblurred_error(*scene, report->learned)},
      {&row.true_k, loop::deblurred_error(*scene, *truth)}};
  for (const auto& [into, error] : errors) {
    if (!error) return tl::unexpected(error.error());
    *into = *error;
  }
  return row;
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
  return text.empty() ? "-" : text;
}

void print_header() {
  std::printf("%-25s %9s %9s %9s %9s %7s %9s  %s\n", "effect", "without", "nominal", "diagnosed", "true", "hurts",
              "recovered", "found");
}

void print_row(const Row& row) {
  char share[32] = "-";
  if (const auto recovered = row.recovered()) std::snprintf(share, sizeof share, "%.0f %%", 100.0 * *recovered);
  std::printf("%-25s %9.4f %9.4f %9.4f %9.4f %5.0f %% %9s  %s\n", row.effect.c_str(), row.without_k, row.nominal_k,
              row.diagnosed_k, row.true_k, 100.0 * row.hurts(), share, joined(row.found).c_str());
  std::fflush(stdout);
}

void print_json(const std::vector<Row>& rows, const Request& request) {
  nlohmann::ordered_json json{{"seed", request.draw.seed}, {"rows", nlohmann::ordered_json::array()}};
  for (const Row& row : rows) {
    nlohmann::ordered_json one{{"effect", row.effect},       {"without_k", row.without_k},
                               {"nominal_k", row.nominal_k}, {"diagnosed_k", row.diagnosed_k},
                               {"true_k", row.true_k},       {"hurts", row.hurts()},
                               {"recovered_share", nullptr}, {"found", row.found}};
    if (const auto recovered = row.recovered()) one["recovered_share"] = *recovered;
    json["rows"].push_back(std::move(one));
  }
  std::puts(json.dump(2).c_str());
}

Status run(const Request& request) {
  catch_interrupts();
  std::vector<Row> rows;
  Progress progress("effects", request.effects.size());
  if (!request.json) print_header();
  for (const std::string& effect : request.effects) {
    auto row = row_of(effect, request);
    if (interrupted().load(std::memory_order_relaxed)) return failed("interrupted");
    if (!row) return at(effect, row.error());
    if (!request.json) print_row(*row);
    rows.push_back(std::move(*row));
    progress.update(rows.size());
  }
  if (request.json) print_json(rows, request);
  if (!request.json) {
    std::puts(
        "RMSE of the deblurred scene against the truth, K. hurts: nominal against the camera without the effect;\n"
        "recovered: (nominal - diagnosed) / (nominal - true), - where true parameters gain less than 1 %.");
  }
  if (request.plot.empty()) return {};
  plot::Sheet sheet = loop::sheet_of(rows);
  sheet.how =
      "bolo-lab eval loop --seed " + std::to_string(request.draw.seed) + ": simulated camera, bench session and scene.";
  return save(sheet, request.plot);
}

}  // namespace

int eval_loop_main(int argc, char** argv) {
  cxxopts::Options options = command_line();
  cxxopts::ParseResult args;
  if (const auto code = parse(options, argc, argv, args)) return *code;
  const auto request = read_request(args);
  if (!request) return report("eval loop", request.error());
  const Status done = run(*request);
  return done ? kExitDone : report("eval loop", done.error());
}

}  // namespace bolo::tools
