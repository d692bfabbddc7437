// How long work looks whether it is still wanted.
#pragma once

#include <functional>

namespace bolo::tools::blind {

// Asked often, by the thread that works; false: end now, with an error.
using GoOn = std::function<bool()>;

}  // namespace bolo::tools::blind
