// The instruction sets of the pixel kernels, and the choice between them.
#pragma once

#include <string_view>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::deblur {

// Built-in instruction sets that run here, best first: "AVX3" (AVX-512), "AVX2", "SSE4", "scalar". Thread: setup.
std::vector<std::string_view> available_isas();

// The instruction set of solvers created from now on: the best one, or the one forced. Thread: setup.
std::string_view best_isa();

// Sets the instruction set of later solvers; "" returns to the best. False, without effect, if unavailable.
// Thread: setup.
bool force_isa(std::string_view isa);

// As force_isa(), for users: "auto" is the best; an unavailable name is refused with a list of the available ones.
// check_isa() only checks. Thread: setup.
Status choose_isa(std::string_view name);
Status check_isa(std::string_view name);

}  // namespace bolo::deblur
