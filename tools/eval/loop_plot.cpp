#include "tools/eval/loop_plot.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

#include "tools/picture/canvas.hpp"

namespace bolo::tools::loop {
namespace {

constexpr double kLeft = 210.0;
constexpr double kWidth = 640.0;
constexpr double kRowHeight = 34.0;
constexpr double kTop = 70.0;
constexpr Colour kNominal{0.902, 0.624, 0.0};
constexpr Colour kDiagnosed{0.0, 0.447, 0.698};
constexpr Colour kTrue{0.0, 0.62, 0.451};

}  // namespace

Status plot(std::span<const Row> rows, const std::filesystem::path& file) {
  double most = 1e-6;
  for (const Row& row : rows) most = std::max({most, row.nominal_k, row.diagnosed_k, row.true_k, row.without_k});
  const double height = kTop + kRowHeight * static_cast<double>(rows.size()) + 20.0;
  Canvas page(static_cast<int>(kLeft + kWidth + 90.0), static_cast<int>(height));
  page.text(20.0, 28.0, "RMSE of a deblurred scene with each effect, K", {16.0, true, kInk, Align::kLeft});
  const std::array<std::pair<const char*, Colour>, 4> legend{{{"nominal profile", kNominal},
                                                              {"diagnosed", kDiagnosed},
                                                              {"true parameters", kTrue},
                                                              {"| camera without the effect", kInk}}};
  double x = kLeft;
  for (const auto& [words, colour] : legend) {
    page.text(x, 52.0, words, {13.0, false, colour, Align::kLeft});
    x += 160.0;
  }
  double y = kTop;
  for (const Row& row : rows) {
    page.text(kLeft - 10.0, y + 18.0, row.effect, {13.0, false, kInk, Align::kRight});
    const std::array<std::pair<double, Colour>, 3> bars{
        {{row.nominal_k, kNominal}, {row.diagnosed_k, kDiagnosed}, {row.true_k, kTrue}}};
    double top = y;
    for (const auto& [error, colour] : bars) {
      page.fill({kLeft, top, kWidth * error / most, 8.0}, colour);
      top += 9.0;
    }
    const double without = kLeft + kWidth * row.without_k / most;
    page.line(without, y - 2.0, without, y + 29.0, kInk, 1.5);
    char words[32];
    std::snprintf(words, sizeof words, "%.3f", row.nominal_k);
    page.text(kLeft + kWidth * row.nominal_k / most + 6.0, y + 9.0, words, {11.0, false, kFaint, Align::kLeft});
    y += kRowHeight;
  }
  return page.save(file.string());
}

}  // namespace bolo::tools::loop
