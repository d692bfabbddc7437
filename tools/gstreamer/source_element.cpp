// libgstbolo.so and its element "bolosrc": the frames that a bolod publishes in shared memory, as a live source.
#include <gst/base/gstpushsrc.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "bolo/client.h"
#include "drivers/v4l2/image.hpp"
#include "src/core/clock.hpp"
#include "tools/gstreamer/elements.hpp"

namespace bolo::tools {
namespace {

constexpr int kOpenMs = 2000;
constexpr int kWaitMs = 50;  // longest delay until a waiting source notices that it should stop
constexpr int kStandardRestartMs = 10'000;
constexpr double kLongestStep_s = 1.0;  // a sink waits this long for a frame, and after the last one

enum Plane { kDeblurred, kRaw };

struct ClientDeleter {
  void operator()(bolo_client* client) const { bolo_client_close(client); }
};
using Client = std::unique_ptr<bolo_client, ClientDeleter>;

// Read under the object's lock when the source starts.
struct Options {
  std::string camera;
  int plane = kDeblurred;
  int restart_ms = kStandardRestartMs;
};

struct State {
  Options options;
  Client client;
  Options used;
  GstVideoInfo info{};
  std::optional<v4l2::Agc> agc;
  std::vector<std::uint16_t> plane;
  std::uint64_t last_id = 0;
  std::int64_t before_ns = 0;
  bool any = false;
  std::atomic<bool> flushing{false};  // only a flag: relaxed
  // For properties and queries from any thread; under the object's lock.
  std::uint32_t width = 0;  // 0: no camera open
  std::uint32_t height = 0;
  double scale = 0.0;
  double offset = 0.0;
  double period_s = 0.0;
  std::uint32_t lookahead = 0;
  std::uint32_t slots = 0;
};

struct BoloSrc {
  GstPushSrc parent;
  State* state;
};
struct BoloSrcClass {
  GstPushSrcClass parent;
};

enum Property { kCamera = 1, kPlane, kRestartTimeout, kScale, kOffset };

GstStaticPadTemplate src_template = GST_STATIC_PAD_TEMPLATE(
    "src", GST_PAD_SRC, GST_PAD_ALWAYS, GST_STATIC_CAPS(GST_VIDEO_CAPS_MAKE("{ GRAY16_LE, GRAY8 }")));

G_DEFINE_TYPE(BoloSrc, bolo_src, GST_TYPE_PUSH_SRC)

BoloSrc* self_of(gpointer object) { return static_cast<BoloSrc*>(object); }

GType plane_type() {
  static const GEnumValue values[] = {{kDeblurred, "With the pixels' inertia undone", "deblurred"},
                                      {kRaw, "As the camera gave it", "raw"},
                                      {0, nullptr, nullptr}};
  static const GType type = g_enum_register_static("BoloPlane", values);
  return type;
}

void set_property(GObject* object, guint id, const GValue* value, GParamSpec* /*spec*/) {
  GST_OBJECT_LOCK(object);
  Options& options = self_of(object)->state->options;
  if (id == kCamera) options.camera = g_value_get_string(value) != nullptr ? g_value_get_string(value) : "";
  if (id == kPlane) options.plane = g_value_get_enum(value);
  if (id == kRestartTimeout) options.restart_ms = g_value_get_int(value);
  GST_OBJECT_UNLOCK(object);
}

void get_property(GObject* object, guint id, GValue* value, GParamSpec* /*spec*/) {
  GST_OBJECT_LOCK(object);
  const State& state = *self_of(object)->state;
  if (id == kCamera) g_value_set_string(value, state.options.camera.c_str());
  if (id == kPlane) g_value_set_enum(value, state.options.plane);
  if (id == kRestartTimeout) g_value_set_int(value, state.options.restart_ms);
  if (id == kScale) g_value_set_double(value, state.scale);
  if (id == kOffset) g_value_set_double(value, state.offset);
  GST_OBJECT_UNLOCK(object);
}

void finalize(GObject* object) {
  delete self_of(object)->state;
  G_OBJECT_CLASS(bolo_src_parent_class)->finalize(object);
}

// True for names like "bolosrc0", which GStreamer assigns to unnamed elements.
bool is_given_name(std::string_view name) {
  constexpr std::string_view kBegin = "bolosrc";
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  return name.starts_with(kBegin) && std::all_of(name.begin() + kBegin.size(), name.end(), digit);
}

std::vector<std::string> running_cameras() {
  const int bytes = bolo_client_streams(nullptr, 0);
  std::string text(static_cast<std::size_t>(std::max(bytes, 1)), '\0');
  bolo_client_streams(text.data(), text.size());
  std::istringstream names(text.c_str());
  std::vector<std::string> running;
  for (std::string name; std::getline(names, name);) {
    bolo_client* opened = nullptr;
    if (bolo_client_open(name.c_str(), 0, &opened) != BOLO_CLIENT_OK) continue;
    const Client client(opened);
    if (bolo_client_get_state(opened)->alive != 0) running.push_back(name);
  }
  return running;
}

// The camera: by the property, by the element's own name, or the only one running. Empty: none.
std::string chosen_camera(BoloSrc* self, const Options& options) {
  if (!options.camera.empty()) return options.camera;
  const std::unique_ptr<char, decltype(&g_free)> own(gst_object_get_name(GST_OBJECT(self)), g_free);
  if (!is_given_name(own.get())) return own.get();
  const std::vector<std::string> running = running_cameras();
  if (running.size() == 1) return running.front();
  std::string names;
  for (const std::string& name : running) names += " " + name;
  GST_ELEMENT_ERROR(
      self, RESOURCE, NOT_FOUND,
      ("%s%s", running.empty() ? "no camera runs: start bolod" : "choose one by camera=NAME, of", names.c_str()),
      (nullptr));
  return {};
}

// Reads the stream's geometry and scale, at the start and when another daemon has taken the name.
void read_info(BoloSrc* self) {
  State& state = *self->state;
  const bolo_client_info& info = *bolo_client_get_info(state.client.get());
  const bool kelvin = info.unit == BOLO_UNIT_KELVIN;
  GST_OBJECT_LOCK(self);
  state.width = info.width;
  state.height = info.height;
  state.scale = kelvin ? info.scale : 0.0;
  state.offset = kelvin ? info.offset : 0.0;
  state.period_s = info.frame_period_s;
  state.lookahead = info.lookahead;
  state.slots = info.slot_count;
  GST_OBJECT_UNLOCK(self);
  state.plane.resize(std::size_t{info.width} * info.height);
  state.agc.emplace(LinearScale{kelvin ? Unit::kKelvin : Unit::kCount, info.scale, info.offset}, v4l2::AgcOptions{});
  state.any = false;
}

gboolean start(GstBaseSrc* source) {
  BoloSrc* self = self_of(source);
  State& state = *self->state;
  GST_OBJECT_LOCK(source);
  state.used = state.options;
  GST_OBJECT_UNLOCK(source);
  state.used.camera = chosen_camera(self, state.used);
  if (state.used.camera.empty()) return FALSE;
  bolo_client* client = nullptr;
  if (bolo_client_open(state.used.camera.c_str(), kOpenMs, &client) != BOLO_CLIENT_OK) {
    GST_ELEMENT_ERROR(self, RESOURCE, NOT_FOUND, ("%s", bolo_client_error(nullptr)), (nullptr));
    return FALSE;
  }
  state.client.reset(client);
  read_info(self);
  return TRUE;
}

gboolean stop(GstBaseSrc* source) {
  State& state = *self_of(source)->state;
  GST_OBJECT_LOCK(source);
  state.width = 0;
  GST_OBJECT_UNLOCK(source);
  state.client.reset();
  return TRUE;
}

// The camera's caps in both formats; any caps before it is open.
GstCaps* get_caps(GstBaseSrc* source, GstCaps* filter) {
  GST_OBJECT_LOCK(source);
  const State& state = *self_of(source)->state;
  const auto width = static_cast<gint>(state.width);
  const auto height = static_cast<gint>(state.height);
  const double period_s = state.period_s;
  GST_OBJECT_UNLOCK(source);
  GstCaps* caps = gst_pad_get_pad_template_caps(GST_BASE_SRC_PAD(source));
  if (width > 0) {
    gint rate = 0;
    gint per = 1;
    gst_util_double_to_fraction(1.0 / period_s, &rate, &per);
    caps = gst_caps_make_writable(caps);
    gst_caps_set_simple(caps, "width", G_TYPE_INT, width, "height", G_TYPE_INT, height, "framerate", GST_TYPE_FRACTION,
                        rate, per, "pixel-aspect-ratio", GST_TYPE_FRACTION, 1, 1, "interlace-mode", G_TYPE_STRING,
                        "progressive", nullptr);
  }
  if (filter == nullptr) return caps;
  GstCaps* both = gst_caps_intersect_full(filter, caps, GST_CAPS_INTERSECT_FIRST);
  gst_caps_unref(caps);
  return both;
}

gboolean set_caps(GstBaseSrc* source, GstCaps* caps) {
  return gst_video_info_from_caps(&self_of(source)->state->info, caps);
}

// Renegotiates the same format with the daemon's new geometry, and the latency: sinks drop frames that exceed it.
bool take_new_geometry(BoloSrc* self) {
  State& state = *self->state;
  read_info(self);
  gst_element_post_message(GST_ELEMENT(self), gst_message_new_latency(GST_OBJECT(self)));
  const bolo_client_info& info = *bolo_client_get_info(state.client.get());
  const GstVideoFormat format = GST_VIDEO_INFO_FORMAT(&state.info);
  gint rate = 0;
  gint per = 1;
  gst_util_double_to_fraction(1.0 / info.frame_period_s, &rate, &per);
  GstVideoInfo now;
  gst_video_info_set_format(&now, format, info.width, info.height);
  now.fps_n = rate;
  now.fps_d = per;
  if (gst_video_info_is_equal(&now, &state.info) != FALSE) return true;
  GstCaps* caps = gst_video_info_to_caps(&now);
  const bool taken = gst_base_src_set_caps(GST_BASE_SRC(self), caps) != FALSE;
  gst_caps_unref(caps);
  return taken;
}

// Waits for a frame, across restarts of the daemon.
GstFlowReturn wait_for(BoloSrc* self, bolo_client_frame& frame) {
  State& state = *self->state;
  int waited_ms = 0;
  for (;;) {
    if (state.flushing.load(std::memory_order_relaxed)) return GST_FLOW_FLUSHING;
    const int result = bolo_client_next(state.client.get(), kWaitMs, &frame);
    if (result == BOLO_CLIENT_OK) return GST_FLOW_OK;
    if (result == BOLO_CLIENT_RESTARTED && !take_new_geometry(self)) return GST_FLOW_NOT_NEGOTIATED;
    if (result < 0) {
      GST_ELEMENT_ERROR(self, RESOURCE, READ, ("%s", bolo_client_error(state.client.get())), (nullptr));
      return GST_FLOW_ERROR;
    }
    waited_ms = result == BOLO_CLIENT_ENDED ? waited_ms + kWaitMs : 0;
    if (state.used.restart_ms >= 0 && waited_ms > state.used.restart_ms) return GST_FLOW_EOS;
  }
}

// Copies the plane as it is, or converted to grey. False: the ring overwrote the frame meanwhile.
bool copy_plane(State& state, const bolo_client_frame& frame, const MappedFrame& to) {
  const bool raw = state.used.plane == kRaw;
  if (bolo_client_copy(&frame, raw ? state.plane.data() : nullptr, raw ? nullptr : state.plane.data()) !=
      BOLO_CLIENT_OK) {
    return false;
  }
  if (GST_VIDEO_INFO_FORMAT(&state.info) == GST_VIDEO_FORMAT_GRAY16_LE) {
    to.take(state.plane.data());
    return true;
  }
  const double dt_s = static_cast<double>(frame.publish_ns - state.before_ns) / kNsPerSecond;
  state.before_ns = frame.publish_ns;
  const v4l2::CountRange range = state.agc->next(state.plane, dt_s, (frame.flags & BOLO_FLAG_NUC) == 0);
  for (std::size_t y = 0; y < to.height(); ++y) {
    const std::span row(state.plane.data() + y * to.row_bytes(), to.row_bytes());
    std::transform(row.begin(), row.end(), reinterpret_cast<std::uint8_t*>(to.row(y)),
                   [&](std::uint16_t count) { return v4l2::grey(count, range); });
  }
  return true;
}

void add_reference(GstBuffer* buffer, const char* clock, std::int64_t ns) {
  if (ns < 0) return;  // GStreamer times are not negative
  GstCaps* caps = gst_caps_new_empty_simple(clock);
  gst_buffer_add_reference_timestamp_meta(buffer, caps, static_cast<GstClockTime>(ns), GST_CLOCK_TIME_NONE);
  gst_caps_unref(caps);
}

// Time at which the camera took the frame, as the pipeline's running time; nothing if before its start.
std::optional<GstClockTime> running_time(BoloSrc* self, const bolo_client_frame& frame) {
  GstClock* clock = gst_element_get_clock(GST_ELEMENT(self));
  if (clock == nullptr) return GST_CLOCK_TIME_NONE;
  const std::int64_t taken_ns = frame.host_ns != 0 ? frame.host_ns : frame.receive_ns;
  const std::int64_t now_ns = monotonic_ns();
  const std::int64_t age_ns = now_ns - std::clamp(taken_ns, std::int64_t{0}, now_ns);  // else sinks wait for years
  const auto base = static_cast<std::int64_t>(gst_element_get_base_time(GST_ELEMENT(self)));
  const std::int64_t taken = static_cast<std::int64_t>(gst_clock_get_time(clock)) - base - age_ns;
  gst_object_unref(clock);
  if (taken < 0) return std::nullopt;
  return static_cast<GstClockTime>(taken);
}

// Sets times on all clocks, frame numbers and discontinuities.
void stamp(State& state, const bolo_client_frame& frame, GstClockTime running, GstBuffer* buffer) {
  GST_BUFFER_PTS(buffer) = running;
  GST_BUFFER_DURATION(buffer) = static_cast<GstClockTime>(to_ns(std::min(state.period_s, kLongestStep_s)));
  GST_BUFFER_OFFSET(buffer) = frame.frame_id;
  GST_BUFFER_OFFSET_END(buffer) = frame.frame_id + 1;
  if (!state.any || frame.frame_id != state.last_id + 1) GST_BUFFER_FLAG_SET(buffer, GST_BUFFER_FLAG_DISCONT);
  state.last_id = frame.frame_id;
  state.any = true;
  add_reference(buffer, "timestamp/x-bolo-camera", frame.camera_ns);
  if (frame.utc_ns != 0) add_reference(buffer, "timestamp/x-unix", frame.utc_ns);
}

GstFlowReturn create(GstPushSrc* source, GstBuffer** out) {
  BoloSrc* self = self_of(source);
  for (;;) {
    bolo_client_frame frame{};
    if (const GstFlowReturn flow = wait_for(self, frame); flow != GST_FLOW_OK) return flow;
    const auto running = running_time(self, frame);
    if (!running) continue;
    GstBuffer* buffer = gst_buffer_new_allocate(nullptr, self->state->info.size, nullptr);
    const bool copied = [&] {
      const MappedFrame to(self->state->info, buffer, GST_MAP_WRITE);
      return to && copy_plane(*self->state, frame, to);
    }();
    if (copied) {
      stamp(*self->state, frame, *running, buffer);
      *out = buffer;
      return GST_FLOW_OK;
    }
    gst_buffer_unref(buffer);
  }
}

gboolean unlock(GstBaseSrc* source) {
  self_of(source)->state->flushing.store(true, std::memory_order_relaxed);
  return TRUE;
}

gboolean unlock_stop(GstBaseSrc* source) {
  self_of(source)->state->flushing.store(false, std::memory_order_relaxed);
  return TRUE;
}

gboolean query(GstBaseSrc* source, GstQuery* asked) {
  if (GST_QUERY_TYPE(asked) != GST_QUERY_LATENCY) {
    return GST_BASE_SRC_CLASS(bolo_src_parent_class)->query(source, asked);
  }
  GST_OBJECT_LOCK(source);
  const State& state = *self_of(source)->state;
  // A frame comes a look-ahead (at most the ring) after it was taken, plus a period each to read and to solve it.
  const double least_s =
      std::min(state.lookahead, state.slots) * state.period_s + 2.0 * std::min(state.period_s, kLongestStep_s);
  const double most_s = std::max(least_s, state.slots * state.period_s / 2.0);  // older ones are skipped
  GST_OBJECT_UNLOCK(source);
  gst_query_set_latency(asked, TRUE, static_cast<GstClockTime>(to_ns(least_s)),
                        static_cast<GstClockTime>(to_ns(most_s)));
  return TRUE;
}

void bolo_src_init(BoloSrc* self) {
  self->state = new State;
  gst_base_src_set_live(GST_BASE_SRC(self), TRUE);
  gst_base_src_set_format(GST_BASE_SRC(self), GST_FORMAT_TIME);
}

void install_properties(GObjectClass* object) {
  const auto install = [object](Property id, GParamSpec* spec) { g_object_class_install_property(object, id, spec); };
  install(kCamera, g_param_spec_string("camera", nullptr,
                                       "The daemon's [shm] name; empty: the element's own name, or where that was not "
                                       "given the only camera that runs",
                                       "", kProperty));
  install(kPlane, g_param_spec_enum("plane", nullptr, "deblurred or raw", plane_type(), kDeblurred, kProperty));
  install(kRestartTimeout, g_param_spec_int("restart-timeout", nullptr,
                                            "How long a daemon that ended may take to be back, ms, before the stream "
                                            "ends; -1: for ever",
                                            -1, G_MAXINT, kStandardRestartMs, kProperty));
  install(kScale, g_param_spec_double("scale", nullptr, "kelvin = scale * count + offset; 0: counts", -G_MAXDOUBLE,
                                      G_MAXDOUBLE, 0.0, kReadable));
  install(kOffset, g_param_spec_double("offset", nullptr, "Likewise", -G_MAXDOUBLE, G_MAXDOUBLE, 0.0, kReadable));
}

void bolo_src_class_init(BoloSrcClass* type) {
  auto* object = G_OBJECT_CLASS(type);
  object->set_property = set_property;
  object->get_property = get_property;
  object->finalize = finalize;
  install_properties(object);
  auto* element = GST_ELEMENT_CLASS(type);
  gst_element_class_set_static_metadata(element, "Bolo camera", "Source/Video",
                                        "Frames of a thermal camera, raw or deblurred, from bolod's shared memory",
                                        "bolo");
  gst_element_class_add_static_pad_template(element, &src_template);
  auto* source = GST_BASE_SRC_CLASS(type);
  source->start = start;
  source->stop = stop;
  source->get_caps = get_caps;
  source->set_caps = set_caps;
  source->unlock = unlock;
  source->unlock_stop = unlock_stop;
  source->query = query;
  GST_PUSH_SRC_CLASS(type)->create = create;
}

gboolean register_elements(GstPlugin* plugin) {
  return gst_element_register(plugin, "bolosrc", GST_RANK_NONE, bolo_src_get_type()) && register_deblur(plugin) ? TRUE
                                                                                                                : FALSE;
}

}  // namespace
}  // namespace bolo::tools

#define PACKAGE "bolo"  // required by GST_PLUGIN_DEFINE
GST_PLUGIN_DEFINE(GST_VERSION_MAJOR, GST_VERSION_MINOR, bolo, "Sharp frames of moving thermal cameras",
                  bolo::tools::register_elements, BOLO_VERSION, GST_LICENSE_UNKNOWN, "bolo", "https://bolo.invalid")
