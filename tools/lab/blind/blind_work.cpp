#include "tools/lab/blind/blind_work.hpp"

#include <array>
#include <cstdio>
#include <string>
#include <system_error>

#include "tools/lab/blind/record.hpp"

namespace bolo::tools::blind {
namespace {

std::string piece_name(const Session& session) {
  std::array<char, 64> name{};
  std::snprintf(name.data(), name.size(), "%s-%05zu", std::string(name_of(session.kind)).c_str(), session.index);
  return name.data();
}

}  // namespace

BlindWork::BlindWork(const std::vector<Session>& sessions, const CheckOptions& options,
                     const cluster::JobFolder& folder)
    : sessions_(sessions), options_(options), folder_(folder) {
  for (std::size_t i = 0; i < sessions.size(); ++i) {
    pieces_.push_back({piece_name(sessions[i]), i, cluster::Role::kShare, 1, {}});
  }
}

bool BlindWork::done(std::size_t piece) const {
  std::error_code ignored;
  if (!options_.keep.empty() && !std::filesystem::exists(kept_folder(sessions_[piece], options_), ignored))
    return false;
  return trial(piece).has_value();
}

Status BlindWork::run(std::size_t piece, const cluster::Beat& beat) {
  const auto trial = run_trial(sessions_[piece], options_, [&beat] { return beat(0); });
  if (!trial) return tl::unexpected(trial.error());
  const std::lock_guard lock(records_);
  return folder_.add_record(pieces_[piece].name, record_of(*trial));
}

std::optional<Trial> BlindWork::trial(std::size_t piece) const {
  const std::lock_guard lock(records_);
  const auto record = folder_.record(pieces_[piece].name);
  return record ? trial_in(*record, sessions_[piece]) : std::nullopt;
}

}  // namespace bolo::tools::blind
