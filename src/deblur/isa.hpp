// The instruction sets that the pixel kernels are built for, and the choice between them.
#pragma once

#include <string_view>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::deblur {

// Names of the instruction sets that are built in and that this processor can run, best first: "AVX3" (AVX-512),
// "AVX2", "SSE4", "scalar". Thread: setup.
std::vector<std::string_view> available_isas();

// The instruction set of solvers created from now on: the best one, or the one forced. Thread: setup.
std::string_view best_isa();

// Solvers created from now on use this instruction set; "" goes back to the best. False, and nothing changes, when it
// is not available. Thread: setup.
bool force_isa(std::string_view isa);

// As force_isa(), for users: "auto" is the best; any other name than those available is refused with their list.
// check_isa() only checks. Thread: setup.
Status choose_isa(std::string_view name);
Status check_isa(std::string_view name);

}  // namespace bolo::deblur
