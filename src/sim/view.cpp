#include "src/sim/view.hpp"

namespace bolo::sim {
namespace {

class BareView final : public View {
 public:
  explicit BareView(const Field& field) : field_(field) {}
  explicit BareView(std::unique_ptr<const Field> owned) : owned_(std::move(owned)), field_(*owned_) {}
  std::unique_ptr<View> blurred(const Blur& blur) const override {
    std::unique_ptr<const Field> field = field_.blurred(blur);
    return field == nullptr ? nullptr : std::make_unique<BareView>(std::move(field));
  }
  void draw(double t_s, const Patch& patch, std::span<float> out) override {
    const auto width = static_cast<std::size_t>(patch.width);
    for (int y = 0; y < patch.height; ++y) {
      field_.sample_from(t_s, patch.column, patch.row + y, out.subspan(static_cast<std::size_t>(y) * width, width));
    }
  }

 private:
  std::unique_ptr<const Field> owned_;  // nullptr when the field is lent
  const Field& field_;
};

}  // namespace

std::unique_ptr<View> bare_view(const Field& field) { return std::make_unique<BareView>(field); }

}  // namespace bolo::sim
