// A frame that equals the one before bit for bit counts as lost.
#include <cstring>
#include <vector>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {
namespace {

class RepeatedFrames final : public Correction {
 public:
  explicit RepeatedFrames(std::size_t bytes) : Correction({.frames = true}), last_(bytes) {}

  bool drops(const void* raw) noexcept override {
    const bool same = begun_ && std::memcmp(last_.data(), raw, last_.size()) == 0;
    if (!same) std::memcpy(last_.data(), raw, last_.size());
    begun_ = true;
    return same;
  }

 private:
  std::vector<std::byte> last_;
  bool begun_ = false;
};

}  // namespace

Made repeated_frames(const Setup& setup, const StreamFormat& input) {
  if (!setup.undo.drop_repeated) return nullptr;
  return std::make_unique<RepeatedFrames>(plane_bytes(input.geometry, input.type));
}

}  // namespace bolo::corrections
