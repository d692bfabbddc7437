// Configures the camera as the options ask, and reads back the format that it will send.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/genicam/connection.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::genicam {

struct Negotiated {
  pipeline::SourceInfo info;                // geometry without metadata rows
  std::vector<std::uint16_t> kelvin_table;  // from the camera's counts to those of `info`; empty: they are the same
  std::vector<std::string> notes;           // worth a line in the log, and no reason to worry
  // The camera was given another windowing, over which it may drop the connection; the rest is not configured yet.
  bool windowing_changed = false;
};

// Touches only nodes that the camera has. A setting that it rounds, or that cannot be checked, is a warning with what
// was asked and what was got; one that it refuses is an error. Thread: setup.
Result<Negotiated> configure(const Connection& connection, const CameraOptions& options,
                             std::vector<std::string>& warnings);

// The largest packet that the link carries, or options.packet_size; GigE Vision only. Thread: setup.
Status configure_packet_size(const Connection& connection, const CameraOptions& options,
                             std::vector<std::string>& warnings);

}  // namespace bolo::genicam
