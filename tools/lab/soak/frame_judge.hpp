// Judges each published frame: its order, its pixels, its flags.
#pragma once

#include <cstdint>
#include <optional>

#include "tools/lab/soak/findings.hpp"
#include "tools/lab/soak/scene.hpp"

namespace bolo::tools::soak {

struct Shown {
  std::uint64_t number = 0;  // publication order
  std::uint64_t missed = 0;  // published before it, and overwritten before this program read them
  std::uint64_t frame_id = 0;
  std::int64_t camera_ns = 0;
  std::int64_t receive_ns = 0;
  std::int64_t publish_ns = 0;
  std::uint32_t flags = 0;
  const std::uint16_t* raw = nullptr;
  const std::uint16_t* deblurred = nullptr;
};

enum class Grade {
  kClean,     // no flag, and both planes right
  kSparing,   // less was spent on it, for want of time, and its flag says so; the raw plane is right
  kFlagged,   // another flag; the raw plane is right
  kSettling,  // no flag, another plane: less than a window after a fault that no one can see in the frames' numbers
  kWrong,     // no flag, another plane, and no excuse; or a raw plane that is none of the camera's
};

inline constexpr std::size_t kGrades = 5;

// What the camera may show now; everything else is wrong.
struct Allowed {
  bool swapped = false;
  bool metadata = false;
  int offset = 0;  // besides none
};

// Thread: one at a time.
class FrameJudge {
 public:
  // `window`: frames that one is estimated from, look-ahead and all.
  FrameJudge(const Truth& truth, int window, Findings& findings)
      : truth_(truth), window_(window), findings_(findings) {}

  // Another daemon: its numbers begin anew.
  void begin_life() noexcept;
  void allow(const Allowed& allowed) noexcept { allowed_ = allowed; }
  Grade judge(const Shown& frame);

 private:
  void check_order(const Shown& frame);
  bool allowed(const Manner& manner) const noexcept;
  void follow(const Shown& frame, const Recognised& seen) noexcept;

  const Truth& truth_;
  Truth::Scratch scratch_;
  int window_;
  Findings& findings_;
  Allowed allowed_;
  std::optional<Shown> last_;  // its planes are gone
  std::optional<Recognised> before_;
  int settled_ = 0;  // frames since a fault that leaves no mark on the frames after it
};

}  // namespace bolo::tools::soak
