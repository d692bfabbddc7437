// "bolodeblur": removes the thermal inertia of a camera's pixels from any 16-bit grey stream.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <exception>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gst/base/gstbasetransform.h>

#include "src/core/clock.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/core/threads.hpp"
#include "src/deblur/solver.hpp"
#include "src/deblur/window.hpp"
#include "src/rt/thread.hpp"
#include "tools/gstreamer/elements.hpp"

namespace bolo::tools {
namespace {

// Usage: fill(borrow()); push(time); while (next(ready)), `ready` is solved. Thread: any one at a time.
class StreamDeblur {
 public:
  // `format`: uint16. Errors: invalid settings (kBadInput).
  static Result<std::unique_ptr<StreamDeblur>> create(const deblur::Settings& settings, const StreamFormat& format,
                                                      int workers) {
    RETURN_IF_ERROR(deblur::validate(settings));
    try {
      ASSIGN_OR_RETURN(auto solver, deblur::Solver::create(settings, format, PixelType::kUint16));
      return std::unique_ptr<StreamDeblur>(new StreamDeblur(settings, format, workers, std::move(solver)));
    } catch (const std::exception& e) {  // out of memory or threads
      return failed("frames of " + std::to_string(format.geometry.width) + "x" +
                    std::to_string(format.geometry.height) + " cannot be deblurred: " + describe_exception(e));
    }
  }

  // Plane to fill with the next frame, row-major without padding.
  std::uint16_t* borrow() noexcept { return plane_of(free_.back()); }
  // Pushes the borrowed frame, taken at `time_ns`; a jump in time means lost frames. `restart`: starts a new window.
  void push(std::int64_t time_ns, bool restart) noexcept {
    FrameMeta meta{.camera_ns = time_ns, .receive_ns = time_ns};
    // These frames have no counter: numbers follow from their times.
    const double periods = static_cast<double>(time_ns - last_.camera_ns) / (period_s_ * kNsPerSecond);
    const double most = 2.0 * static_cast<double>(window_.slots());  // a longer jump empties the window anyway
    const double step = std::clamp(std::round(periods), 1.0, most);
    if (any_) meta.frame_id = last_.frame_id + static_cast<std::uint64_t>(step);
    const std::uint32_t slot = free_.back();
    free_.pop_back();
    window_.push({meta, plane_of(slot), slot}, restart || !any_);
    collected_ = false;
    last_ = meta;
    any_ = true;
  }

  // Ends the stream: frames that wait for their look-ahead become ready without it.
  void finish() noexcept {
    window_.finish();
    collected_ = any_ = false;
  }

  struct Ready {
    std::int64_t time_ns = 0;  // as pushed
    bool full = false;         // the window was full, so the frame is sharp; otherwise it is unchanged
  };
  // Writes the next ready frame, oldest first, to `out` (format.geometry.pixels() values). False if there is none.
  bool next(Ready& ready, std::uint16_t* out) noexcept {
    deblur::Window::Ready frame;
    if (!window_.next(frame)) {
      if (!std::exchange(collected_, true)) {
        free_.insert(free_.end(), window_.released().begin(), window_.released().end());
      }
      return false;
    }
    ready = {frame.frame.meta.camera_ns, frame.full};
    if (frame.full) {
      solve(frame.view, out);
    } else {
      std::memcpy(out, frame.frame.plane, plane_bytes(format_.geometry, PixelType::kUint16));
    }
    return true;
  }

 private:
  StreamDeblur(const deblur::Settings& settings, const StreamFormat& format, int workers,
               std::unique_ptr<deblur::Solver> solver)
      : format_(format),
        period_s_(settings.period_s),
        window_(settings),
        solver_(std::move(solver)),
        team_(workers, {.name = "bolo-deblur"}),
        planes_(static_cast<std::size_t>(window_.slots()) * format.geometry.pixels()) {
    for (int slot = 0; slot < window_.slots(); ++slot) free_.push_back(static_cast<std::uint32_t>(slot));
  }

  std::uint16_t* plane_of(std::uint32_t slot) noexcept { return planes_.data() + slot * format_.geometry.pixels(); }

  void solve(const deblur::WindowView& view, std::uint16_t* out) noexcept {
    solver_->prepare(view, team_);
    for_parts(team_, format_.geometry.height, [&](int begin, int end) {
      solver_->solve(view, {0, begin, format_.geometry.width, end - begin}, out);
    });
  }

  StreamFormat format_;
  double period_s_;
  deblur::Window window_;
  std::unique_ptr<deblur::Solver> solver_;
  rt::WorkerTeam team_;
  std::vector<std::uint16_t> planes_;
  std::vector<std::uint32_t> free_;
  FrameMeta last_;
  bool any_ = false;
  bool collected_ = true;  // planes that left the window are free again
};

constexpr int kMostWorkers = 64;

struct BufferDeleter {
  void operator()(GstBuffer* buffer) const { gst_buffer_unref(buffer); }
};
using Buffer = std::unique_ptr<GstBuffer, BufferDeleter>;

// Read under the object's lock, applied with the next caps.
struct Options {
  std::string solver = "admm";
  deblur::Settings settings;
  double scale = 0.0;  // K per count; 0: counts
  double period_s = 0.0;
  int workers = 2;
};

struct State {
  Options options;
  GstVideoInfo info{};
  std::unique_ptr<StreamDeblur> stream;  // null before caps
  double period_s = 0.0;
  std::deque<Buffer> waiting;  // pushed but not yet delivered: source of times and metadata
  std::vector<std::uint16_t> plane;
  std::int64_t last_ns = 0;
  bool restart = true;
};

struct BoloDeblur {
  GstBaseTransform parent;
  State* state;
};
struct BoloDeblurClass {
  GstBaseTransformClass parent;
};

enum Property { kSolver = 1, kTau, kLambda, kKappa, kScale, kPeriod, kWindow, kLookahead, kWorkers };

GstStaticPadTemplate sink_template =
    GST_STATIC_PAD_TEMPLATE("sink", GST_PAD_SINK, GST_PAD_ALWAYS, GST_STATIC_CAPS(GST_VIDEO_CAPS_MAKE("GRAY16_LE")));
GstStaticPadTemplate src_template =
    GST_STATIC_PAD_TEMPLATE("src", GST_PAD_SRC, GST_PAD_ALWAYS, GST_STATIC_CAPS(GST_VIDEO_CAPS_MAKE("GRAY16_LE")));

G_DEFINE_TYPE(BoloDeblur, bolo_deblur, GST_TYPE_BASE_TRANSFORM)

BoloDeblur* self_of(gpointer object) { return static_cast<BoloDeblur*>(object); }

void set_property(GObject* object, guint id, const GValue* value, GParamSpec* /*spec*/) {
  GST_OBJECT_LOCK(object);
  Options& options = self_of(object)->state->options;
  if (id == kSolver) options.solver = g_value_get_string(value) != nullptr ? g_value_get_string(value) : "";
  if (id == kTau) options.settings.tau_s = g_value_get_double(value);
  if (id == kLambda) options.settings.lambda = g_value_get_double(value);
  if (id == kKappa) options.settings.kappa = g_value_get_double(value);
  if (id == kScale) options.scale = g_value_get_double(value);
  if (id == kPeriod) options.period_s = g_value_get_double(value);
  if (id == kWindow) options.settings.window = g_value_get_int(value);
  if (id == kLookahead) options.settings.lookahead = g_value_get_int(value);
  if (id == kWorkers) options.workers = g_value_get_int(value);
  GST_OBJECT_UNLOCK(object);
}

void get_property(GObject* object, guint id, GValue* value, GParamSpec* /*spec*/) {
  GST_OBJECT_LOCK(object);
  const Options& options = self_of(object)->state->options;
  if (id == kSolver) g_value_set_string(value, options.solver.c_str());
  if (id == kTau) g_value_set_double(value, options.settings.tau_s);
  if (id == kLambda) g_value_set_double(value, options.settings.lambda);
  if (id == kKappa) g_value_set_double(value, options.settings.kappa);
  if (id == kScale) g_value_set_double(value, options.scale);
  if (id == kPeriod) g_value_set_double(value, options.period_s);
  if (id == kWindow) g_value_set_int(value, options.settings.window);
  if (id == kLookahead) g_value_set_int(value, options.settings.lookahead);
  if (id == kWorkers) g_value_set_int(value, options.workers);
  GST_OBJECT_UNLOCK(object);
}

void finalize(GObject* object) {
  delete self_of(object)->state;
  G_OBJECT_CLASS(bolo_deblur_parent_class)->finalize(object);
}

Result<std::unique_ptr<StreamDeblur>> make_stream(const Options& options, const GstVideoInfo& info, double period_s) {
  ASSIGN_OR_RETURN(const auto method, deblur::method_from_name(options.solver));
  if (!(period_s > 0.0)) {
    return bad_input("the stream has no frame rate: set one by a capsfilter, or the property period");
  }
  deblur::Settings settings = options.settings;
  settings.method = method;
  settings.period_s = period_s;
  settings.auto_lambda = settings.lambda == 0.0;
  StreamFormat format;
  format.geometry = {info.width, info.height};
  format.frame_period_s = period_s;
  format.scale =
      options.scale > 0.0 ? LinearScale{Unit::kKelvin, options.scale, 0.0} : LinearScale{Unit::kCount, 1.0, 0.0};
  return StreamDeblur::create(settings, format, options.workers);
}

// Drops ready frames that downstream did not take because it flushes or has no sink.
void drop_ready(State& state) {
  StreamDeblur::Ready ready;
  while (state.stream && state.stream->next(ready, state.plane.data())) {
    if (!state.waiting.empty()) state.waiting.pop_front();
  }
}

// Drops frames that a finished stream still holds; the next frame starts anew.
void forget_frames(State& state) {
  drop_ready(state);
  state.waiting.clear();
  state.restart = true;
}

gboolean set_caps(GstBaseTransform* transform, GstCaps* in, GstCaps* /*out*/) {
  State& state = *self_of(transform)->state;
  GstVideoInfo info;
  if (gst_video_info_from_caps(&info, in) == FALSE) return FALSE;
  GST_OBJECT_LOCK(transform);
  const Options options = state.options;
  GST_OBJECT_UNLOCK(transform);
  const double rate = info.fps_n > 0 ? static_cast<double>(info.fps_n) / info.fps_d : 0.0;
  const double period_s = options.period_s > 0.0 ? options.period_s : (rate > 0.0 ? 1.0 / rate : 0.0);
  auto stream = make_stream(options, info, period_s);
  if (!stream) {
    GST_ELEMENT_ERROR(transform, LIBRARY, SETTINGS, ("%s", stream.error().message.c_str()), (nullptr));
    return FALSE;
  }
  deblur::Settings settings = options.settings;
  settings.period_s = period_s;
  if (const std::string little = deblur::weak_inertia_warning(settings); !little.empty()) {
    GST_ELEMENT_WARNING(transform, STREAM, FORMAT, ("%s", little.c_str()), (nullptr));
  }
  state.stream = std::move(*stream);
  state.info = info;
  GST_OBJECT_LOCK(transform);
  state.period_s = period_s;
  GST_OBJECT_UNLOCK(transform);
  state.plane.resize(static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height));
  forget_frames(state);
  return TRUE;
}

// Time of a frame: its stamp, or one period after the frame before.
std::int64_t time_of(State& state, GstBuffer* buffer) {
  if (GST_BUFFER_PTS_IS_VALID(buffer)) {
    constexpr GstClockTime kMost = GstClockTime{1} << 62U;  // keeps differences representable
    state.last_ns = static_cast<std::int64_t>(std::min(GST_BUFFER_PTS(buffer), kMost));
  } else {
    state.last_ns += to_ns(state.period_s);
  }
  return state.last_ns;
}

GstFlowReturn take_in(BoloDeblur* self, Buffer buffer) {
  State& state = *self->state;
  if (GST_BUFFER_FLAG_IS_SET(buffer.get(), GST_BUFFER_FLAG_GAP)) return GST_FLOW_OK;  // a lost frame: no data
  drop_ready(state);
  {
    const MappedFrame frame(state.info, buffer.get(), GST_MAP_READ);
    if (!frame) {
      GST_ELEMENT_ERROR(self, STREAM, FORMAT, ("a buffer holds no frame of its caps"), (nullptr));
      return GST_FLOW_ERROR;
    }
    frame.give(state.stream->borrow());
  }
  // Lost frames show as a jump in time. A discontinuity without times has no known length: restart.
  const bool breaks = GST_BUFFER_FLAG_IS_SET(buffer.get(), GST_BUFFER_FLAG_DISCONT) != FALSE &&
                      GST_BUFFER_PTS_IS_VALID(buffer.get()) == FALSE;
  const std::int64_t time_ns = time_of(state, buffer.get());
  state.stream->push(time_ns, state.restart || breaks);
  state.restart = false;
  state.waiting.push_back(std::move(buffer));
  return GST_FLOW_OK;
}

// The next ready frame; null: none.
Buffer give_out(BoloDeblur* self) {
  State& state = *self->state;
  StreamDeblur::Ready ready;
  if (!state.stream->next(ready, state.plane.data()) || state.waiting.empty()) return nullptr;
  Buffer in = std::move(state.waiting.front());
  state.waiting.pop_front();
  Buffer out(gst_buffer_new_allocate(nullptr, state.info.size, nullptr));
  constexpr auto kAll =
      static_cast<GstBufferCopyFlags>(GST_BUFFER_COPY_FLAGS | GST_BUFFER_COPY_TIMESTAMPS | GST_BUFFER_COPY_META);
  gst_buffer_copy_into(out.get(), in.get(), kAll, 0, static_cast<gsize>(-1));
  // The layout describes the input buffer, not this one.
  if (GstVideoMeta* layout = gst_buffer_get_video_meta(out.get()); layout != nullptr) {
    gst_buffer_remove_meta(out.get(), &layout->meta);
  }
  const MappedFrame frame(state.info, out.get(), GST_MAP_WRITE);
  if (!frame) return nullptr;
  frame.take(state.plane.data());
  return out;
}

GstFlowReturn generate_output(GstBaseTransform* transform, GstBuffer** out) {
  BoloDeblur* self = self_of(transform);
  Buffer in(transform->queued_buf);
  transform->queued_buf = nullptr;
  *out = nullptr;
  if (!self->state->stream) return GST_FLOW_NOT_NEGOTIATED;
  if (in) {
    if (const GstFlowReturn flow = take_in(self, std::move(in)); flow != GST_FLOW_OK) return flow;
  }
  *out = give_out(self).release();
  return GST_FLOW_OK;
}

// Delivers frames that wait for their look-ahead, before an event that ends or changes the stream.
void drain(BoloDeblur* self) {
  State& state = *self->state;
  if (!state.stream) return;
  drop_ready(state);
  state.stream->finish();
  while (Buffer out = give_out(self)) {
    if (gst_pad_push(GST_BASE_TRANSFORM_SRC_PAD(self), out.release()) != GST_FLOW_OK) break;
  }
  forget_frames(state);
}

gboolean sink_event(GstBaseTransform* transform, GstEvent* event) {
  BoloDeblur* self = self_of(transform);
  const GstEventType type = GST_EVENT_TYPE(event);
  if (type == GST_EVENT_EOS || type == GST_EVENT_SEGMENT || type == GST_EVENT_CAPS) drain(self);
  if (type == GST_EVENT_FLUSH_STOP && self->state->stream) {
    drop_ready(*self->state);
    self->state->stream->finish();
    forget_frames(*self->state);
  }
  return GST_BASE_TRANSFORM_CLASS(bolo_deblur_parent_class)->sink_event(transform, event);
}

gboolean query(GstBaseTransform* transform, GstPadDirection direction, GstQuery* asked) {
  const gboolean known = GST_BASE_TRANSFORM_CLASS(bolo_deblur_parent_class)->query(transform, direction, asked);
  if (direction != GST_PAD_SRC || GST_QUERY_TYPE(asked) != GST_QUERY_LATENCY || known == FALSE) return known;
  gboolean live = FALSE;
  GstClockTime least = 0;
  GstClockTime most = 0;
  gst_query_parse_latency(asked, &live, &least, &most);
  GST_OBJECT_LOCK(transform);
  const State& state = *self_of(transform)->state;
  // The look-ahead, plus a period in which the solver must keep up.
  const double added_s = (state.options.settings.lookahead + 1) * state.period_s;
  GST_OBJECT_UNLOCK(transform);
  const auto added = static_cast<GstClockTime>(to_ns(added_s));
  if (most != GST_CLOCK_TIME_NONE) most += added;
  gst_query_set_latency(asked, live, least + added, most);
  return TRUE;
}

gboolean stop(GstBaseTransform* transform) {
  State& state = *self_of(transform)->state;
  state.stream.reset();
  forget_frames(state);
  return TRUE;
}

void bolo_deblur_init(BoloDeblur* self) {
  self->state = new State;
  self->state->options.settings.lambda = 0.0;
  gst_base_transform_set_qos_enabled(GST_BASE_TRANSFORM(self), FALSE);  // a frame dropped by QoS would be a gap
}

void install_properties(GObjectClass* object) {
  const deblur::Settings defaults;
  const auto number = [&](Property id, const char* name, const char* about, double least, double most, double value) {
    g_object_class_install_property(object, id,
                                    g_param_spec_double(name, nullptr, about, least, most, value, kProperty));
  };
  const auto count = [&](Property id, const char* name, const char* about, int least, int most, int value) {
    g_object_class_install_property(object, id, g_param_spec_int(name, nullptr, about, least, most, value, kProperty));
  };
  g_object_class_install_property(
      object, kSolver,
      g_param_spec_string("solver", nullptr, "admm, dual, exact, inverse, mmae or motion", "admm", kProperty));
  number(kTau, "tau", "Thermal time constant of the camera's pixels, s", 1e-5, 1.0, defaults.tau_s);
  number(kLambda, "lambda", "Weight of the prior, in kelvin (counts where scale is 0); 0: follows noise and motion",
         0.0, 1e6, 0.0);
  number(kKappa, "kappa", "Weight of the data", 1e-6, 1e6, defaults.kappa);
  number(kScale, "scale", "Kelvin a count; 0: counts", 0.0, 1e3, 0.0);
  number(kPeriod, "period", "Time from frame to frame, s; 0: of the caps' frame rate", 0.0, 60.0, 0.0);
  count(kWindow, "window", "Frames that one is estimated from: 2^k + 1", 3, 1025, defaults.window);
  count(kLookahead, "lookahead", "Frames of the window that come after the one estimated: so much later it is out", 0,
        1024, defaults.lookahead);
  count(kWorkers, "workers", "Threads that solve a frame", 1, kMostWorkers, 2);
}

void bolo_deblur_class_init(BoloDeblurClass* type) {
  auto* object = G_OBJECT_CLASS(type);
  object->set_property = set_property;
  object->get_property = get_property;
  object->finalize = finalize;
  install_properties(object);
  auto* element = GST_ELEMENT_CLASS(type);
  gst_element_class_set_static_metadata(element, "Thermal deblurring", "Filter/Effect/Video",
                                        "Undoes the thermal inertia of a microbolometer's pixels", "bolo");
  gst_element_class_add_static_pad_template(element, &sink_template);
  gst_element_class_add_static_pad_template(element, &src_template);
  auto* transform = GST_BASE_TRANSFORM_CLASS(type);
  transform->set_caps = set_caps;
  transform->generate_output = generate_output;
  transform->sink_event = sink_event;
  transform->query = query;
  transform->stop = stop;
}

}  // namespace

gboolean register_deblur(GstPlugin* plugin) {
  return gst_element_register(plugin, "bolodeblur", GST_RANK_NONE, bolo_deblur_get_type());
}

}  // namespace bolo::tools
