#include "tools/deblur/capture_run.hpp"

#include <cstdio>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "tools/cli/cli.hpp"
#include "tools/deblur/pixel_choice.hpp"

namespace bolo::tools {
namespace {

using Json = nlohmann::ordered_json;

unsigned long long count(std::uint64_t n) { return n; }

double ms_per_frame(const RunFacts& facts) {
  return facts.frames_out == 0 ? 0.0 : facts.deblur_ms / static_cast<double>(facts.frames_out);
}

Json rmse_json(const std::optional<Rmse>& rmse) {
  if (!rmse) return nullptr;
  return {{"blurred_k", rmse->blurred_k}, {"deblurred_k", rmse->deblurred_k}};
}

// Sums over the captures; common values are taken from the first one.
Json common_json(const DeblurRequest& request, const std::vector<CaptureSummary>& captures, double seconds) {
  RunFacts all;
  std::uint64_t frames_in = 0;
  if (!captures.empty()) all = captures.front().facts;
  all.frames_out = all.lost = 0;
  all.gyro = {};
  all.deblur_ms = 0.0;
  for (const CaptureSummary& capture : captures) {
    frames_in += capture.frames_in;
    all.frames_out += capture.facts.frames_out;
    all.lost += capture.facts.lost;
    all.deblur_ms += capture.facts.deblur_ms;
    for (std::size_t i = 0; i < kGyroUses; ++i) all.gyro[i] += capture.facts.gyro[i];
  }
  Json json{{"frames_in", frames_in},
            {"frames_out", all.frames_out},
            {"lost", all.lost},
            {"ms_per_frame", ms_per_frame(all)},
            {"seconds", seconds}};
  const deblur::Settings& s = all.settings;
  json["settings"] = {{"solver", deblur::name(s.method)},
                      {"tau_s", s.tau_s},
                      {"period_s", s.period_s},
                      {"kappa", s.kappa},
                      {"lambda", s.lambda},
                      {"auto_lambda", s.auto_lambda},
                      {"noise_k", s.noise_k},
                      {"iterations", s.iterations},
                      {"window", s.window},
                      {"levels", s.levels},
                      {"lookahead", s.lookahead},
                      {"threads", request.options.workers},
                      {"isa", all.isa}};
  json["roi"] = nullptr;
  if (request.options.region) json["roi"] = describe_region(*request.options.region);
  json["points"] = captures.empty() ? 0 : captures.front().points;
  json["maps"] = request.maps_file.filename().string();
  for (std::size_t i = 0; request.gyro != nullptr && i < kGyroUses; ++i)
    json["gyro"][name(static_cast<GyroUse>(i))] = all.gyro[i];
  json["rmse"] = captures.size() == 1 ? rmse_json(all.rmse) : Json(nullptr);
  return json;
}

Json names(const std::vector<std::filesystem::path>& files) {
  Json all = Json::array();
  for (const std::filesystem::path& file : files) all.push_back(file.string());
  return all;
}

Json folder_json(const DeblurRequest& request, const FolderSummary& s) {
  Json json = common_json(request, s.captures, s.seconds);
  json["captures"] = Json::array();
  for (const CaptureSummary& capture : s.captures) {
    json["captures"].push_back({{"input", capture.file.input.string()},
                                {"output", capture.file.output.string()},
                                {"frames_in", capture.frames_in},
                                {"frames_out", capture.facts.frames_out},
                                {"lost", capture.facts.lost},
                                {"ms_per_frame", ms_per_frame(capture.facts)},
                                {"rmse", rmse_json(capture.facts.rmse)}});
  }
  json["failed"] = Json::array();
  for (const FailedCapture& failed : s.failed) {
    json["failed"].push_back({{"input", failed.file.string()}, {"error", failed.error.message}});
  }
  json["skipped"] = names(s.skipped);
  json["elsewhere"] = names(s.elsewhere);
  json["shard"] = {{"index", request.share.index}, {"count", request.share.count}, {"from", request.share.from}};
  return json;
}

// File names may not be UTF-8, which JSON requires.
void print(const Json& json) { std::puts(json_text(json, 2).c_str()); }

// `more`: appended to the first line.
void print_one(const DeblurRequest& request, const CaptureSummary& capture, const std::string& more) {
  const RunFacts& facts = capture.facts;
  std::printf("%s: %llu of %llu frames (%llu lost before), %s, %.3f ms a frame%s\n",
              printable(capture.file.output.string()).c_str(), count(facts.frames_out), count(capture.frames_in),
              count(facts.lost), facts.solver_text.c_str(), ms_per_frame(facts), more.c_str());
  if (facts.rmse) {
    std::printf("against the truth: blurred %.4f K, deblurred %.4f K rms\n", facts.rmse->blurred_k,
                facts.rmse->deblurred_k);
  }
  if (request.gyro == nullptr) return;
  const auto& [used, silent, ignored] = facts.gyro;
  std::printf("gyro: used for %llu frames; ignored for %llu, where the picture moved otherwise; no samples for %llu\n",
              count(used), count(ignored), count(silent));
}

}  // namespace

void print_capture(const DeblurRequest& request, const CaptureSummary& capture, double seconds) {
  if (request.json) {
    print(common_json(request, {capture}, seconds));
    return;
  }
  print_one(request, capture,
            fmt::format(" on {} thread{}, {:.1f} s", request.options.workers, request.options.workers == 1 ? "" : "s",
                        seconds));
}

void print_folder(const DeblurRequest& request, const FolderSummary& s) {
  for (const FailedCapture& failed : s.failed) {
    std::fprintf(stderr, "bolo deblur: %s\n", message_line(failed.error.message).c_str());
  }
  if (request.json) {
    print(folder_json(request, s));
    return;
  }
  std::uint64_t frames = 0;
  for (const CaptureSummary& capture : s.captures) {
    frames += capture.facts.frames_out;
    print_one(request, capture, "");
  }
  std::printf("%zu capture%s, %llu frames in %.1f s; %zu done before", s.captures.size(),
              s.captures.size() == 1 ? "" : "s", count(frames), s.seconds, s.skipped.size());
  if (!s.elsewhere.empty()) std::printf(", %zu being written by other processes", s.elsewhere.size());
  if (request.share.count > 1) {
    std::printf("; part %zu of %zu (%s)", request.share.index, request.share.count, request.share.from.c_str());
  }
  std::puts("");
}

}  // namespace bolo::tools
