// What a job folder keeps of a session: all that the score needs.
#pragma once

#include <optional>

#include <nlohmann/json.hpp>

#include "tools/lab/blind/score.hpp"

namespace bolo::tools::blind {

// Numbers come back bit for bit, those that JSON does not have too ("nan", "inf", "-inf"). What was hidden is not in
// it. Thread: any.
nlohmann::json record_of(const Trial& trial);

// The trial of that session; nothing when the record is not one of a trial. Thread: any.
std::optional<Trial> trial_in(const nlohmann::json& record, const Session& session);

}  // namespace bolo::tools::blind
