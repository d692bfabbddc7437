// Writes temperature range, object parameters and NUC mode to the camera.
#pragma once

#include <string>
#include <vector>

#include "drivers/genicam/nodes.hpp"
#include "drivers/genicam/radiometry.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// Touches only nodes that the camera has; a parameter that was asked for and is not there is a warning. Thread: setup.
void configure_object(Nodes& nodes, const ObjectParameters& object, std::vector<std::string>& warnings);

// Chooses the narrowest range ("case") that holds the temperatures asked for; kBadInput with the camera's own when none
// does. The ranges and the current one are a note. Thread: setup.
Status configure_range(Nodes& nodes, const CameraOptions& options, std::vector<std::string>& notes,
                       std::vector<std::string>& warnings);

// Sets NUCMode: automatic, or only on command. Thread: setup.
void configure_nuc(Nodes& nodes, const NucOptions& nuc, std::vector<std::string>& warnings);

// The constants of the present range; nothing when the camera does not tell them. Thread: setup.
std::optional<Planck> read_planck(Nodes& nodes);

}  // namespace bolo::genicam
