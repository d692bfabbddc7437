// Configures image, temperature range, object parameters and NUC mode; reads back the resulting format.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/genicam/connection.hpp"
#include "drivers/genicam/nodes.hpp"
#include "drivers/genicam/radiometry.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::genicam {

// State of the camera's PTP synchronisation.
struct PtpState {
  bool enabled = false;
  std::string status{};        // "Slave": follows a master; "Listening", "Master" ...; empty: not stated
  std::int64_t offset_ns = 0;  // from its master, computed by the camera; 0 when unknown
};
PtpState read_ptp(Nodes& nodes);
// From the state names of the SFNC ("PreMaster"); kOff for an unknown one. Thread: any.
pipeline::PtpStatus ptp_status(const PtpState& ptp);

struct Negotiated {
  pipeline::SourceInfo info;                // geometry without metadata rows
  std::vector<std::uint16_t> kelvin_table;  // from the camera's counts to those of `info`; empty: identity
  std::vector<std::string> notes;           // informational log lines
  // The windowing was changed, after which the camera may drop the connection; the rest is not configured yet.
  bool windowing_changed = false;
};

// Accesses only nodes that the camera has. A rounded or unverifiable setting is a warning with the requested and the
// actual value; a refused one is an error. Thread: setup.
Result<Negotiated> configure(const Connection& connection, const CameraOptions& options,
                             std::vector<std::string>& warnings);

// Sets the largest packet that the link carries, or options.packet_size; GigE Vision only. Thread: setup.
Status configure_packet_size(const Connection& connection, const CameraOptions& options,
                             std::vector<std::string>& warnings);

// Accesses only nodes that the camera has; a missing one that was requested is a warning. Thread: setup.
void configure_object(Nodes& nodes, const ObjectParameters& object, std::vector<std::string>& warnings);

// Selects the narrowest range ("case") that includes the requested temperatures; kBadInput, with the available ranges,
// when none does. The ranges and the current one are a note. Thread: setup.
Status configure_range(Nodes& nodes, const CameraOptions& options, std::vector<std::string>& notes,
                       std::vector<std::string>& warnings);

// Sets NUCMode: automatic, or only on command. Thread: setup.
void configure_nuc(Nodes& nodes, const NucOptions& nuc, std::vector<std::string>& warnings);

// Constants of the current range; nothing when the camera does not state them. Thread: setup.
std::optional<Planck> read_planck(Nodes& nodes);

}  // namespace bolo::genicam
