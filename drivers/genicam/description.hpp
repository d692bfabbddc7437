// Checks of a camera's GenICam description, before any of it is evaluated.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "drivers/genicam/gobject.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// --- The file with a camera's GenICam description, in the camera's memory, before the library reads it.

// So many bytes of a camera's memory from the address on, both multiples of 4, 512 at most; nothing when the camera
// refuses or is silent.
using ReadMemory = std::function<std::optional<std::vector<unsigned char>>(std::uint32_t address, std::uint32_t bytes)>;

// Checks that the sizes that the camera states for its file, and the file for what is packed in it, are those of a
// description, and that the packed data lie in the file: Aravis allocates any stated size, aborts the process when that
// fails, and reads at any offset. The file must be in the camera's memory: Aravis would read any file of this computer,
// a device without end. When Aravis opens the camera on this thread then, it is given no other place than those. A
// camera whose memory holds something else the second time gets past this. Files that cannot be read or understood are
// left to Aravis. Errors: kBadInput. Thread: any.
Status check_description_file(const ReadMemory& read);

// Checks that no value of the description depends on itself, by way of whichever others, and that none takes more steps
// than any camera's does: Aravis follows such values recursively, until the stack is full, or for ever. Registers with
// values must have from 1 to 65536 bytes: Aravis allocates any stated size. Errors: kBadInput. Thread: the one that
// opened the device.
Status check_description(ArvGc* description);

}  // namespace bolo::genicam
