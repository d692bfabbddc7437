#include "tools/deblur/deblur_plan.hpp"

#include <algorithm>
#include <filesystem>

#include "src/deblur/isa.hpp"
#include "tools/cluster/digest.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/pixel_choice.hpp"

namespace bolo::tools {

std::size_t automatic_block(std::size_t captures, std::size_t frames, std::size_t processes) {
  constexpr std::size_t kMost = 12'000;
  constexpr std::size_t kLeast = 500;
  constexpr std::size_t kPiecesEach = 4;
  if (captures >= kPiecesEach * processes) return 0;
  return std::clamp(frames / (kPiecesEach * processes), kLeast, kMost);
}

std::size_t DeblurPlan::blocks_of(const PlannedCapture& capture) const {
  if (block_frames == 0) return 1;
  return std::max<std::size_t>(1, (capture.frames + block_frames - 1) / block_frames);
}

nlohmann::json DeblurPlan::text(const DeblurRequest& request, const nlohmann::json& digests) const {
  const deblur::Settings& s = request.options.deblur;
  nlohmann::json plan{{"bolo_job", 1}, {"verb", "deblur"}, {"program", BOLO_VERSION}, {"block_frames", block_frames}};
  plan["settings"] = {{"solver", deblur::name(s.method)},
                      {"tau_s", s.tau_s},
                      {"window", s.window},
                      {"levels", s.levels},
                      {"kappa", s.kappa},
                      {"lambda", s.auto_lambda ? nlohmann::json("auto") : nlohmann::json(s.lambda)},
                      {"noise_k", s.noise_k},
                      {"iterations", s.iterations},
                      {"lookahead", s.lookahead},
                      {"type", request.options.output == PixelType::kUint16 ? "uint16" : "float32"},
                      {"isa", isa}};
  if (request.options.region) plan["settings"]["roi"] = in_words(*request.options.region);
  plan["sha256"] = digests;
  plan["captures"] = nlohmann::json::array();
  for (const PlannedCapture& capture : captures) {
    plan["captures"].push_back({{"input", capture.file.input.filename().string()},
                                {"output", capture.file.output.filename().string()},
                                {"frames", capture.frames},
                                {"first_t_s", capture.first_t_s},
                                {"last_t_s", capture.last_t_s}});
  }
  return plan;
}

Result<DeblurPlan> plan_deblurring(const DeblurRequest& request) {
  DeblurPlan plan;
  plan.block_frames = request.block_frames.value_or(0);
  plan.isa = deblur::best_isa();
  for (const DeblurFile& file : request.files) {
    auto run = CaptureRun::open(request, file.input, true);
    if (!run) return tl::unexpected(run.error());
    const auto walked = run->needs_walk();
    if (!walked) return at(file.input.string(), walked.error());
    const std::vector<double>& t = run->reader().t();
    plan.captures.push_back({file, run->info().frames, t.front(), t.back(), *walked});
  }
  return plan;
}

Result<nlohmann::json> digests_of(const DeblurRequest& request) {
  nlohmann::json digests = nlohmann::json::object();
  const auto add = [&](const char* name, const std::filesystem::path& file) -> Status {
    if (file.empty()) return {};
    const auto digest = cluster::sha256_of(file);
    if (!digest) return tl::unexpected(digest.error());
    digests[name] = *digest;
    return {};
  };
  Status status = add("profile", request.profile_file);
  if (status) status = add("maps", request.maps_file);
  if (status) status = add("points", request.points_file);
  if (!status) return tl::unexpected(status.error());
  return digests;
}

}  // namespace bolo::tools
