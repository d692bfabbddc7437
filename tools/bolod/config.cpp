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
    "# Relative file names start at this file's folder. `bolod --check-config --config FILE` checks a file.\n"
    "# A running daemon adopts keys marked \"live\" on SIGHUP (systemctl reload); others need a restart.\n\n";

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
  keys.text("serial", c.camera.serial,
            "Camera: its serial number, if no address is given. A lost camera is searched for by it.");
  keys.integer("width", c.camera.width, {0, 4096, "pixels"}, "Camera: columns; 0: the camera's own setting.");
  keys.integer("height", c.camera.height, {0, 4096, "rows"},
               "Camera: image rows without metadata rows; 0: the camera's own setting.");
  keys.number("rate_hz", o.rate_hz, 200.0, {0.0, 10000.0, "Hz"},
              "Camera: frame rate; 0: the camera's own setting. Left out: from the profile's frame_period_s.");
  keys.number(
      "true_rate_hz", c.camera.true_rate_hz, {0.0, 10000.0, "Hz"},
      "Camera: true rate, if it differs from the one that the camera states (the log warns of it); 0: as stated.");
  keys.choice<genicam::IrFormat>(
      "ir_format", c.camera.ir_format, kIrFormats,
      "Camera: meaning of a count (FLIR's IRFormat); leave: the camera's own setting. radiometric is converted to "
      "kelvin here, with the camera's Planck constants; unproven on an A655sc.");
  keys.choice<genicam::PixelOrder>("pixel_order", o.pixel_order, kPixelOrders,
                                   "Camera: byte order of pixels on the wire. Left out: the profile's byte_order.");
  keys.integer("metadata_rows", o.metadata_rows, 3, {0, 64, "rows"},
               "Camera: metadata rows after the image, dropped. Left out: the profile's metadata_rows.");
  keys.integer("packet_size", c.camera.packet_size, {0, 65536, "bytes"},
               "Camera: network packet size, at least 576; 0: the largest that the link carries.");
  keys.integer("socket_buffer_bytes", c.camera.socket_buffer_bytes, {65536, 1 << 30, "bytes"},
               "Camera: socket receive buffer; the system's limit is net.core.rmem_max.");
  keys.boolean("resend", c.camera.resend, "Camera: request lost packets again; only for cameras that answer.");
  keys.boolean(
      "ptp", c.camera.ptp,
      "Camera: enable PTP (IEEE 1588) if it has it; false: the camera's own setting. A clock synchronised by PTP "
      "is never reset.");
  keys.integer("packet_timeout_us", c.camera.packet_timeout_us, {100, 1000000, "us"},
               "Camera: time without a packet before it is requested again.");
  keys.integer("frame_retention_us", c.camera.frame_retention_us, {1000, 10000000, "us"},
               "Camera: how long an incomplete frame may delay later ones.");
  keys.integer("buffers", c.camera.buffers, {4, 1024, "frames"}, "Camera: receive buffers.");
  keys.integer("realtime_priority", c.camera.realtime_priority, {0, 99, ""},
               "Camera: SCHED_FIFO priority of the receiving thread; 0: the default scheduler.");
  keys.integer("stall_ms", c.camera.stall_ms, {10, 60000, "ms"},
               "Camera: time without a frame after which the stream counts as stalled.");
  keys.integer("reconnect_after_ms", c.camera.reconnect_after_ms, {0, 600000, "ms"},
               "Camera: it is opened again after a stall of this long; 0: never.");
  keys.text("device", c.video.device,
            "Video device: /dev/videoN, or the USB camera's serial number, by which a lost camera is searched for. "
            "Set its size with v4l2-ctl --set-fmt-video.");
  keys.choice<std::uint32_t>(
      "format", c.video.format, kContainers,
      "Video device: its driver's name for the format. yuyv: 16-bit values declared as a colour format, as by cores "
      "that send stacked images. Values are used unchanged.");
  keys.integers("rows", o.rows, {0, 16384, ""},
                "Video device: [first, count], the image's rows; the others are metadata or another image. []: all.");
  keys.number("scale_k", o.scale_k, {0.0, 100.0, "K"},
              "Video device: kelvin per count of a radiometric camera; 0: values are counts.");
  keys.number("offset_k", c.video.scale.offset, {-1000.0, 1000.0, "K"}, "Video device: kelvin at count 0.");
  keys.file("file", c.replay.file, "capture.h5", "Replay: capture file.");
  keys.choice<replay::Pace>(
      "pace", c.replay.pace, kPaces,
      "Replay: realtime keeps the capture's timing and may lose frames; fast loses none and runs as fast as it can.");
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
      "camera: the camera decides, unknown to bolod. manual: only by `bolo nuc`. timed: every interval. still: "
      "when the scene is still, at least an interval apart.");
  keys.number("interval_s", nuc.interval_s, {1.0, 86400.0, "s"}, "Interval between corrections.");
  keys.number("still_s", nuc.still_s, {0.2, 3600.0, "s"}, "How long the scene must have been still.");
  keys.number("still_k", nuc.still_k, {0.001, 1000.0, "K (counts when the source has no kelvin)"},
              "The scene is still while pixels change by less than this, on average, from one tenth of a second to the "
              "next; noise with standard deviation s changes them by 1.13 s.");
  keys.integer("hold_ms", nuc.hold_ms, {0, 60000, "ms"},
               "Frames within this time after the command are flagged as the shutter's. Unproven: whether the camera "
               "repeats frames meanwhile or sends none, and for how long.");
}

void object_keys(KeyTable& keys, genicam::ObjectParameters& object) {
  constexpr double kRoomK = 293.15;
  keys.section("object",
               "object parameters in the camera; 1 gives black-body temperatures. Left out: the camera's own");
  keys.number("emissivity", object.emissivity, {0.01, 1.0, ""}, "Emissivity of the object.");
  keys.number("transmission", object.transmission, {0.01, 1.0, ""}, "Transmission of the air (EstimatedTransmission).");
  keys.number("optics_transmission", object.optics_transmission, {0.01, 1.0, ""},
              "Transmission of a window in front of the lens.");
  keys.number("reflected_k", object.reflected_k, kRoomK, {1.0, kHottestK, "K"},
              "Temperature of the surroundings that it reflects.");
  keys.number("atmosphere_k", object.atmosphere_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature of the air.");
  keys.number("optics_k", object.optics_k, kRoomK, {1.0, kHottestK, "K"}, "Temperature of that window.");
  keys.number("distance_m", object.distance_m, 1.0, {0.0, 1e5, "m"}, "Distance to the object.");
  keys.number("humidity", object.humidity, 0.5, {0.0, 1.0, ""}, "Relative humidity of the air.");
}

void camera_keys(KeyTable& keys, genicam::CameraOptions& camera) {
  keys.section("camera", "measuring range");
  keys.number("range_low_k", camera.range_low_k, {0.0, kHottestK, "K"},
              "Chooses the narrowest of the camera's ranges that contains range_low_k and range_high_k.");
  keys.number("range_high_k", camera.range_high_k, {0.0, kHottestK, "K"},
              "Upper end of the range; 0: the camera's own setting.");
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
  keys.section("deblur", "deblurring");
  keys.choice<deblur::Method>(
      "solver", s.method, deblur::kMethodNames,
      "admm, dual: fixed iterations, for live work. exact: to convergence, slow. inverse: no prior, for little noise. "
      "mmae: multiple-model estimation per pixel. motion: along the scene's own motion, the sharpest; publishes the "
      "motion with each frame.");
  keys.number_or_word(
      "lambda", s.lambda, s.auto_lambda, "auto", {0.0, 1e6, "K (counts when the source has no kelvin)"},
      "Weight of the prior in kappa |V H^T D - Y|^2 + lambda |D|_1. Larger: smoother; auto follows noise and motion.");
  keys.number("noise_k", s.noise_k, {0.0, 1000.0, "K (counts when the source has no kelvin)"},
              "Temporal noise, for mmae, motion and lambda = \"auto\"; 0: measured.");
  keys.number("kappa", s.kappa, {1e-9, 1e9, ""}, "Weight of the data in the same sum.");
  keys.integer("iterations", s.iterations, {0, 1000, ""},
               "Iterations of admm and dual; 0: as many as accuracy requires at this lambda.");
  keys.integer("window", s.window, {3, 65, "frames"}, "Frames per window: a power of two, plus one.");
  keys.integer("levels", s.levels, {1, 10, ""}, "The window's time is divided into 2^levels bins.");
  keys.integer("lookahead", s.lookahead, {0, 63, "frames"},
               "Frames of the window after the estimated one: each adds a frame of delay and lowers the error.");
  keys.integer("workers", c.pipeline.workers, {1, pipeline::kMaxWorkers, "threads"},
               "Threads that share each frame's rows.");
  keys.text("isa", c.isa, "Instruction set of the kernels: AVX3, AVX2, SSE4 ...; auto: the best that runs here.");
  keys.number("tau_s", o.tau_s, c.profile.tau_s, {1e-4, 1.0, "s"},
              "Thermal time constant. Left out: the profile's tau_s.");
  keys.section("corrections", "corrections before deblurring, beyond the profile's");
  keys.boolean("scene_nuc", o.scene_nuc,
               "Learn and remove the fixed pattern that stays while the scene moves (scene-based NUC).");
}

void motion_keys(KeyTable& keys, DaemonConfig& c) {
  keys.section("motion", "aids of solver = \"motion\"");
  keys.text("gyro", c.gyro,
            "Optional gyro: \"shm:NAME\", angular rates in the shared memory /bolo-gyro.NAME (bolo/gyro_shm.h); "
            "needs [lens] in the profile. Empty: none.");
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
               "Length of the queue between camera and deblurring.");
  keys.boolean(
      "degrade", c.pipeline.degrade,
      "When deblurring cannot keep up, lower quality instead of losing frames: from 1/8 of the queue (or 40 ms of "
      "frames) a cheaper solver, from 1/4 (80 ms) the inverse filter, from 1/2 (160 ms) the raw frame. Such frames "
      "are flagged.");
  keys.integer("realtime_priority", c.pipeline.thread.realtime_priority, {0, 99, ""},
               "SCHED_FIFO priority of the deblurring threads; 0: the default scheduler.");
  keys.integers("cpus", c.pipeline.thread.cpus, {0, 4095, ""}, "CPUs of the deblurring threads; []: any.");
  keys.boolean("lock_memory", c.lock_memory, "Lock all memory against swapping (mlockall), if allowed.");
}

void output_keys(KeyTable& keys, DaemonConfig& c, Overrides& o) {
  keys.section("watch", "whether the camera still fits its profile");
  keys.boolean("gap", o.watch_gap,
               "Once a minute, compare 32 frames with their prediction from the profile; `bolo stat`, the metrics and "
               "the log (gap_grew) report a changed time constant or noise.");
  for (const auto& sink : c.sinks) sink->declare(keys);
  c.ros2.declare(keys);
  keys.section("control", "commands to the running daemon: `bolo nuc NAME`");
  keys.boolean("enable", c.control.enabled, "Listen on a Unix socket.");
  keys.text(
      "socket", c.control.socket,
      "Socket path; empty: NAME.sock in the runtime directory (RUNTIME_DIRECTORY, /run/bolo, XDG_RUNTIME_DIR/bolo).");
  keys.octal("mode", c.control.mode, {0600, 0777, ""},
             "Permission bits; users with write permission may send commands.");
  keys.section("metrics", "numbers for Prometheus, at http://LISTEN/metrics");
  keys.boolean("enable", c.metrics.enabled, "Serve metrics.");
  keys.text("listen", c.metrics.listen, "Address and port.");
  keys.boolean("allow_remote", c.metrics.allow_remote,
               "Allow a `listen` address that other computers can reach. Readers are not authenticated.");
  keys.section("log", "messages");
  keys.choice<spdlog::level::level_enum>("level", c.log.level, kLevels, "Least severe messages that are written.");
  keys.choice<LogFormat>(
      "format", c.log.format, kFormats,
      "text: time, level, message on standard error. journal: systemd's journal, with fields (BOLO_EVENT ...). "
      "auto: journal if standard error is the journal.");
}

KeyTable config_keys(DaemonConfig& config, Overrides& overrides) {
  KeyTable keys;
  keys.text("name", config.name, "Name of this daemon's shared memory, /bolo.NAME: letters, digits, '-', '_', '.'.");
  keys.file("profile", config.profile_file, "a655sc.toml",
            "Camera profile. Left out: the built-in one of an A655sc at 200 Hz.");
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
