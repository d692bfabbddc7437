// Sessions of the blind check: what is hidden in them, drawn from a seed.
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
  kPair,      // two of them
  kOutside,   // one that is not in the catalogue
  kWithheld,  // one of the catalogue, which the diagnosis may not use
  kForms,     // one of the catalogue in another physical form than the standard one
  kBench,     // no effect, but a /stimulus that describes another bench
};
inline constexpr std::size_t kKinds = 7;

// What makes the captures: the project's simulator, or a camera that shares nothing with it (namespace second).
enum class Reality { kFirst, kSecond };

// "effect-free", "single" ... Thread: any.
std::string_view name_of(Kind kind);
std::optional<Kind> kind_named(std::string_view name);

struct DrawOptions {
  std::uint64_t seed = 1;
  Geometry geometry{32, 24};
  double frames_scale = 1.0;  // of the captures' lengths
  bool imperfect = false;     // the stimuli have errors
  std::string only{};         // the effect of every session; empty: all in turn
  Reality reality = Reality::kFirst;
};

struct CapturePlan {
  std::string file;            // says nothing of the effects
  capture::Stimulus stimulus;  // nominal, as the file has it
  std::size_t frames = 0;
  double session_start_s = 0.0;
  std::uint64_t noise_seed = 0;
  std::vector<sim::EffectSpec> effects;                // those at work in this capture
  sim::StimulusError faults;                           // how the true stimulus differs from the nominal one
  std::map<std::string, double, std::less<>> bench{};  // the same, of the second reality
};

// The answer to one question of the check.
struct Session {
  Kind kind = Kind::kEffectFree;
  std::size_t index = 0;  // among its kind
  Reality reality = Reality::kFirst;
  std::uint64_t seed = 0;  // of everything in it
  std::vector<sim::EffectSpec> effects;
  std::string withheld;
  std::string misdescribed;  // what /stimulus has wrong
  Geometry geometry;
  std::uint64_t camera_seed = 0;
  std::vector<CapturePlan> captures;
};

// The names among which the sessions of a kind go in turn. Thread: any.
std::vector<std::string> effects_of(Kind kind, Reality reality = Reality::kFirst);

// Six captures: closed shutter, hot flat, chopper, slow pan, fast pan the other way, static target; 10 mK a count.
// The same options, kind and index give the same session, whatever others are drawn. kBadInput when `only` names no
// effect of the kind. Thread: any.
Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index);

// What /stimulus may have wrong, in turn.
inline constexpr std::array<const char*, 6> kMisdescribed{"slant", "velocity", "period", "width", "speed", "on_off"};

// Everything that was drawn. Thread: any.
nlohmann::json to_json(const Session& session);

// Simulates all captures of a session and writes them to `folder`; the files say nothing of effects, seeds, or how
// the stimulus really was. Returns the files. Thread: any; writing is serialised inside.
Result<std::vector<std::filesystem::path>> write_captures(const Session& session, const std::filesystem::path& folder);

// --- A second reality for the blind check: another camera before another bench, made without src/sim and src/diagnose.
// It steps the equations of the effects in time, explicitly and slowly, with forms, signs, references, centres and
// draws of its own, so that what simulator and diagnosis share by habit shows as an error of the diagnosis.
//
// Its conventions, where they differ: pixels cover [x, x + 1) and bars lean within a row; gains are corrected at
// 298.15 K; the camera's housing is at 301 K; vignetting is a cosine law about a centre of its own; rows may be read
// from the bottom; values are cut, not rounded, to counts; a window of integration begins at the frame's time; a frame
// sent twice stands in the place of the next one; lost frames come in bursts; a frame filter starts at its first frame.

namespace second {

// The names among which the sessions of a kind go in turn. Thread: any.
std::vector<std::string> effects_of(Kind kind);

// A session of six captures; its effects are hidden by name, with the numbers of this reality. kBadInput when `only`
// names no effect of the kind. Thread: any.
Result<Session> draw_session(const DrawOptions& options, Kind kind, std::size_t index);

// All frames of a capture, row-major, 10 mK a count. Thread: any.
std::vector<std::uint16_t> film(const Session& session, const CapturePlan& plan);

}  // namespace second

}  // namespace bolo::tools::blind
