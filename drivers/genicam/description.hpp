// Checks a camera's GenICam description before it is evaluated.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "drivers/genicam/gobject.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// --- The GenICam description file in the camera's memory.

// Reads camera memory; address and length are multiples of 4, at most 512 bytes. Nothing if refused or unanswered.
using ReadMemory = std::function<std::optional<std::vector<unsigned char>>(std::uint32_t address, std::uint32_t bytes)>;

// Reads and unpacks the camera's description. When Aravis then opens the camera on this thread, it uses this copy,
// whatever location the camera states. Aravis's own reader is unsafe: it allocates any stated size (abort on failure),
// reads at any offset of a ZIP file, opens any file of this computer (even endless devices), and could read other data
// than was checked. Errors: kBadInput for an implausible location, size or ZIP file, kFailed when the camera does not
// answer. Thread: any.
Status take_description(const ReadMemory& read);

// Rejects values that depend on themselves, directly or indirectly, or need more steps than any real camera's: Aravis
// evaluates recursively, until stack overflow or for ever. Registers with values must have 1 to 65536 bytes, because
// Aravis allocates any stated size. Errors: kBadInput. Thread: the one that opened the device.
Status check_description(ArvGc* description);

}  // namespace bolo::genicam
