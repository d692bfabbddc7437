#include "drivers/genicam/settings.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>
#include <string_view>

#include <fmt/format.h>

namespace bolo::genicam {
namespace {

using Warnings = std::vector<std::string>;

// FLIR's names and values, as found in programs that use the A6xx series.
struct IrFormatEntry {
  IrFormat format;
  const char* entry;
  int value;
  LinearScale scale;
};
constexpr std::array<IrFormatEntry, 3> kIrFormats{{
    {IrFormat::kRadiometric, "Radiometric", 0, {Unit::kCount, 1.0, 0.0}},
    {IrFormat::kTemperatureLinear100mK, "TemperatureLinear100mK", 1, {Unit::kKelvin, 0.1, 0.0}},
    {IrFormat::kTemperatureLinear10mK, "TemperatureLinear10mK", 2, {Unit::kKelvin, 0.01, 0.0}},
}};

constexpr std::array<const char*, 3> kWindowings{"Off", "Half", "Quarter"};
constexpr std::array<const char*, 5> kFrameRates{"Rate50Hz", "Rate25Hz", "Rate12Hz", "Rate6Hz", "Rate3Hz"};
constexpr double kFullFrameRateHz = 50.0;  // Rate50Hz at full height; each step below halves it
constexpr int kSensorRows = 480;           // of the A6xx series
constexpr double kSameRate = 0.01;         // relative; a smaller difference counts as the requested rate
constexpr double kNearestRate = 0.1;       // Rate12Hz is 12.5 Hz
constexpr int kLargestPacket = 9000;       // jumbo frames; larger ones bring no benefit
constexpr int kPacketOfAnyLink = 1500;
constexpr std::int64_t kMostPixels = 32 << 20;  // larger than any thermal camera

const IrFormatEntry* entry_of(IrFormat format) {
  const auto* at =
      std::find_if(kIrFormats.begin(), kIrFormats.end(), [&](const auto& e) { return e.format == format; });
  return at != kIrFormats.end() ? at : nullptr;
}

void enable_ptp(Nodes& nodes, Warnings& warnings) {
  for (const char* enable : {"PtpEnable", "GevIEEE1588"}) {
    if (!nodes.has(enable)) continue;
    if (!nodes.boolean(enable)) nodes.set_boolean(enable, true);
    return;
  }
  warnings.push_back("the camera has no PTP (neither PtpEnable nor GevIEEE1588): its clock runs by itself");
}

// Sets IRFormat; returns the scale of its counts.
LinearScale configure_ir_format(Nodes& nodes, IrFormat wanted, Warnings& warnings) {
  const IrFormatEntry* entry = entry_of(wanted);
  if (!nodes.has("IRFormat")) {
    if (entry == nullptr) return {Unit::kCount, 1.0, 0.0};
    warnings.push_back(std::string("the camera has no IRFormat: its counts are taken as ") + entry->entry +
                       " without a check");
    return entry->scale;
  }
  if (entry != nullptr) {
    nodes.choose("IRFormat", entry->entry, entry->value);
    return entry->scale;
  }
  const std::int64_t value = nodes.integer("IRFormat");
  for (const IrFormatEntry& e : kIrFormats) {
    if (e.value == value) return e.scale;
  }
  return {Unit::kCount, 1.0, 0.0};
}

// Converts radiometric counts to 10 mK on input, if the camera states its constants.
void make_kelvin(Nodes& nodes, const ObjectParameters& object, Negotiated& result, Warnings& warnings) {
  const std::optional<Planck> planck = read_planck(nodes);
  if (!planck) {
    warnings.push_back("the camera does not tell its Planck constants (R, B, F, J0, J1): frames stay in counts");
    return;
  }
  result.kelvin_table = kelvin_table(*planck, object);
  result.info.format.scale = {Unit::kKelvin, 0.01, 0.0};
  result.notes.push_back(
      fmt::format("radiometric counts become kelvin here, by R = {:g}, B = {:g}, F = {:g}, J0 = {:g}, J1 = {:g}",
                  planck->r, planck->b, planck->f, planck->j0, planck->j1));
}

// At least the rows of the A6xx series, because SensorHeight may follow the window.
int sensor_rows(Nodes& nodes) {
  const int rows = nodes.has("SensorHeight") ? static_cast<int>(nodes.integer("SensorHeight")) : 0;
  return std::max(rows, kSensorRows);
}

// Sets the smallest window that holds the height. True when this changed the window.
bool configure_windowing(Nodes& nodes, const CameraOptions& options) {
  if (!nodes.has("IRWindowing") || options.height == 0) return false;
  const int rows = sensor_rows(nodes);
  const int window = options.height <= rows / 4 ? 2 : options.height <= rows / 2 ? 1 : 0;
  if (nodes.integer("IRWindowing") == window) return false;
  nodes.choose("IRWindowing", kWindowings[static_cast<std::size_t>(window)], window);
  return nodes.ok();
}

// Sets a size exactly. Writes only a different value: some cameras lock sizes that they derive themselves.
void configure_size(Nodes& nodes, const char* name, const char* key, int wanted, Status& refused) {
  if (wanted == 0 || nodes.integer(name) == wanted || !nodes.ok()) return;
  nodes.set_integer(name, wanted);
  const std::int64_t got = nodes.integer(name);
  if (nodes.ok() && got == wanted) return;
  Error error = nodes.ok() ? Error{ErrorKind::kBadInput,
                                   fmt::format("the camera does not take {} = {}: it stays at {}", name, wanted, got)}
                           : nodes.status().error();
  if (error.kind == ErrorKind::kBadInput) error.message += fmt::format("; source.{} = 0 takes the camera's own", key);
  if (refused) refused = tl::unexpected<Error>(std::move(error));
}

// Image size without metadata rows; limited, because memory is allocated for many images.
Result<Geometry> read_geometry(Nodes& nodes, const std::string& camera, int metadata_rows) {
  const std::int64_t width = nodes.integer("Width");
  const std::int64_t height = std::max<std::int64_t>(nodes.integer("Height"), 0) - metadata_rows;
  if (!nodes.ok()) return at(camera, nodes.status().error());
  if (width <= 0 || height <= 0) {
    return bad_input(
        fmt::format("{}: no image rows are left of its height after {} metadata rows", camera, metadata_rows));
  }
  if (width > kMostPixels || height > kMostPixels / width) {
    return bad_input(fmt::format("{} says that its frames are {}x{}: {} pixels at most are taken", camera, width,
                                 height, kMostPixels));
  }
  return Geometry{static_cast<int>(width), static_cast<int>(height)};
}

Status configure_pixel_format(Nodes& nodes) {
  if (nodes.text("PixelFormat") == "Mono16") return nodes.status();
  const std::vector<std::string> offered = nodes.entries("PixelFormat");
  if (!nodes.ok()) return nodes.status();
  if (std::find(offered.begin(), offered.end(), "Mono16") == offered.end()) {
    return bad_input(fmt::format("the camera cannot send Mono16; it offers: {}", fmt::join(offered, ", ")));
  }
  nodes.choose("PixelFormat", "Mono16", ARV_PIXEL_FORMAT_MONO_16);
  return nodes.status();
}

// FLIR: IRFrameRate is for the full frame; half windowing doubles, quarter quadruples it. Returns the actual rate.
double configure_ir_frame_rate(Nodes& nodes, double rate_hz, Warnings& warnings) {
  const double speedup = nodes.has("IRWindowing") ? std::exp2(static_cast<double>(nodes.integer("IRWindowing"))) : 1.0;
  const double full_hz = kFullFrameRateHz * speedup;
  if (rate_hz > 0.0) {
    const double steps = std::clamp(std::round(std::log2(full_hz / rate_hz)), 0.0, kFrameRates.size() - 1.0);
    const auto step = static_cast<std::size_t>(steps);
    nodes.choose("IRFrameRate", kFrameRates[step], static_cast<int>(step));
  }
  const double got_hz = full_hz / std::exp2(static_cast<double>(nodes.integer("IRFrameRate")));
  if (rate_hz > 0.0 && nodes.ok() && std::abs(got_hz / rate_hz - 1.0) > kNearestRate) {
    warnings.push_back(
        fmt::format("asked for {:g} Hz, the camera runs at {:g} Hz: {}", rate_hz, got_hz,
                    got_hz == full_hz && got_hz < rate_hz ? "fewer rows allow more" : "it has no rate that is nearer"));
  }
  return got_hz;
}

double configure_standard_frame_rate(Nodes& nodes, double rate_hz, Warnings& warnings) {
  if (rate_hz > 0.0) {
    if (nodes.has("AcquisitionFrameRateEnable")) nodes.set_boolean("AcquisitionFrameRateEnable", true);
    nodes.set_real("AcquisitionFrameRate", rate_hz);
  }
  const double got_hz = nodes.real("AcquisitionFrameRate");
  if (rate_hz > 0.0 && nodes.ok() && std::abs(got_hz / rate_hz - 1.0) > kSameRate) {
    warnings.push_back(fmt::format("asked for {:g} Hz, the camera runs at {:g} Hz", rate_hz, got_hz));
  }
  return got_hz;
}

double configure_rate(Nodes& nodes, double rate_hz, Warnings& warnings) {
  if (nodes.has("IRFrameRate")) return configure_ir_frame_rate(nodes, rate_hz, warnings);
  if (nodes.has("AcquisitionFrameRate")) return configure_standard_frame_rate(nodes, rate_hz, warnings);
  if (rate_hz > 0.0)
    warnings.push_back(fmt::format("the camera does not say its frame rate: {:g} Hz assumed", rate_hz));
  return rate_hz;
}

constexpr int kMostCases = 32;

struct Case {
  double low_k = 0.0;
  double high_k = 0.0;
};

std::string text_of(const Case& c) { return fmt::format("{:.0f} to {:.0f} K", c.low_k, c.high_k); }

std::vector<Case> read_cases(Nodes& nodes) {
  std::vector<Case> cases;
  const auto count = static_cast<int>(nodes.integer("NumCases"));
  for (int i = 0; i < std::min(count, kMostCases); ++i) {
    nodes.set_integer("QueryCase", i);
    cases.push_back({nodes.real("QueryCaseLowLimit"), nodes.real("QueryCaseHighLimit")});
  }
  return cases;
}

// The narrowest range that includes both; cases.size() when there is none.
std::size_t choose_case(const std::vector<Case>& cases, double low_k, double high_k) {
  std::size_t chosen = cases.size();
  double width_k = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const Case& c = cases[i];
    if (c.low_k > low_k || c.high_k < high_k || c.high_k - c.low_k >= width_k) continue;
    chosen = i;
    width_k = c.high_k - c.low_k;
  }
  return chosen;
}

}  // namespace

// Tries the node names of SFNC 2.3 and those of earlier GigE Vision cameras. Values are those of the last latch.
PtpState read_ptp(Nodes& nodes) {
  PtpState state;
  for (const char* enable : {"PtpEnable", "GevIEEE1588"}) {
    if (nodes.has(enable)) state.enabled = state.enabled || nodes.boolean(enable);
  }
  if (!state.enabled) return state;
  if (nodes.has("PtpDataSetLatch")) nodes.execute("PtpDataSetLatch");
  for (const char* status : {"PtpStatus", "GevIEEE1588Status"}) {
    if (state.status.empty() && nodes.has(status)) state.status = nodes.text(status);
  }
  if (nodes.has("PtpOffsetFromMaster")) state.offset_ns = nodes.integer("PtpOffsetFromMaster");
  return state;
}

pipeline::PtpStatus ptp_status(const PtpState& ptp) {
  if (!ptp.enabled) return pipeline::PtpStatus::kOff;
  const auto letters = [](std::string_view text) {
    std::string kept;
    for (const char c : text) {
      if (std::isalpha(static_cast<unsigned char>(c)) != 0)
        kept += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    }
    return kept;
  };
  const std::string status = letters(ptp.status);
  for (std::size_t i = 1; i < pipeline::kPtpStatuses; ++i) {
    if (letters(name(static_cast<pipeline::PtpStatus>(i))) == status) return static_cast<pipeline::PtpStatus>(i);
  }
  return pipeline::PtpStatus::kOff;
}

Result<Negotiated> configure(const Connection& connection, const CameraOptions& options, Warnings& warnings) {
  Nodes nodes(connection.device.get());
  Negotiated result;
  StreamFormat& format = result.info.format;
  if (nodes.has("DeviceModelName")) result.info.camera_model = nodes.text("DeviceModelName");
  result.info.camera_serial = read_serial(nodes);

  result.windowing_changed = configure_windowing(nodes, options);
  if (result.windowing_changed) return result;
  RETURN_IF_ERROR(at(connection.name, configure_range(nodes, options, result.notes, warnings)));
  format.scale = configure_ir_format(nodes, options.ir_format, warnings);
  configure_object(nodes, options.object, warnings);
  configure_nuc(nodes, options.nuc, warnings);
  // Unrequested counts keep the camera's unit.
  if (options.ir_format == IrFormat::kRadiometric) make_kelvin(nodes, options.object, result, warnings);
  if (Status mono16 = configure_pixel_format(nodes); !mono16) return at(connection.name, std::move(mono16.error()));

  Status size;
  configure_size(nodes, "Width", "width", options.width, size);
  configure_size(nodes, "Height", "height", options.height == 0 ? 0 : options.height + options.metadata_rows, size);
  if (!size) return at(connection.name, std::move(size.error()));
  ASSIGN_OR_RETURN(format.geometry, read_geometry(nodes, connection.name, options.metadata_rows));

  if (options.ptp) enable_ptp(nodes, warnings);
  const double rate_hz = configure_rate(nodes, options.rate_hz, warnings);
  if (nodes.has("AcquisitionMode")) nodes.choose("AcquisitionMode", "Continuous", 0);
  if (!nodes.ok()) return at(connection.name, nodes.status().error());

  if (!(rate_hz > 0.0)) return bad_input(connection.name + " does not say its frame rate: set the rate");
  format.frame_period_s = 1.0 / (options.true_rate_hz > 0.0 ? options.true_rate_hz : rate_hz);
  return result;
}

Status configure_packet_size(const Connection& connection, const CameraOptions& options, Warnings& warnings) {
  if (!connection.is_gige()) return {};
  ArvGvDevice* device = ARV_GV_DEVICE(connection.device.get());
  const Route& route = connection.route;
  if (options.packet_size > 0 && options.packet_size < kSmallestPacket) {
    return bad_input(
        fmt::format("packet size {} is too small: give {} or more, or 0 for the largest that the link carries",
                    options.packet_size, kSmallestPacket));
  }
  if (options.packet_size > route.mtu) {
    return bad_input(
        fmt::format("packet size {0} does not fit the MTU of {1}, {2}: lower it, or ip link set dev {1} mtu {0}",
                    options.packet_size, route.interface, route.mtu));
  }
  // Without a test packet, only loopback is known to carry more than 1500 bytes.
  const bool testable = arv_device_get_feature(connection.device.get(), "GevSCPSFireTestPacket") != nullptr;
  const int safe = route.loopback ? kLargestPacket : kPacketOfAnyLink;
  const int wanted =
      options.packet_size > 0 ? options.packet_size : std::min(route.mtu, testable ? kLargestPacket : safe);
  GlibError error;
  arv_gv_device_set_packet_size(device, wanted, error.out());
  guint got = error ? 0 : arv_gv_device_get_packet_size(device, error.out());
  if (!error && options.packet_size == 0 && testable && !route.loopback) {
    got = arv_gv_device_auto_packet_size(device, error.out());
  }
  if (error) return failed(connection.name + ": packet size not set (" + error.message() + ")");
  if (options.packet_size > 0 && static_cast<int>(got) != wanted) {
    warnings.push_back(fmt::format("asked for packets of {} bytes, the camera sends {}", wanted, got));
  }
  arv_gv_device_set_packet_size_adjustment(device, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
  return {};
}

void configure_object(Nodes& nodes, const ObjectParameters& object, std::vector<std::string>& warnings) {
  const auto set = [&](const char* node, std::optional<double> value, bool asked) {
    if (!value) return;
    if (nodes.has(node)) {
      nodes.set_real(node, *value);
    } else if (asked) {
      warnings.push_back(std::string("the camera has no ") + node + ": its temperatures are without it");
    }
  };
  set("ObjectEmissivity", object.emissivity, object.emissivity != 1.0);
  set("EstimatedTransmission", object.transmission, object.transmission != 1.0);
  set("ExtOpticsTransmission", object.optics_transmission, object.optics_transmission != 1.0);
  set("ReflectedTemperature", object.reflected_k, true);
  set("AtmosphericTemperature", object.atmosphere_k, true);
  set("ExtOpticsTemperature", object.optics_k, true);
  set("ObjectDistance", object.distance_m, true);
  set("RelativeHumidity", object.humidity, true);
}

Status configure_range(Nodes& nodes, const CameraOptions& options, std::vector<std::string>& notes,
                       std::vector<std::string>& warnings) {
  const bool asked = options.range_high_k > 0.0;
  if (!nodes.has("NumCases") || !nodes.has("QueryCase") || !nodes.has("CurrentCase")) {
    if (asked) warnings.push_back("the camera does not tell its ranges: it keeps the one it has");
    return nodes.status();
  }
  const std::vector<Case> cases = read_cases(nodes);
  if (!nodes.ok()) return nodes.status();
  std::string list;
  for (const Case& c : cases) list += (list.empty() ? "" : ", ") + text_of(c);
  if (asked) {
    const std::size_t chosen = choose_case(cases, options.range_low_k, options.range_high_k);
    if (chosen == cases.size()) {
      return bad_input("no range of the camera holds " + text_of({options.range_low_k, options.range_high_k}) +
                       "; it offers: " + list);
    }
    if (nodes.integer("CurrentCase") != static_cast<std::int64_t>(chosen)) {
      nodes.set_integer("CurrentCase", static_cast<std::int64_t>(chosen));
    }
  }
  const auto current = static_cast<std::size_t>(nodes.integer("CurrentCase"));
  if (nodes.ok() && current < cases.size()) {
    notes.push_back("the camera measures " + text_of(cases[current]) + "; it offers: " + list);
  }
  return nodes.status();
}

void configure_nuc(Nodes& nodes, const NucOptions& nuc, std::vector<std::string>& warnings) {
  const bool itself = nuc.policy == NucPolicy::kCamera;
  // Untested: the entries' names; their values are 0 and 1 in programs that use the A6xx series.
  if (nodes.has("NUCMode")) {
    nodes.choose("NUCMode", itself ? "Automatic" : "Off", itself ? 1 : 0);
  } else if (!itself && nodes.ok()) {
    warnings.push_back("the camera has no NUCMode: it may correct itself besides");
  }
  const bool asks = nuc.policy == NucPolicy::kTimed || nuc.policy == NucPolicy::kStill;
  if (asks && !nodes.has("NUCAction") && nodes.ok()) {
    warnings.push_back("the camera has no NUCAction: nuc.policy is without effect");
  }
}

std::optional<Planck> read_planck(Nodes& nodes) {
  for (const char* node : {"R", "B", "F", "J0", "J1"}) {
    if (!nodes.has(node)) return std::nullopt;
  }
  const Planck planck{nodes.number("R"), nodes.number("B"), nodes.number("F"), nodes.number("J0"), nodes.number("J1")};
  const bool sane = nodes.ok() && planck.r > 0.0 && planck.b > 0.0 && planck.j1 > 0.0;
  return sane ? std::optional(planck) : std::nullopt;
}

}  // namespace bolo::genicam
