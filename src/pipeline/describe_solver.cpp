#include "src/pipeline/describe_solver.hpp"

#include <cstdio>

namespace bolo::pipeline {
namespace {

std::string short_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string effort(const deblur::Settings& settings) {
  if (settings.method == deblur::Method::kExact) return "converged";
  return std::to_string(settings.iterations) + (settings.iterations == 1 ? " iteration" : " iterations");
}

}  // namespace

std::string describe_solver(const deblur::Settings& settings, Unit unit, std::string_view isa) {
  std::string text(deblur::name(settings.method));
  const std::string unit_text = unit == Unit::kKelvin ? " K" : " counts";
  const std::string noise = settings.noise_k > 0.0 ? short_number(settings.noise_k) + unit_text : "measured";
  if (settings.method == deblur::Method::kMmae || settings.method == deblur::Method::kMotion) {
    text += ", noise " + noise;
  } else if (settings.method != deblur::Method::kInverse) {
    const std::string lambda = settings.auto_lambda ? "auto" : short_number(settings.lambda) + unit_text;
    text += ", " + effort(settings) + ", lambda " + lambda + ", kappa " + short_number(settings.kappa);
  }
  return text.append(", ").append(isa);
}

}  // namespace bolo::pipeline
