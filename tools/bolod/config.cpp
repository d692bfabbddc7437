#include "tools/bolod/config.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <optional>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "drivers/shm/shm_object.hpp"
#include "src/capture/pixel_maps_io.hpp"
#include "src/core/input_file.hpp"
#include "src/deblur/isa.hpp"
#include "src/model/strict_toml.hpp"
#include "tools/bolod/control.hpp"
#include "tools/bolod/metrics.hpp"

namespace bolo::daemon {
namespace {

using model::KeyTable;

constexpr std::string_view kHeading =
    "# Configuration of bolod, one file a camera. Every key may be left out; the values here are the defaults.\n"
    "# Relative file names are meant from this file's folder. `bolod --check-config --config FILE` tells what is "
    "wrong.\n"
    "# Keys marked \"live\" are taken up by a running daemon on SIGHUP (systemctl reload); others need a restart.\n\n";

template <typename Enum, std::size_t N>
using Names = std::array<std::pair<std::string_view, Enum>, N>;

constexpr Names<SourceType, 3> kSources{
    {{"genicam", SourceType::kGenicam}, {"v4l2", SourceType::kV4l2}, {"replay", SourceType::kReplay}}};
constexpr Names<std::uint32_t, 4> kContainers{
    {{"y16", V4L2_PIX_FMT_Y16}, {"y14", V4L2_PIX_FMT_Y14}, {"y12", V4L2_PIX_FMT_Y12}, {"yuyv", V4L2_PIX_FMT_YUYV}}};
constexpr Names<replay::Pace, 2> kPaces{
    {{"realtime", replay::Pace::kRealTime}, {"fast", replay::Pace::kAsFastAsPossible}}};
constexpr Names<genicam::PixelOrder, 2> kPixelOrders{
    {{"little", genicam::PixelOrder::kLittleEndian}, {"big", genicam::PixelOrder::kBigEndian}}};
constexpr Names<genicam::IrFormat, 4> kIrFormats{{{"leave", genicam::IrFormat::kLeave},
                                                  {"radiometric", genicam::IrFormat::kRadiometric},
                                                  {"100mk", genicam::IrFormat::kTemperatureLinear100mK},
                                                  {"10mk", genicam::IrFormat::kTemperatureLinear10mK}}};
constexpr Names<spdlog::level::level_enum, 4> kLevels{{{"debug", spdlog::level::debug},
                                                       {"info", spdlog::level::info},
                                                       {"warning", spdlog::level::warn},
                                                       {"error", spdlog::level::err}}};
constexpr Names<LogFormat, 3> kFormats{
    {{"auto", LogFormat::kAuto}, {"text", LogFormat::kText}, {"journal", LogFormat::kJournal}}};

constexpr double kWatchGapS = 60.0;

// Keys that override a value of the profile.
struct Overrides {
  std::optional<double> rate_hz;
  std::optional<genicam::PixelOrder> pixel_order;
  std::optional<int> metadata_rows;
  std::optional<double> tau_s;
  bool scene_nuc = false;  // otherwise by the profile
  bool watch_gap = false;
  std::vector<int> rows;
  double scale_k = 0.0;
};

void source_keys(KeyTable& keys, DaemonConfig& c, Overrides& o) {
  keys.section("source", "where frames come from");
  keys.choice<SourceType>(
      "type", c.source, kSources,
      "genicam: a GigE Vision or USB3 Vision camera. v4l2: a camera on USB that is a video device of the kernel and "
      "sends 16 bits a pixel (Boson, Lepton ...). replay: a capture file.");
  keys.text("address", c.camera.address,
            "Camera: IP address or Aravis device id; empty: the only camera that answers.");
  keys.text(
      "serial", c.camera.serial,
      "Camera: serial number of the one that is meant when there is no address. A lost camera is looked for by it.");
  keys.integer("width", c.camera.width, {0, 4096, "pixels"}, "Camera: columns; 0: as the camera has it.");
  keys.integer("height", c.camera.height, {0, 4096, "rows"},
               "Camera: image rows without metadata rows; 0: as the camera has it.");
  keys.number("rate_hz", o.rate_hz, 200.0, {0.0, 10000.0, "Hz"},
              "Camera: frame rate; 0: as the camera has it. Left out: the profile's frame_period_s decides.");
  keys.number("true_rate_hz", c.camera.true_rate_hz, {0.0, 10000.0, "Hz"},
              "Camera: the rate by its own clock, where it says another (the log warns of that); 0: as it says.");
  keys.choice<genicam::IrFormat>(
      "ir_format", c.camera.ir_format, kIrFormats,
      "Camera: what a count means (FLIR's IRFormat); leave: as the camera has it. radiometric becomes "
      "kelvin here, by the camera's Planck constants; unproven on an A655sc.");
  keys.choice<genicam::PixelOrder>("pixel_order", o.pixel_order, kPixelOrders,
                                   "Camera: byte order of pixels on the wire. Left out: the profile's byte_order.");
  keys.integer("metadata_rows", o.metadata_rows, 3, {0, 64, "rows"},
               "Camera: rows after the image that are dropped. Left out: the profile's metadata_rows.");
  keys.integer("packet_size", c.camera.packet_size, {0, 65536, "bytes"},
               "Camera: size of a network packet, 576 or more; 0: the largest that the link carries.");
  keys.integer("socket_buffer_bytes", c.camera.socket_buffer_bytes, {65536, 1 << 30, "bytes"},
               "Camera: receive buffer; the system's limit is net.core.rmem_max.");
  keys.boolean("resend", c.camera.resend, "Camera: ask for lost packets again; only for cameras that answer.");
  keys.boolean(
      "ptp", c.camera.ptp,
      "Camera: switch PTP (IEEE 1588) on, where it has it; false: as the camera has it. A clock that PTP keeps "
      "is never reset.");
  keys.integer("packet_timeout_us", c.camera.packet_timeout_us, {100, 1000000, "us"},
               "Camera: how long to wait for a packet before asking again.");
  keys.integer("frame_retention_us", c.camera.frame_retention_us, {1000, 10000000, "us"},
               "Camera: how long an incomplete frame may hold up the ones behind it.");
  keys.integer("buffers", c.camera.buffers, {4, 1024, "frames"}, "Camera: frames that the receiver may fill ahead.");
  keys.integer("realtime_priority", c.camera.realtime_priority, {0, 99, ""},
               "Camera: SCHED_FIFO priority of the receiving thread; 0: the default scheduler.");
  keys.integer("stall_ms", c.camera.stall_ms, {10, 60000, "ms"},
               "Camera: without a frame for this long the stream counts as stalled.");
  keys.integer("reconnect_after_ms", c.camera.reconnect_after_ms, {0, 600000, "ms"},
               "Camera: stalled for this long it is opened again; 0: never.");
  keys.text("device", c.video.device,
            "Video device: /dev/videoN, or the serial number of the camera on USB. Its size is as it has it: "
            "v4l2-ctl --set-fmt-video. A lost camera is looked for by its serial number.");
  keys.choice<std::uint32_t>(
      "format", c.video.format, kContainers,
      "Video device: what its driver calls the format. yuyv: 16-bit values under the name of a colour format, as cores "
      "with stacked images send them. Values are taken as they are.");
  keys.integers("rows", o.rows, {0, 16384, ""},
                "Video device: [first, count], the rows of its frames that are the image; the others are metadata or "
                "another image. []: all.");
  keys.number("scale_k", o.scale_k, {0.0, 100.0, "K"},
              "Video device: kelvin a count, of a radiometric camera; 0: values are counts.");
  keys.number("offset_k", c.video.scale.offset, {-1000.0, 1000.0, "K"}, "Video device: kelvin at count 0.");
  keys.file("file", c.replay.file, "capture.h5", "Replay: the capture.");
  keys.choice<replay::Pace>(
      "pace", c.replay.pace, kPaces,
      "Replay: realtime keeps the capture's times and may lose frames; fast waits for everything.");
}

constexpr Names<genicam::NucPolicy, 4> kPolicies{{{"camera", genicam::NucPolicy::kCamera},
                                                  {"manual", genicam::NucPolicy::kManual},
                                                  {"timed", genicam::NucPolicy::kTimed},
                                                  {"still", genicam::NucPolicy::kStill}}};
constexpr double kHottestK = 5000.0;

void nuc_keys(KeyTable& keys, genicam::NucOptions& nuc) {
  keys.section("nuc", "when the camera closes its shutter and corrects its pixels (NUC)");
  keys.choice<genicam::NucPolicy>(
      "policy", nuc.policy, kPolicies,
      "camera: it decides itself, unseen. manual: only by `bolo nuc`. timed: at the interval. still: "
      "when the scene stands still, at least the interval apart.");
  keys.number("interval_s", nuc.interval_s, {1.0, 86400.0, "s"}, "From one to the next.");
  keys.number("still_s", nuc.still_s, {0.2, 3600.0, "s"}, "How long nothing may have moved.");
  keys.number("still_k", nuc.still_k, {0.001, 1000.0, "K (counts when the source has no kelvin)"},
              "A change of the pixels by less than this from one tenth of a second to the next, on average, is none; "
              "noise of s changes them by 1.13 s.");
  keys.integer(
      "hold_ms", nuc.hold_ms, {0, 60000, "ms"},
      "Frames of this time after the command are taken for the shutter's. Unproven: whether the camera repeats "
      "frames meanwhile, or sends none, and for how long.");
}

void object_keys(KeyTable& keys, genicam::ObjectParameters& object) {
  constexpr double kRoomK = 293.15;
  keys.section("object", "what the camera reckons with; unity gives temperatures of black bodies. Left out: as it has");
  keys.number("emissivity", object.emissivity, {0.01, 1.0, ""}, "Of what is looked at.");
  keys.number("transmission", object.transmission, {0.01, 1.0, ""}, "Of the air (EstimatedTransmission).");
  keys.number("optics_transmission", object.optics_transmission, {0.01, 1.0, ""}, "Of a window before the lens.");
  keys.number("reflected_k", object.reflected_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature that it reflects.");
  keys.number("atmosphere_k", object.atmosphere_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature of the air.");
  keys.number("optics_k", object.optics_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature of that window.");
  keys.number("distance_m", object.distance_m, 1.0, {0.0, 1e5, "m"}, "Distance of the object.");
  keys.number("humidity", object.humidity, 0.5, {0.0, 1.0, ""}, "Relative humidity of the air.");
}

void camera_keys(KeyTable& keys, genicam::CameraOptions& camera) {
  keys.section("camera", "what it measures");
  keys.number("range_low_k", camera.range_low_k, {0.0, kHottestK, "K"},
              "With range_high_k: the narrowest of the camera's ranges that holds both is chosen.");
  keys.number("range_high_k", camera.range_high_k, {0.0, kHottestK, "K"}, "0: the camera's range is left.");
  nuc_keys(keys, camera.nuc);
  object_keys(keys, camera.object);
}

Status check_camera(const genicam::CameraOptions& camera) {
  if (camera.range_high_k > 0.0 && camera.range_low_k >= camera.range_high_k) {
    return bad_input("camera.range_low_k must be below camera.range_high_k");
  }
  return {};
}

Status check_address(const std::string& address) {
  in_addr parsed{};
  if (address.empty() || address.find_first_not_of("0123456789.") != std::string::npos) return {};
  if (inet_pton(AF_INET, address.c_str(), &parsed) == 1) return {};
  return bad_input("source.address = \"" + address + "\" is no IPv4 address such as 192.168.2.5");
}

void deblur_keys(KeyTable& keys, DaemonConfig& c, Overrides& o) {
  deblur::Settings& s = c.pipeline.deblur;
  keys.section("deblur", "how frames are made sharp");
  keys.choice<deblur::Method>(
      "solver", s.method, deblur::kMethodNames,
      "admm, dual: fixed iterations, for live work. exact: to convergence, slow. inverse: no prior, for little noise. "
      "mmae: many motion models, weighted. motion: along the scene's own motion, the sharpest; tells the motion beside "
      "each frame.");
  keys.number_or_word(
      "lambda", s.lambda, s.auto_lambda, "auto", {0.0, 1e6, "K (counts when the source has no kelvin)"},
      "Weight of the prior in kappa |V H^T D - Y|^2 + lambda |D|_1. More smooths more; auto follows noise and motion.");
  keys.number("noise_k", s.noise_k, {0.0, 1000.0, "K (counts when the source has no kelvin)"},
              "Temporal noise that mmae, motion and lambda = \"auto\" reckon with; 0: measured.");
  keys.number("kappa", s.kappa, {1e-9, 1e9, ""}, "Weight of the data in the same sum.");
  keys.integer("iterations", s.iterations, {0, 1000, ""},
               "Iterations of admm and dual; 0: as many as the accuracy needs at this lambda.");
  keys.integer("window", s.window, {3, 65, "frames"}, "Frames a window: a power of two, and one.");
  keys.integer("levels", s.levels, {1, 10, ""}, "The window's time is divided into 2^levels bins.");
  keys.integer(
      "lookahead", s.lookahead, {0, 63, "frames"},
      "Frames after the estimated one that the window holds: each costs a frame of delay and lowers the error.");
  keys.integer("workers", c.pipeline.workers, {1, pipeline::kMaxWorkers, "threads"},
               "Threads that share each frame's rows.");
  keys.text("isa", c.isa, "Instruction set of the kernels: AVX3, AVX2, SSE4 ...; auto: the best that runs here.");
  keys.number("tau_s", o.tau_s, c.profile.tau_s, {1e-4, 1.0, "s"},
              "Thermal time constant. Left out: the profile's tau_s.");
  keys.section("corrections", "what is taken out of frames before they are made sharp, beyond what the profile says");
  keys.boolean("scene_nuc", o.scene_nuc,
               "Learn the pattern that stays while the scene moves, and take it out (scene-based NUC).");
}

void motion_keys(KeyTable& keys, DaemonConfig& c) {
  keys.section("motion", "what helps solver = \"motion\"");
  keys.text("gyro", c.gyro,
            "A gyro beside the camera: \"shm:NAME\", angular rates in the shared memory /bolo-gyro.NAME "
            "(bolo/gyro_shm.h); the profile has its [lens]. Empty: none. It is never needed.");
}

Status check_gyro(const DaemonConfig& config) {
  if (config.gyro.empty()) return {};
  if (!config.gyro.starts_with(kShmGyro)) return bad_input("motion.gyro must be \"shm:NAME\", or empty for none");
  if (const auto path = shm::object_path(config.gyro.substr(kShmGyro.size())); !path) {
    return bad_input("motion.gyro: " + path.error().message);
  }
  return deblur::check_gyro(config.pipeline.deblur);
}

void pipeline_keys(KeyTable& keys, DaemonConfig& c) {
  keys.section("pipeline", "threads and memory");
  keys.integer("queue_frames", c.pipeline.queue_frames, {1, 4096, "frames"},
               "Frames that may wait between camera and deblurring.");
  keys.boolean(
      "degrade", c.pipeline.degrade,
      "When deblurring can't keep up, spend less on frames rather than lose them: from 1/8 of the queue (or 40 ms of "
      "frames) on a cheaper solver, from 1/4 (80 ms) the inverse filter, from 1/2 (160 ms) the raw frame. Each such "
      "frame carries a flag.");
  keys.integer("realtime_priority", c.pipeline.thread.realtime_priority, {0, 99, ""},
               "SCHED_FIFO priority of the deblurring threads; 0: the default scheduler.");
  keys.integers("cpus", c.pipeline.thread.cpus, {0, 4095, ""}, "CPUs that the deblurring threads keep to; []: any.");
  keys.boolean("lock_memory", c.lock_memory, "Keep all memory from being swapped out (mlockall), when allowed.");
}

void output_keys(KeyTable& keys, DaemonConfig& c, Overrides& o) {
  keys.section("watch", "whether the camera still does what its profile says");
  keys.boolean("gap", o.watch_gap,
               "Once a minute, compare 32 frames with what the profile foretells of them; `bolo stat`, the metrics and "
               "the log (gap_grew) say when time constant or noise are others.");
  for (const auto& sink : c.sinks) sink->declare(keys);
  c.ros2.declare(keys);
  keys.section("control", "commands to the running daemon: `bolo nuc NAME`");
  keys.boolean("enable", c.control.enabled, "Listen on a unix socket.");
  keys.text(
      "socket", c.control.socket,
      "Its path; empty: NAME.sock in the runtime directory (RUNTIME_DIRECTORY, /run/bolo, XDG_RUNTIME_DIR/bolo).");
  keys.octal("mode", c.control.mode, {0600, 0777, ""}, "Permission bits; whoever may write to it may send commands.");
  keys.section("metrics", "numbers for Prometheus, at http://LISTEN/metrics");
  keys.boolean("enable", c.metrics.enabled, "Answer scrapes.");
  keys.text("listen", c.metrics.listen, "Address and port.");
  keys.boolean("allow_remote", c.metrics.allow_remote,
               "Let `listen` be an address that other computers reach. Who reaches it may read; nothing is asked.");
  keys.section("log", "messages");
  keys.choice<spdlog::level::level_enum>("level", c.log.level, kLevels,
                                         "The least important messages that are written.");
  keys.choice<LogFormat>(
      "format", c.log.format, kFormats,
      "text: time, level, message on standard error. journal: to systemd's journal, with fields (BOLO_EVENT "
      "...). auto: journal for a service whose standard error is the journal.");
}

KeyTable config_keys(DaemonConfig& config, Overrides& overrides) {
  KeyTable keys;
  keys.text("name", config.name, "Name of this daemon's shared memory, /bolo.NAME: letters, digits, '-', '_', '.'.");
  keys.file("profile", config.profile_file, "a655sc.toml",
            "Camera profile. Left out: what is known of the A655sc at 200 Hz.");
  source_keys(keys, config, overrides);
  camera_keys(keys, config.camera);
  deblur_keys(keys, config, overrides);
  motion_keys(keys, config);
  pipeline_keys(keys, config);
  output_keys(keys, config, overrides);
  for (const std::string& key : live_keys(config)) keys.mark(key, "live");
  return keys;
}

// Size and time of the maps file, which is large and always replaced as a whole.
std::string stamp(const std::filesystem::path& file) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(file, error);
  const auto time = std::filesystem::last_write_time(file, error);
  return error ? "" : std::to_string(bytes) + " " + std::to_string(time.time_since_epoch().count());
}

// Changes of the profile and its maps count as changes of the configuration.
void note_profile(DaemonConfig& config) {
  if (config.profile_file.empty()) return;
  config.texts.emplace("what the profile says", read_input(config.profile_file).value_or(""));
  if (!config.profile.maps.empty()) config.texts.emplace("the profile's maps", stamp(config.profile.maps));
}

// Applies the profile first, then the keys that override it.
Status apply_profile(const KeyTable& keys, DaemonConfig& config, const Overrides& overrides) {
  if (!config.profile_file.empty()) {
    ASSIGN_OR_RETURN(config.profile, at(keys.where("profile") + "profile", model::read_profile(config.profile_file)));
  }
  ASSIGN_OR_RETURN(model::PixelMaps maps, capture::read_profile_maps(config.profile));
  pipeline::apply_profile(config.profile, std::move(maps), config.pipeline);
  const model::CameraProfile& profile = config.profile;
  const auto order = profile.big_endian_pixels ? genicam::PixelOrder::kBigEndian : genicam::PixelOrder::kLittleEndian;
  config.camera.rate_hz = overrides.rate_hz.value_or(1.0 / profile.frame_period_s);
  config.camera.pixel_order = overrides.pixel_order.value_or(order);
  config.camera.metadata_rows = overrides.metadata_rows.value_or(profile.metadata_rows);
  if (overrides.tau_s) config.pipeline.deblur.tau_s = *overrides.tau_s;
  config.pipeline.undo.scene_nuc |= overrides.scene_nuc;
  config.pipeline.deblur.period_s = profile.frame_period_s;
  config.pipeline.thread.name = "bolo-deblur";
  if (overrides.watch_gap) config.pipeline.watch_gap_s = kWatchGapS;
  v4l2_source::V4l2SourceOptions& video = config.video;
  if (overrides.scale_k > 0.0) video.scale = {Unit::kKelvin, overrides.scale_k, video.scale.offset};
  if (overrides.rows.size() == 2) video.rows = {overrides.rows[0], overrides.rows[1]};
  video.frame_period_s = profile.frame_period_s;
  video.realtime_priority = config.camera.realtime_priority;
  video.stall_ms = config.camera.stall_ms;
  video.reconnect_after_ms = config.camera.reconnect_after_ms;
  if (!config.control.enabled) config.control.socket.clear();
  if (config.control.enabled && config.control.socket.empty()) {
    config.control.socket = default_control_socket(config.name);
  }
  return {};
}

Status check_together(const KeyTable& keys, const DaemonConfig& config, const Overrides& overrides) {
  const auto here = [&keys](std::string_view path, const std::string& message) {
    return bad_input(keys.where(path) + message);
  };
  if (const auto path = shm::object_path(config.name); !path) return here("name", "name: " + path.error().message);
  const int packet = config.camera.packet_size;
  if (packet != 0 && packet < genicam::kSmallestPacket) {
    return here(
        "source.packet_size",
        fmt::format("source.packet_size = {} is too small: give {} bytes or more, or 0 for the largest that the "
                    "link carries",
                    packet, genicam::kSmallestPacket));
  }
  if (!overrides.rows.empty() && (overrides.rows.size() != 2 || overrides.rows[1] == 0)) {
    return here("source.rows", "source.rows must be [first, count], for example [192, 192], or [] for all");
  }
  if (config.source == SourceType::kV4l2 && config.video.device.empty()) {
    return here("source.device", "source.device is empty: give /dev/videoN, or the camera's serial number");
  }
  if (config.source == SourceType::kReplay && config.replay.file.empty()) {
    return here("source.type", "source.type = \"replay\" needs source.file, the capture to replay");
  }
  std::error_code none;  // of an impossible file name
  if (config.source == SourceType::kReplay && !std::filesystem::exists(config.replay.file, none)) {
    return here("source.file", "source.file: there is no " + config.replay.file.string());
  }
  if (const Status address = check_address(config.camera.address); !address) {
    return here("source.address", address.error().message);
  }
  if (const Status camera = check_camera(config.camera); !camera) return here("camera", camera.error().message);
  if (const Status isa = deblur::check_isa(config.isa); !isa) return here("deblur.isa", isa.error().message);
  if (const Status status = deblur::validate(config.pipeline.deblur); !status) return here("", status.error().message);
  if (const Status gyro = check_gyro(config); !gyro) return here("motion.gyro", gyro.error().message);
  const pipeline::SinkContext context = config.sink_context();
  for (std::size_t i = 0; i < config.sinks.size(); ++i) {
    if (Status sink = config.sinks[i]->check(keys, context, {config.sinks.data(), i}); !sink) return sink;
  }
  if (Status ros2 = config.ros2.check(keys, !config.sinks.front()->describe(context).empty()); !ros2) return ros2;
  if (const Status listen = check_listen(config.metrics); !listen)
    return here("metrics.listen", listen.error().message);
  if (const std::string& socket = config.control.socket; socket != default_control_socket(config.name)) {
    if (const Status path = check_control_socket(socket); !path) return here("control.socket", path.error().message);
  }
  return {};
}

}  // namespace

DaemonConfig::DaemonConfig() {
  pipeline.degrade = true;
  pipeline.deblur.auto_lambda = true;
  camera.width = 640;
  camera.height = 120;
}

pipeline::SinkContext DaemonConfig::sink_context() const {
  const Geometry frame = source == SourceType::kGenicam ? Geometry{camera.width, camera.height} : Geometry{};
  return {name, control.socket, frame, pipeline.deblur};
}

Result<DaemonConfig> read_config(const std::filesystem::path& file) {
  DaemonConfig config;
  Overrides overrides;
  KeyTable keys = config_keys(config, overrides);
  const Status read = keys.read(file);
  if (!read && model::read_profile(file)) {
    return bad_input(file.string() + ": this is a camera's profile: a configuration names it, profile = '" +
                     file.filename().string() + "'");
  }
  RETURN_IF_ERROR(read);
  config.file = file;
  config.texts = config_keys(config, overrides).texts();
  RETURN_IF_ERROR(apply_profile(keys, config, overrides));
  if (const Status status = check_together(keys, config, overrides); !status)
    return tl::unexpected<Error>(status.error());
  note_profile(config);
  return config;
}

std::vector<std::string> live_keys(const DaemonConfig& config) {
  std::vector<std::string> keys{"log.level",   "nuc.policy",  "nuc.interval_s",
                                "nuc.still_s", "nuc.still_k", "nuc.hold_ms"};
  for (const auto& sink : config.sinks) std::ranges::move(sink->live_keys(), std::back_inserter(keys));
  return keys;
}

ConfigChange compare(const DaemonConfig& running, const DaemonConfig& read) {
  ConfigChange change;
  const std::vector<std::string> taken_up = live_keys(read);
  for (const auto& [key, text] : read.texts) {
    const auto before = running.texts.find(key);
    if (before != running.texts.end() && before->second == text) continue;
    const bool live = std::ranges::find(taken_up, key) != taken_up.end();
    (live ? change.live : change.restart).push_back(key);
  }
  return change;
}

std::string document_config() {
  DaemonConfig config;
  Overrides overrides;
  return std::string(kHeading) + config_keys(config, overrides).document();
}

}  // namespace bolo::daemon
