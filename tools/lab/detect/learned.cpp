#include "tools/lab/detect/learned.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bolo::tools::detect {

LearnedDeblurring::LearnedDeblurring(std::filesystem::path file, std::unique_ptr<Network> network)
    : file_(std::move(file)), network_(std::move(network)) {}

Result<LearnedDeblurring> LearnedDeblurring::open(const std::filesystem::path& file,
                                                  const std::filesystem::path& library) {
  auto network = open_network({NetworkFormat::kOnnx, file, {}, 0.0}, library);
  if (!network) return tl::unexpected(network.error());
  return LearnedDeblurring(file, std::move(*network));
}

Result<Levels> LearnedDeblurring::apply(const Levels& blurred, Geometry picture) {
  constexpr float kWhite = 255.0F;
  Tensor input{{1, 1, picture.height, picture.width}, blurred};
  for (float& value : input.values) value /= kWhite;
  const auto outputs = network_->forward(input);
  if (!outputs) return tl::unexpected(outputs.error());
  if (outputs->size() != 1 || outputs->front().shape != input.shape) {
    return bad_input(file_.string() + ": gives no image of " + std::to_string(picture.width) + "x" +
                     std::to_string(picture.height) + " with one channel; give a network that does");
  }
  Levels levels = outputs->front().values;
  for (float& value : levels) {
    value = std::isfinite(value) ? std::clamp(std::round(value * kWhite), 0.0F, kWhite) : 0.0F;
  }
  return levels;
}

}  // namespace bolo::tools::detect
