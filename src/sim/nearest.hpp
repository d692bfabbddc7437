// The word a person may have meant.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace bolo::sim {

// The one of `words` with the fewest letters to change; the first of equals. Thread: any.
std::string nearest(std::string_view word, std::span<const std::string_view> words);

}  // namespace bolo::sim
