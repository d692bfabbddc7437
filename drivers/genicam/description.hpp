// What a camera says of itself in its GenICam description, before any of it is evaluated.
#pragma once

#include "drivers/genicam/gobject.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// No value of the description is taken from itself, by way of whichever others, and none takes more steps than any
// camera's does: Aravis follows such values one within the other, until it has no stack left, or for ever. Errors:
// kBadInput. Thread: the one that opened the device.
Status check_description(ArvGc* description);

}  // namespace bolo::genicam
