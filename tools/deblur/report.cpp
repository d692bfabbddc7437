#include "tools/deblur/report.hpp"

#include <cstdio>

#include <nlohmann/json.hpp>

#include "src/core/clock.hpp"
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

// Sums over captures; what is the same for all, from the first of them.
Json common_json(const DeblurRequest& request, const std::vector<CaptureSummary>& captures, std::size_t points,
                 double seconds) {
  RunFacts all;
  std::uint64_t frames_in = 0;
  if (!captures.empty()) all = captures.front().facts;
  all.frames_out = all.lost = 0;
  all.deblur_ms = 0.0;
  for (const CaptureSummary& capture : captures) {
    frames_in += capture.frames_in;
    all.frames_out += capture.facts.frames_out;
    all.lost += capture.facts.lost;
    all.deblur_ms += capture.facts.deblur_ms;
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
  if (request.options.region) json["roi"] = in_words(*request.options.region);
  json["points"] = points;
  json["maps"] = request.maps_file.filename().string();
  json["rmse"] = captures.size() == 1 ? rmse_json(all.rmse) : Json(nullptr);
  return json;
}

Json ranks_json(const cluster::JobResult& run) {
  Json ranks = Json::array();
  for (const cluster::RankShare& rank : run.ranks) {
    ranks.push_back({{"host", rank.host},
                     {"pid", rank.pid},
                     {"pieces", rank.pieces},
                     {"frames", rank.frames},
                     {"busy_s", rank.busy_s},
                     {"lost", rank.lost}});
  }
  return ranks;
}

Json job_json(const DeblurRequest& request, const JobSummary& s) {
  Json json = common_json(request, s.captures, s.points, s.run.seconds);
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
    json["failed"].push_back(
        {{"input", failed.file.string()}, {"piece", failed.piece}, {"error", failed.error.message}});
  }
  json["job"] = {{"folder", request.sharing.job.string()},
                 {"block_frames", request.block_frames.value_or(0)},
                 {"captures", s.planned},
                 {"pieces_before", s.run.before},
                 {"pieces_done", s.run.did},
                 {"pieces_again", s.run.again},
                 {"pieces_left", s.run.left},
                 {"ranks", ranks_json(s.run)},
                 {"busy_s", cluster::busy_s(s.run)}};
  return json;
}

}  // namespace

void print_capture(const DeblurRequest& request, const CaptureSummary& capture, std::size_t points, double seconds) {
  if (request.json) {
    std::puts(common_json(request, {capture}, points, seconds).dump(2).c_str());
    return;
  }
  const RunFacts& facts = capture.facts;
  std::printf("%s: %llu of %llu frames (%llu lost before), %s, %.3f ms a frame on %d threads, %.1f s\n",
              capture.file.output.c_str(), count(facts.frames_out), count(capture.frames_in), count(facts.lost),
              facts.solver_text.c_str(), ms_per_frame(facts), request.options.workers, seconds);
  if (!facts.rmse) return;
  std::printf("against the truth: blurred %.4f K, deblurred %.4f K rms\n", facts.rmse->blurred_k,
              facts.rmse->deblurred_k);
}

JobSummary summarise(const DeblurRequest& request, const DeblurWork& work) {
  JobSummary summary;
  const DeblurPlan& plan = work.plan();
  summary.planned = plan.captures.size();
  for (std::size_t i = 0; i < plan.captures.size(); ++i) {
    const auto record = work.record(work.last_of(i));
    if (!record || !work.done(work.last_of(i))) continue;
    RunFacts facts;
    facts.frames_out = record->at("frames_out").get<std::uint64_t>();
    facts.lost = record->at("lost").get<std::uint64_t>();
    facts.deblur_ms = record->at("deblur_ms").get<double>();
    facts.settings = request.options.deblur;
    facts.settings.iterations = record->at("iterations").get<int>();
    facts.settings.period_s = record->at("period_s").get<double>();
    facts.isa = record->at("isa").get<std::string>();
    facts.solver_text = record->at("solver_text").get<std::string>();
    if (record->contains("rmse")) {
      const auto& rmse = record->at("rmse");
      facts.rmse = Rmse{rmse[0].get<double>(), rmse[1].get<double>()};
    }
    summary.captures.push_back({plan.captures[i].file, plan.captures[i].frames, std::move(facts)});
  }
  return summary;
}

void take_failures(const std::vector<cluster::Failure>& failures, const DeblurWork& work, JobSummary& summary) {
  for (const cluster::Failure& failure : failures) {
    const cluster::Piece& piece = work.pieces()[failure.piece];
    summary.failed.push_back({work.plan().captures[piece.group].file.input, piece.name, failure.error});
  }
}

void print_job(const DeblurRequest& request, const JobSummary& s) {
  for (const FailedCapture& failed : s.failed) {
    std::fprintf(stderr, "bolo deblur: %s (%s)\n", failed.error.message.c_str(), failed.piece.c_str());
  }
  if (request.json) {
    std::puts(job_json(request, s).dump(2).c_str());
    return;
  }
  std::uint64_t frames = 0;
  for (const CaptureSummary& capture : s.captures) {
    frames += capture.facts.frames_out;
    std::printf("%s: %llu of %llu frames (%llu lost before), %s, %.3f ms a frame\n", capture.file.output.c_str(),
                count(capture.facts.frames_out), count(capture.frames_in), count(capture.facts.lost),
                capture.facts.solver_text.c_str(), ms_per_frame(capture.facts));
    if (!capture.facts.rmse) continue;
    std::printf("against the truth: blurred %.4f K, deblurred %.4f K rms\n", capture.facts.rmse->blurred_k,
                capture.facts.rmse->deblurred_k);
  }
  std::printf("%zu of %zu captures, %llu frames; %zu pieces done in %.1f s, %zu done before\n", s.captures.size(),
              s.planned, count(frames), s.run.did, s.run.seconds, s.run.before);
  if (!s.run.ranks.empty()) std::puts(cluster::ranks_text(s.run).c_str());
  if (s.run.left > 0)
    std::printf("%zu pieces are left to other shards; %s has the records\n", s.run.left, request.sharing.job.c_str());
}

}  // namespace bolo::tools
