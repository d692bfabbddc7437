// Writes "bolo-capture" version 1.
//
// To survive a kill or a power cut, all datasets are brought to the same length and committed every half second of
// frames; CrashSafeFile keeps the file at the last commit in spite of HDF5's writes in between and of a cut within a
// commit. SWMR mode guarantees its order only to readers on the same machine, not on disk, and forbids new attributes
// and events. The oldest file format is used: newer ones mark a file as "open for writing", and refuse it afterwards.
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <system_error>

#include "src/capture/capture.hpp"
#include "src/capture/contents.hpp"
#include "src/capture/h5_driver.hpp"
#include "src/core/threads.hpp"

namespace bolo::capture {
namespace {

constexpr double kCommitEvery_s = 0.5;
constexpr std::size_t kMostFramesUncommitted = 1000;
constexpr hsize_t kSeriesChunk = 1024;

bool cut_rows(hid_t dataset, hsize_t rows) {
  h5::Dims dims = h5::shape(dataset);
  dims[0] = rows;
  return H5Dset_extent(dataset, dims.data()) >= 0;
}

Status check_info(const CaptureInfo& info, const WriterOptions& options) {
  const Geometry g = info.format.geometry;
  if (g.width < 1 || g.height < 1) {
    return bad_input("frames of " + std::to_string(g.width) + "x" + std::to_string(g.height) + " cannot be stored");
  }
  if (options.deflate_level < 0 || options.deflate_level > 9) {
    return bad_input("a compression level of " + std::to_string(options.deflate_level) + " is not one of 0 to 9");
  }
  return check_format_values(info.format);
}

bool write_identity(hid_t root, const CaptureInfo& info) {
  const LinearScale& scale = info.format.scale;
  return h5::write_attribute(root, "format", std::string("bolo-capture")) &&
         h5::write_attribute(root, "version", std::int64_t{1}) &&
         h5::write_attribute(root, "unit", std::string(scale.unit == Unit::kKelvin ? "kelvin" : "count")) &&
         h5::write_attribute(root, "scale", scale.scale) && h5::write_attribute(root, "offset", scale.offset) &&
         h5::write_attribute(root, "frame_period_s", info.format.frame_period_s) &&
         h5::write_attribute(root, "camera_model", info.camera_model) &&
         h5::write_attribute(root, "camera_serial", info.camera_serial) &&
         h5::write_attribute(root, "row_step", std::int64_t{info.format.row_step});
}

std::size_t frames_between_commits(double frame_period_s) {
  const double frames = std::clamp(kCommitEvery_s / frame_period_s, 1.0, static_cast<double>(kMostFramesUncommitted));
  return static_cast<std::size_t>(frames);
}

// A killed process may leave such a capture, which may be replaced.
bool is_without_frames(const std::filesystem::path& part) {
  const auto reader = CaptureReader::open(part);
  return !reader && reader.error().message.ends_with(kNoFrameStored);
}

}  // namespace

struct CaptureWriter::Impl {
  // A dataset with one plane per frame; none if not requested.
  struct Planes {
    h5::Handle dataset;
    hid_t type = H5T_NATIVE_FLOAT;
  };

  std::filesystem::path final_name;
  std::filesystem::path part_name;
  HeldFolder folder;
  std::filesystem::path part;  // the file part_name, in the held folder
  CaptureInfo info;
  WriterOptions options;
  std::shared_ptr<DrivenFile> driven;  // none once it has its final name, or was given up
  h5::Handle file;
  Planes frames;
  Planes truth;
  Planes motion;
  std::vector<BlockMotion> no_motion;  // one frame's
  h5::Handle t;
  h5::Handle frame_id;
  h5::Handle t_host;
  h5::Handle t_utc;

  std::size_t written = 0;  // frames in /frames; of these, `written - pending_t.size()` are in /t and /frame_id
  std::size_t commit_frames = 1;
  std::vector<double> pending_t;
  std::vector<std::uint64_t> pending_id;
  std::vector<double> pending_host;
  std::vector<double> pending_utc;
  double uncertainty_s = 0.0;         // largest of UTC
  double stated_uncertainty_s = 0.0;  // value of the attribute
  std::vector<Event> pending_events;
  double last_t_s = -std::numeric_limits<double>::infinity();
  std::uint64_t last_id = 0;

  Status create() {
    folder = HeldFolder(final_name);
    part = folder.place_of(part_name);
    if (Status good = check_output({final_name, options.replace}); !good) return good;
    const SurvivesCut survives = options.survives_power_cut ? SurvivesCut::kPower : SurvivesCut::kProcess;
    const Replace replace = is_without_frames(part) ? Replace::kExisting : options.replace;
    ASSIGN_OR_RETURN(auto created, at(part_name.string(), CrashSafeFile::create(part, survives, replace)));
    driven = std::make_shared<DrivenFile>();
    driven->file = std::move(created);
    // Before HDF5 writes: version 1.10 cannot clean up after a file whose first pages do not fit on the disk.
    if (Status good = driven->file->reserve(frame_bytes()); !good)
      return at(part_name.string(), std::move(good.error()));
    ASSIGN_OR_RETURN(file, at(part_name.string(), create_hdf5(part, driven)));
    return create_items();
  }

  Status create_items() {
    const h5::Handle root(H5Gopen2(file.get(), "/", H5P_DEFAULT));
    if (!root || !write_identity(root.get(), info)) return broken("the root attributes cannot be written");
    const Geometry g = info.format.geometry;
    const h5::Dims frame{1, static_cast<hsize_t>(g.height), static_cast<hsize_t>(g.width)};
    if (info.format.type == PixelType::kUint16) frames.type = H5T_NATIVE_UINT16;
    bool good = true;
    const auto create_planes = [&](Planes& planes, const char* path, const h5::Dims& shape) {
      planes.dataset = h5::create_growing(file.get(), path, planes.type, shape, options.deflate_level);
      good = good && planes.dataset;
    };
    create_planes(frames, "/frames", frame);
    t = h5::create_growing(file.get(), "/t", H5T_NATIVE_DOUBLE, {kSeriesChunk});
    frame_id = h5::create_growing(file.get(), "/frame_id", H5T_NATIVE_UINT64, {kSeriesChunk});
    if (options.truth) create_planes(truth, "/truth/frames", frame);
    if (options.motion) {
      const Geometry blocks = motion_blocks(g);
      no_motion.resize(blocks.pixels());
      create_planes(motion, "/motion",
                    {1, static_cast<hsize_t>(blocks.height), static_cast<hsize_t>(blocks.width), kMotionValues});
    }
    if (options.times) {
      t_host = h5::create_growing(file.get(), "/t_host", H5T_NATIVE_DOUBLE, {kSeriesChunk});
      t_utc = h5::create_growing(file.get(), "/t_utc", H5T_NATIVE_DOUBLE, {kSeriesChunk});
      good = good && t_host && t_utc;
    }
    if (!good || !t || !frame_id) return broken("the datasets cannot be created");
    return commit();
  }

  Status check_order(double t_s, std::uint64_t id) const {
    if (!std::isfinite(t_s) || t_s <= last_t_s) {
      return bad_input(final_name.string() + ": the time of frame " + std::to_string(written) + " (" + h5::text(t_s) +
                       ") is not above the one before (" + h5::text(last_t_s) + ")");
    }
    if (written > 0 && id <= last_id) {
      return bad_input(final_name.string() + ": the number of frame " + std::to_string(written) + " (" +
                       std::to_string(id) + ") is not above the one before (" + std::to_string(last_id) + ")");
    }
    return {};
  }

  // Reserves room for all that the next commit writes. (A file truncated by another program would grow again, with a
  // hole.)
  Status make_room(std::uint64_t bytes) {
    RETURN_IF_ERROR(check_file());
    hsize_t size = 0;
    if (H5Fget_filesize(file.get(), &size) < 0) return broken("its size is not known");
    return at(part_name.string(), driven->file->reserve(size + bytes));
  }

  Status write_planes(const void* plane, const float* truth_plane, const BlockMotion* blocks) {
    if (blocks == nullptr) blocks = no_motion.data();
    bool good = true;
    for (const auto& [planes, data] :
         {std::pair<const Planes*, const void*>{&frames, plane}, {&truth, truth_plane}, {&motion, blocks}}) {
      if (good && planes->dataset) good = h5::write_rows(planes->dataset.get(), planes->type, written, 1, data);
    }
    if (good) return {};
    const auto error = broken("frame " + std::to_string(written) + " cannot be written");
    for (const Planes* planes : {&frames, &truth, &motion}) {
      if (planes->dataset) cut_rows(planes->dataset.get(), written);
    }
    return error;
  }

  Status write_attribute(const Attribute& attribute) {
    const h5::Quiet quiet;
    if (!file) return closed();
    const h5::Handle root(H5Gopen2(file.get(), "/", H5P_DEFAULT));
    const auto write = [&](const auto& value) { return h5::write_attribute(root.get(), attribute.name, value); };
    if (std::visit(write, attribute.value)) return {};
    return broken("root attribute '" + attribute.name + "' cannot be written");
  }

  bool is_ours() const { return folder.is_folder_of(final_name) && driven->file->is_ours(); }

  // Checked before each frame and commit, not only at the end: otherwise all later frames would be lost, too.
  Status check_file() const {
    if (is_ours()) return {};
    return failed(part_name.string() + ": was removed, renamed or cut off by another program");
  }

  Status commit() {
    RETURN_IF_ERROR(check_file());
    return store();
  }

  Status store() {
    const hsize_t begin = written - pending_t.size();
    const hsize_t count = pending_t.size();
    if (count > 0) {
      if (!h5::write_rows(t.get(), H5T_NATIVE_DOUBLE, begin, count, pending_t.data()))
        return broken("/t cannot be written");
      if (!h5::write_rows(frame_id.get(), H5T_NATIVE_UINT64, begin, count, pending_id.data())) {
        return broken("/frame_id cannot be written");
      }
      for (const auto& [dataset, values] : {std::pair{&t_host, &pending_host}, {&t_utc, &pending_utc}}) {
        if (!*dataset) continue;
        if (!h5::write_rows(dataset->get(), H5T_NATIVE_DOUBLE, begin, count, values->data())) {
          return broken("/t_host and /t_utc cannot be written");
        }
      }
      pending_t.clear();
      pending_id.clear();
      pending_host.clear();  // all together: each has one value per pending frame
      pending_utc.clear();
    }
    if (!pending_events.empty()) {
      if (!append_events(file.get(), pending_events)) return broken("/events cannot be written");
      pending_events.clear();
    }
    if (!state_uncertainty()) return broken("root attribute 'utc_uncertainty_s' cannot be written");
    if (H5Fflush(file.get(), H5F_SCOPE_LOCAL) < 0) return broken("cannot be committed");
    return {};
  }

  bool state_again(const char* name, double value) {
    const h5::Handle root(H5Gopen2(file.get(), "/", H5P_DEFAULT));
    const bool gone = H5Aexists(root.get(), name) == 0 || H5Adelete(root.get(), name) >= 0;
    return gone && h5::write_attribute(root.get(), name, value);
  }

  bool state_uncertainty() {
    if (uncertainty_s <= stated_uncertainty_s) return true;
    stated_uncertainty_s = uncertainty_s;
    return state_again("utc_uncertainty_s", uncertainty_s);
  }

  // On failure the file is given up, in the state of its last commit.
  Status close_file() {
    driven->ending = true;
    for (h5::Handle* dataset : {&frames.dataset, &truth.dataset, &motion.dataset, &t, &frame_id, &t_host, &t_utc})
      dataset->close();
    const bool closed = file.close();
    const int error = driven->error;
    if (closed && error == 0) return {};
    driven.reset();
    if (error == 0) return broken("cannot be closed");
    return failed(part_name.string() + ": cannot be closed: " + std::strerror(error));
  }

  void discard() {
    const bool ours = !driven || is_ours();
    if (driven) static_cast<void>(close_file());
    if (!ours) return;
    std::error_code ignored;
    std::filesystem::remove(part, ignored);
    remove_records(part);
  }

  std::uint64_t frame_bytes() const {
    const std::size_t truth_bytes = options.truth ? plane_bytes(info.format.geometry, PixelType::kFloat32) : 0;
    return plane_bytes(info.format.geometry, info.format.type) + truth_bytes + no_motion.size() * sizeof(BlockMotion);
  }
  tl::unexpected<Error> broken(const std::string& what) const {
    return failed(part_name.string() + ": " + what + h5::because());
  }
  tl::unexpected<Error> closed() const { return failed(final_name.string() + ": the capture is closed already"); }
};

CaptureWriter::CaptureWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CaptureWriter::CaptureWriter(CaptureWriter&&) noexcept = default;
CaptureWriter& CaptureWriter::operator=(CaptureWriter&&) noexcept = default;

CaptureWriter::~CaptureWriter() {
  if (!impl_ || !impl_->file) return;
  const h5::Quiet quiet;
  attempt([this] {
    if (impl_->written == 0) return impl_->discard();
    impl_->driven->ending = true;
    static_cast<void>(impl_->store());
    const bool ours = impl_->is_ours();
    if (impl_->close_file() && impl_->driven->file->finish() && ours) remove_records(impl_->part);
  });
}

Result<CaptureWriter> CaptureWriter::create(const std::filesystem::path& file, const CaptureInfo& info,
                                            const WriterOptions& options) {
  const h5::Quiet quiet;
  if (Status good = check_info(info, options); !good) return at(file.string(), std::move(good.error()));
  auto impl = std::make_unique<Impl>();
  impl->final_name = file;
  impl->part_name = file.string() + ".part";
  impl->info = info;
  impl->options = options;
  impl->commit_frames = frames_between_commits(info.format.frame_period_s);
  // Room for a frame's numbers is reserved before its planes are written: otherwise numbers could shift against frames.
  for (auto* pending : {&impl->pending_t, &impl->pending_host, &impl->pending_utc})
    pending->reserve(impl->commit_frames);
  impl->pending_id.reserve(impl->commit_frames);
  if (Status good = tried([&] { return impl->create(); }); !good) {
    if (impl->driven) impl->discard();
    return tl::unexpected<Error>(std::move(good.error()));
  }
  return CaptureWriter(std::move(impl));
}

Status CaptureWriter::append(double t_s, std::uint64_t frame_id, const void* plane, const float* truth,
                             const BlockMotion* motion, const FrameTimes* times) {
  const h5::Quiet quiet;
  Impl& w = *impl_;
  if (!w.file) return w.closed();
  if ((truth != nullptr) != w.options.truth) {
    return failed(w.final_name.string() + ": a truth plane must come with every frame or with none");
  }
  if (motion != nullptr && !w.options.motion) return failed(w.final_name.string() + ": it was begun without /motion");
  if ((times != nullptr) != w.options.times) {
    return failed(w.final_name.string() + ": /t_host and /t_utc must come with every frame or with none");
  }
  if (Status good = w.check_order(t_s, frame_id); !good) return good;
  if (Status good = w.make_room(w.frame_bytes()); !good) return good;
  if (Status good = w.write_planes(plane, truth, motion); !good) return good;
  ++w.written;
  w.pending_t.push_back(t_s);
  w.pending_id.push_back(frame_id);
  if (times != nullptr) {
    w.pending_host.push_back(times->host_s);
    w.pending_utc.push_back(times->utc_s);
    w.uncertainty_s = std::max(w.uncertainty_s, times->uncertainty_s);
  }
  w.last_t_s = t_s;
  w.last_id = frame_id;
  return w.pending_t.size() >= w.commit_frames ? w.commit() : Status{};
}

Status CaptureWriter::write_stimulus(const Stimulus& stimulus) {
  const h5::Quiet quiet;
  if (!impl_->file) return impl_->closed();
  RETURN_IF_ERROR(at(impl_->part_name.string(), check_stimulus(stimulus)));
  if (const auto* scene = std::get_if<SceneStimulus>(&stimulus)) {
    RETURN_IF_ERROR(impl_->make_room(scene->image_k.size() * sizeof(float) + 3 * scene->t_s.size() * sizeof(double)));
  }
  return at(impl_->part_name.string(), capture::write_stimulus(impl_->file.get(), stimulus));
}

Status CaptureWriter::add_event(const Event& event) {
  if (!impl_->file) return impl_->closed();
  if (!std::isfinite(event.t_s) || event.kind.empty() || event.kind.size() > kLongestEventKind) {
    return bad_input(impl_->final_name.string() + ": an event needs a finite time and a kind of 1 to " +
                     std::to_string(kLongestEventKind) + " bytes; got '" + event.kind + "'");
  }
  impl_->pending_events.push_back(event);
  return {};
}

Status CaptureWriter::write_points(const std::vector<Point>& points) {
  const h5::Quiet quiet;
  Impl& w = *impl_;
  if (!w.file) return w.closed();
  const Geometry g = w.info.format.geometry;
  if (g.height != 1 || points.size() != g.pixels()) {
    return bad_input(w.final_name.string() + ": " + std::to_string(points.size()) + " points for frames of " +
                     std::to_string(g.width) + "x" + std::to_string(g.height) + "; give one for each pixel of one row");
  }
  if (Status good = w.make_room(2 * sizeof(std::int32_t) * (points.size() + kSeriesChunk)); !good) return good;
  for (const auto& [path, member] : {std::pair{"/points/x", &Point::x}, std::pair{"/points/y", &Point::y}}) {
    std::vector<std::int32_t> values;
    values.reserve(points.size());
    for (const Point& point : points) values.push_back(point.*member);
    const h5::Handle dataset = h5::create_growing(w.file.get(), path, H5T_NATIVE_INT32, {kSeriesChunk}, 0);
    if (!dataset || !h5::write_rows(dataset.get(), H5T_NATIVE_INT32, 0, values.size(), values.data())) {
      return w.broken(std::string(path) + " cannot be written");
    }
  }
  return {};
}

Status CaptureWriter::write_attribute(const std::string& name, const std::variant<double, std::string>& value) {
  return impl_->write_attribute({name, value});
}

Status CaptureWriter::write_attributes(const std::vector<Attribute>& attributes) {
  for (const Attribute& attribute : attributes) RETURN_IF_ERROR(impl_->write_attribute(attribute));
  return {};
}

Status CaptureWriter::state_period(double period_s) {
  const h5::Quiet quiet;
  if (!impl_->file) return impl_->closed();
  return impl_->state_again("frame_period_s", period_s) ? Status() : impl_->broken("frame_period_s cannot be written");
}

Status CaptureWriter::commit() {
  const h5::Quiet quiet;
  return impl_->file ? impl_->commit() : impl_->closed();
}

Status CaptureWriter::complete() {
  const h5::Quiet quiet;
  Impl& w = *impl_;
  if (!w.file) return w.closed();
  w.driven->ending = true;
  if (Status good = w.commit(); !good) return good;
  return w.close_file();
}

// The file is on disk before it gets its name.
Status CaptureWriter::close() {
  Impl& w = *impl_;
  if (w.file) {
    if (Status good = complete(); !good) return good;
  }
  if (!w.driven) return w.closed();
  RETURN_IF_ERROR(w.check_file());
  if (!w.driven->file->finish()) return failed(w.part_name.string() + ": cannot be stored: " + std::strerror(errno));
  if (w.driven->erred && !CaptureReader::open(w.part)) {
    return failed(w.part_name.string() + ": was damaged by an error of the disk; save it with bolo recover");
  }
  Status published = publish(w.folder, w.part_name, {w.final_name, w.options.replace});
  if (published) remove_records(w.part);
  w.driven.reset();  // also releases the lock: its next holder finds that the name is gone
  return published;
}

void CaptureWriter::discard() {
  const h5::Quiet quiet;
  impl_->discard();
}

}  // namespace bolo::capture
