// Configures the camera as the options ask (image, temperature range, object parameters, NUC mode), and reads back the
// format that it will send.
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

// The camera's report of its clock's synchronisation by PTP.
struct PtpState {
  bool enabled = false;
  std::string status{};        // "Slave": it follows a master; "Listening", "Master" ...; empty: it does not say
  std::int64_t offset_ns = 0;  // from its master, as the camera reckons; 0 when unknown
};
PtpState read_ptp(Nodes& nodes);
// By SFNC's names of the states ("PreMaster"); kOff for one that it does not have. Thread: any.
pipeline::PtpStatus ptp_status(const PtpState& ptp);

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

// Touches only nodes that the camera has; a parameter that was asked for and is not there is a warning. Thread: setup.
void configure_object(Nodes& nodes, const ObjectParameters& object, std::vector<std::string>& warnings);

// Chooses the narrowest range ("case") that holds the temperatures asked for; kBadInput with the camera's own when none
// does. The ranges and the current one are a note. Thread: setup.
Status configure_range(Nodes& nodes, const CameraOptions& options, std::vector<std::string>& notes,
                       std::vector<std::string>& warnings);

// Sets NUCMode: automatic, or only on command. Thread: setup.
void configure_nuc(Nodes& nodes, const NucOptions& nuc, std::vector<std::string>& warnings);

// The constants of the present range; nothing when the camera does not state them. Thread: setup.
std::optional<Planck> read_planck(Nodes& nodes);

}  // namespace bolo::genicam
