// The GenICam description (a655sc.xml), built into the program.
#pragma once

#include <string_view>

namespace bolo::fakecam {

// Thread: any.
std::string_view description();

}  // namespace bolo::fakecam
