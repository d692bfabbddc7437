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
  kPair,      // two of the catalogue
  kOutside,   // one that is not in the catalogue
  kWithheld,  // one of the catalogue, withheld from the diagnosis
  kForms,     // one of the catalogue in a physical form other than the standard one
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
  bool imperfect = false;     // the stimuli deviate from the nominal ones
  std::string only{};         // the effect of every session; empty: all in turn
  Reality reality = Reality::kFirst;
};

struct CapturePlan {
  std::string file;            // does not reveal the effects
  capture::Stimulus stimulus;  // nominal, as the file has it
  std::size_t frames = 0;
  double session_start_s = 0.0;
  std::uint64_t noise_seed = 0;
  std::vector<sim::EffectSpec> effects;                // in this capture
  sim::StimulusError faults;                           // deviations of the true stimulus from the nominal one
  std::map<std::string, double, std::less<>> bench{};  // the same for the second reality
};

// One session of the check: the hidden answer.
struct Session {
  Kind kind = Kind::kEffectFree;
  std::size_t index = 0;  // among its kind
  Reality reality = Reality::kFirst;
  std::uint64_t seed = 0;  // of the whole session
  std::vector<sim::EffectSpec> effects;
  std::string withheld;
  std::string misdescribed;  // the error in /stimulus
  Geometry geometry;
  std::uint64_t camera_seed = 0;
  std::vector<CapturePlan> captures;
};

// Six captures: closed shutter, hot flat, chopper, slow pan, fast pan the other way, static target; 10 mK a count. The
// same options, kind and index give the same session, whatever others are drawn. kBadInput if `only` names no effect of
// the kind. Thread: any.
Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index);

// The possible errors in /stimulus, in turn.
inline constexpr std::array<const char*, 6> kMisdescribed{"slant", "velocity", "period", "width", "speed", "on_off"};

// Everything that was drawn. Thread: any.
nlohmann::json to_json(const Session& session);

// Simulates all captures of a session and writes them to `folder`; the files do not reveal effects, seeds, or the
// stimulus' true errors. Returns the files. Thread: any; writing is serialised inside.
Result<std::vector<std::filesystem::path>> write_captures(const Session& session, const std::filesystem::path& folder);

// --- A second reality for the blind check: another camera before another bench, made without src/sim and src/diagnose.
// It steps the effects' equations in time explicitly, with different forms, signs, references, centres and draws, to
// reveal assumptions that simulator and diagnosis share.
//
// Its conventions, where they differ: pixels cover [x, x + 1) and bars lean within a row; gains are corrected at 298.15
// K; the camera's housing is at 301 K; vignetting is a cosine law about another centre; rows may be read from the
// bottom; values are truncated, not rounded, to counts; the integration window begins at the frame's time; a repeated
// frame replaces the next one; lost frames come in bursts; a frame filter starts at its first frame.

namespace second {

// A session of six captures; hidden effects have the usual names and this reality's parameters. kBadInput if `only`
// names no effect of the kind. Thread: any.
Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index);

// All frames of a capture, row-major, 10 mK a count. Thread: any.
std::vector<std::uint16_t> film(const Session& session, const CapturePlan& plan);

}  // namespace second

}  // namespace bolo::tools::blind
