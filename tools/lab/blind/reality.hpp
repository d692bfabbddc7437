// A second reality for the blind check: another camera before another bench, made without src/sim and src/diagnose. It
// steps the equations of the effects in time, explicitly and slowly, with forms, signs, references, centres and draws
// of its own, so that what simulator and diagnosis share by habit shows as an error of the diagnosis.
//
// Its conventions, where they differ: pixels cover [x, x + 1) and bars lean within a row; gains are corrected at
// 298.15 K; the camera's housing is at 301 K; vignetting is a cosine law about a centre of its own; rows may be read
// from the bottom; values are cut, not rounded, to counts; a window of integration begins at the frame's time; a frame
// sent twice stands in the place of the next one; lost frames come in bursts; a frame filter starts at its first frame.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind::second {

// The names among which the sessions of a kind go in turn. Thread: any.
std::vector<std::string> effects_of(Kind kind);

// A session of six captures; its effects are hidden by name, with the numbers of this reality. kBadInput when `only`
// names no effect of the kind, or a magnitude is asked for. Thread: any.
Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index);

// All frames of a capture, row-major, 10 mK a count. Thread: any.
std::vector<std::uint16_t> film(const Session& session, const CapturePlan& plan);

}  // namespace bolo::tools::blind::second
