// The rows of `bolo-lab eval loop`, and what is drawn of them.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "src/report/sheet.hpp"

namespace bolo::tools::loop {

// RMSE of one deblurred scene, K.
struct Row {
  std::string effect;
  double without_k = 0.0;    // of the camera without the effect, nominal profile
  double nominal_k = 0.0;    // with the effect
  double diagnosed_k = 0.0;  // with the effect, profile as diagnosed
  double true_k = 0.0;       // with the effect, profile as it truly is
  std::vector<std::string> found;

  double hurts() const { return nominal_k / without_k - 1.0; }
  // (nominal - diagnosed) / (nominal - true); none where the true parameters gain less than 1 %.
  std::optional<double> recovered() const {
    if (nominal_k - true_k < 0.01 * nominal_k) return std::nullopt;
    return (nominal_k - diagnosed_k) / (nominal_k - true_k);
  }
};

// Bars of the errors, effect by effect, those that hurt most first. Thread: any.
plot::Sheet sheet_of(std::span<const Row> rows);

}  // namespace bolo::tools::loop
