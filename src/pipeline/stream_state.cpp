#include "src/pipeline/stream_state.hpp"

#include <cstdint>

namespace bolo::pipeline {
namespace {

constexpr std::uint32_t kVersion = 2;

}  // namespace

std::string undo_half(const FrameUndo& undo, bool restart_next) {
  StateWriter out;
  out(restart_next);
  undo.save(out);
  return out.take();
}

std::string joined(const std::string& undo_half, double noise_state) {
  StateWriter out;
  out(kVersion);
  out(noise_state);
  return out.take() + undo_half;
}

Status restore(std::string_view bytes, const StreamState& state) {
  StateReader in(bytes);
  std::uint32_t version = 0;
  double noise_state = 0.0;
  in(version);
  in(noise_state);
  in(state.restart_next);
  state.undo.restore(in);
  if (!in.complete() || version != kVersion) {
    return bad_input("the stream's state was saved with other options, for another stream, or by another version");
  }
  state.solver.set_noise_state(noise_state);
  return {};
}

}  // namespace bolo::pipeline
