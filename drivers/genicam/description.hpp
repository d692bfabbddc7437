// What a camera says of itself in its GenICam description, before any of it is evaluated.
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

// The size that the camera states for its file, and that the file states for what is packed in it, are those of a
// description, and what is packed is in the file: Aravis allocates what it is told, ends the process where there is not
// so much, and reads wherever it is led. It is the camera's file, in its memory: of this computer Aravis would read
// any, a device without end. A camera that says something else when it is asked again gets past this. What cannot be
// read or understood is left to Aravis. Errors: kBadInput. Thread: any.
Status check_description_file(const ReadMemory& read);

// No value of the description is taken from itself, by way of whichever others, and none takes more steps than any
// camera's does: Aravis follows such values one within the other, until it has no stack left, or for ever. Registers
// with values have from 1 to 65536 bytes: Aravis allocates what it is told. Errors:
// kBadInput. Thread: the one that opened the device.
Status check_description(ArvGc* description);

}  // namespace bolo::genicam
