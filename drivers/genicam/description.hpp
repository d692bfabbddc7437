// Checks of a camera's GenICam description, before any of it is evaluated.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "drivers/genicam/gobject.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// --- The file with a camera's GenICam description, in the camera's memory.

// So many bytes of a camera's memory from the address on, both multiples of 4, 512 at most; nothing when the camera
// refuses or is silent.
using ReadMemory = std::function<std::optional<std::vector<unsigned char>>(std::uint32_t address, std::uint32_t bytes)>;

// Reads the camera's description and unpacks it, for Aravis: when that opens the camera on this thread then, it takes
// this one for the camera's, wherever the camera says that it is. Aravis itself allocates any stated size, aborts the
// process when that fails, reads at any offset of a ZIP file, and would read any file of this computer, a device
// without end; and what it reads may be another than what was checked before. Errors: kBadInput for a place, sizes or a
// ZIP file that no description has, kFailed when the camera does not answer. Thread: any.
Status take_description(const ReadMemory& read);

// Checks that no value of the description depends on itself, by way of whichever others, and that none takes more steps
// than any camera's does: Aravis follows such values recursively, until the stack is full, or for ever. Registers with
// values must have from 1 to 65536 bytes: Aravis allocates any stated size. Errors: kBadInput. Thread: the one that
// opened the device.
Status check_description(ArvGc* description);

}  // namespace bolo::genicam
