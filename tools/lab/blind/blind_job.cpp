#include "tools/lab/blind/blind_job.hpp"

#include <string>
#include <utility>

#include "tools/lab/blind/nonce.hpp"

namespace bolo::tools::blind {

// The digest comes last among what can differ: of two checks it differs whenever anything else does.
nlohmann::json BlindJob::plan(const std::string& digest) const {
  const DrawOptions& draw = request_.draw;
  nlohmann::json kinds = nlohmann::json::array();
  for (const Kind kind : request_.kinds) kinds.push_back(name_of(kind));
  return {{"bolo_job", 1},
          {"verb", "blind"},
          {"program", BOLO_VERSION},
          {"draw",
           {{"seed", draw.seed},
            {"width", draw.geometry.width},
            {"height", draw.geometry.height},
            {"frames_scale", draw.frames_scale},
            {"magnitude", draw.magnitude},
            {"imperfect", draw.imperfect},
            {"only", draw.only},
            {"kinds", std::move(kinds)},
            {"first", request_.first},
            {"sessions", request_.count}}},
          {"sealed_sha256", digest}};
}

Result<nlohmann::json> BlindJob::decide(const std::vector<nlohmann::json>&) {
  decides_ = true;
  const std::filesystem::path& job = request_.sharing.job;
  const auto planned = cluster::JobFolder::plan_in(job);  // before the nonce, which whoever plans keeps first
  auto kept = kept_nonce(job);
  if (!kept) return tl::unexpected(kept.error());
  if (planned && !*kept) {
    const auto same = cluster::JobFolder::open(job, plan(planned->value("sealed_sha256", "")));
    if (!same) return tl::unexpected(same.error());
    return bad_input(nonce_file(job).string() + ": is missing, so that the sealed answers cannot be opened; remove " +
                     job.string() + " to begin anew");
  }
  const auto nonce = *kept ? Result<std::string>(**kept) : keep_nonce(job);
  if (!nonce) return tl::unexpected(nonce.error());
  return nlohmann::json{{"sealed_sha256", Seal::close(request_.sessions, *nonce).digest()}};
}

Result<cluster::Work*> BlindJob::prepare(const nlohmann::json& decision, int) {
  const std::filesystem::path& job = request_.sharing.job;
  const auto nonce = kept_nonce(job);
  if (!nonce) return tl::unexpected(nonce.error());
  if (*nonce) seal_ = Seal::close(request_.sessions, **nonce);
  if (!seal_ || seal_->digest() != decision.value("sealed_sha256", "")) {
    return bad_input(job.string() +
                     ": is not the folder of rank 0, or the options are others; give --job a folder that "
                     "all hosts see under that name");
  }
  auto folder = cluster::JobFolder::open(job, plan(seal_->digest()));
  if (!folder) return tl::unexpected(folder.error());
  folder_.emplace(std::move(*folder));
  if (decides_) publish_(*seal_);
  work_.emplace(request_.sessions, request_.check, *folder_);
  return &*work_;
}

std::vector<Trial> BlindJob::finish() const {
  std::vector<Trial> trials;
  for (std::size_t i = 0; i < work_->pieces().size(); ++i) {
    if (auto trial = work_->trial(i)) trials.push_back(std::move(*trial));
  }
  if (trials.size() == work_->pieces().size()) folder_->clear_data();
  return trials;
}

}  // namespace bolo::tools::blind
