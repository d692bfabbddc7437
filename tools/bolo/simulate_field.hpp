// What bolo simulate's options say that the camera looks at.
#pragma once

#include <memory>

#include <cxxopts.hpp>

#include "src/core/result.hpp"
#include "src/sim/simulator.hpp"

namespace bolo::tools {

// The field for a capture of `frames` frames. Options that contradict each other, or have no meaning for the stimulus
// asked for, are kBadInput. Thread: setup.
Result<std::unique_ptr<const sim::Field>> simulated_field(const cxxopts::ParseResult& given,
                                                          const sim::CameraSettings& camera, std::size_t frames);

}  // namespace bolo::tools
