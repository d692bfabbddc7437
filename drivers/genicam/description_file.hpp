// The file with a camera's GenICam description, in the camera's memory, before the library reads it.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::genicam {

// So many bytes of a camera's memory from the address on, both multiples of 4, 512 at most; nothing when the camera
// refuses or is silent.
using ReadMemory = std::function<std::optional<std::vector<unsigned char>>(std::uint32_t address, std::uint32_t bytes)>;

// The size that the camera states for its file, and that the file states for what is packed in it, are those of a
// description: Aravis allocates what it is told, and ends the process where there is not so much. A camera that says
// something else when it is asked again gets past this. What cannot be read or understood is left to Aravis. Errors:
// kBadInput. Thread: any.
Status check_description_file(const ReadMemory& read);

}  // namespace bolo::genicam
