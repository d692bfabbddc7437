// All that a stream's earlier frames leave to its later ones beyond what still stands in the window.
#pragma once

#include <string>
#include <string_view>

#include "src/core/result.hpp"
#include "src/deblur/solver.hpp"
#include "src/pipeline/frame_undo.hpp"

namespace bolo::pipeline {

// Lent by who owns them.
struct StreamState {
  FrameUndo& undo;
  deblur::Solver& solver;
  bool& restart_next;  // a frame that was dropped had begun a new window
};

// The two halves: what the undoing remembers, and what the solver has learned. They are taken at different frames
// (StreamWalk). Thread: pipeline, between frames.
std::string undo_half(const FrameUndo& undo, bool restart_next);
std::string joined(const std::string& undo_half, double noise_state);

// Sets what the bytes of joined() hold. kBadInput when they are of other options or of another stream; then nothing may
// be made of `state` any more. Thread: setup.
Status restore(std::string_view bytes, const StreamState& state);

}  // namespace bolo::pipeline
