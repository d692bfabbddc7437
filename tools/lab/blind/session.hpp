// Sessions of the blind check with hidden effects, drawn from a seed.
#pragma once

#include <array>
#include <map>

#include "src/capture/capture.hpp"
#include "src/sim/effect.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tools/lab/common.hpp"

namespace bolo::tools::blind {

enum class Kind {
  kEffectFree,
  kSingle,    // one effect of the catalogue, each in turn
  kPair,      // two effects of the catalogue
  kOutside,   // one effect outside the catalogue
  kWithheld,  // one of the catalogue, withheld from the diagnosis
  kForms,     // one of the catalogue in a non-standard physical form
  kBench,     // no effect, but a wrong /stimulus
};
inline constexpr std::size_t kKinds = 7;

// Source of the captures: the project's simulator, or an independent one (namespace second).
enum class Reality { kFirst, kSecond };

// "effect-free", "single" ... Thread: any.
std::string_view name_of(Kind kind);
std::optional<Kind> kind_named(std::string_view name);

struct DrawOptions {
  std::uint64_t seed = 1;
  Geometry geometry{32, 24};
  double frames_scale = 1.0;  // factor on the captures' lengths
  bool imperfect = false;     // the stimuli have errors
  std::string only{};         // effect of every session; empty: each in turn
  Reality reality = Reality::kFirst;
};

struct CapturePlan {
  std::string file;            // does not reveal the effects
  capture::Stimulus stimulus;  // nominal, as in the file
  std::size_t frames = 0;
  double session_start_s = 0.0;
  std::uint64_t noise_seed = 0;
  std::vector<sim::EffectSpec> effects;                // present in this capture
  sim::StimulusError faults;                           // deviations of the true stimulus from the nominal one
  std::map<std::string, double, std::less<>> bench{};  // the same, for the second reality
};

// A session of the check: the hidden answer.
struct Session {
  Kind kind = Kind::kEffectFree;
  std::size_t index = 0;  // within its kind
  Reality reality = Reality::kFirst;
  std::uint64_t seed = 0;  // for the whole session
  std::vector<sim::EffectSpec> effects;
  std::string withheld;
  std::string misdescribed;  // error in /stimulus
  Geometry geometry;
  std::uint64_t camera_seed = 0;
  std::vector<CapturePlan> captures;
};

// Six captures: closed shutter, hot flat field, chopper, slow pan, fast pan the other way, static target; 10 mK per
// count. Equal options, kind and index give the same session, whatever else is drawn. kBadInput when `only` names no
// effect of the kind. Thread: any.
Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index);

// The possible errors in /stimulus, used in turn.
inline constexpr std::array<const char*, 6> kMisdescribed{"slant", "velocity", "period", "width", "speed", "on_off"};

// Everything drawn. Thread: any.
nlohmann::json to_json(const Session& session);

// Simulates all captures of a session and writes them to `folder`; the files do not reveal effects, seeds, or the true
// errors of the stimulus. Returns the files. Thread: any; writing is serialised.
Result<std::vector<std::filesystem::path>> write_captures(const Session& session, const std::filesystem::path& folder);

// --- A second reality for the blind check: another camera and bench, implemented without src/sim and src/diagnose. It
// integrates the effects' equations explicitly in time, with different forms, signs, references, centres and draws, to
// reveal assumptions that simulator and diagnosis share.
//
// Its conventions, where they differ: pixels cover [x, x + 1) and bars are slanted within a row; gains are corrected at
// 298.15 K; the housing is at 301 K; vignetting follows a cosine law about another centre; rows may be read from the
// bottom; values are truncated to counts, not rounded; the integration window begins at the frame's time; a repeated
// frame replaces the next one; lost frames come in bursts; a frame filter starts at its first frame.

namespace second {

// Six captures; hidden effects have the usual names and this reality's parameters. kBadInput when `only` names no
// effect of the kind. Thread: any.
Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index);

// All frames of a capture, row-major, 10 mK per count. Thread: any.
std::vector<std::uint16_t> film(const Session& session, const CapturePlan& plan);

}  // namespace second

}  // namespace bolo::tools::blind
