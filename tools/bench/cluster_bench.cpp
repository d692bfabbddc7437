#include "tools/bench/cluster_bench.hpp"

#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <functional>
#include <numeric>
#include <optional>
#include <system_error>
#include <utility>

#include "src/capture/capture.hpp"
#include "src/core/clock.hpp"
#include "src/core/unique_fd.hpp"
#include "tools/cluster/coordinator.hpp"
#include "tools/cluster/job_folder.hpp"
#include "tools/deblur/block_planes.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/deblur_plan.hpp"
#include "tools/lab/eval/recording.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFrames = 400;
constexpr double kSpeedPxS = 300.0;
constexpr std::size_t kDiskBytes = std::size_t{256} << 20U;
constexpr std::size_t kChunk = std::size_t{1} << 20U;
constexpr std::size_t kWordPieces = 20'000;
constexpr int kWordRanks = 1000;
constexpr int kLeastRepeats = 3;

bool go_on(std::uint64_t /*frames*/) { return true; }

double wall_s() { return static_cast<double>(monotonic_ns()) / kNsPerSecond; }

// Of all threads of this process.
double processor_s() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec) / kNsPerSecond;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// A folder that goes with all in it.
class Scratch {
 public:
  static Result<Scratch> make(const fs::path& parent) {
    std::string name = (parent / "bolo-bench-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) {
      return bad_input("--scratch " + parent.string() + ": no folder can be made there: " + std::strerror(errno));
    }
    return Scratch(name);
  }
  Scratch(Scratch&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  Scratch& operator=(Scratch&&) = delete;
  ~Scratch() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  fs::path operator/(const char* name) const { return path_ / name; }

 private:
  explicit Scratch(fs::path path) : path_(std::move(path)) {}
  fs::path path_;
};

Status write_street(const fs::path& file) {
  sim::CameraSettings camera;
  camera.geometry = {640, 120};
  const auto street = record_street(camera, {.speed_px_s = kSpeedPxS, .frames = kFrames});
  if (!street) return tl::unexpected(street.error());
  capture::CaptureInfo info;
  info.format = street->format;
  auto writer = capture::CaptureWriter::create(file, info);
  if (!writer) return tl::unexpected(writer.error());
  for (std::size_t i = 0; i < street->planes.size(); ++i) {
    const double t_s = static_cast<double>(i) * info.format.frame_period_s;
    if (Status status = writer->append(t_s, i, street->planes[i].data()); !status) return status;
  }
  return writer->close();
}

Status disk_failed(const fs::path& file) { return failed(file.string() + ": " + std::strerror(errno)); }

// Writes a file and flushes it, then reads it from the disk itself; GB/s.
Status measure_disk(const fs::path& file, ClusterReport& report) {
  std::vector<char> chunk(kChunk, 'b');
  const UniqueFd fd(::open(file.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
  if (!fd) return disk_failed(file);
  const double gb = static_cast<double>(kDiskBytes) / 1e9;
  double start = wall_s();
  for (std::size_t done = 0; done < kDiskBytes; done += kChunk) {
    if (::write(fd.get(), chunk.data(), kChunk) != static_cast<ssize_t>(kChunk)) return disk_failed(file);
  }
  if (::fsync(fd.get()) != 0) return disk_failed(file);
  report.write_gb_s = gb / (wall_s() - start);
  if (::posix_fadvise(fd.get(), 0, 0, POSIX_FADV_DONTNEED) != 0 || ::lseek(fd.get(), 0, SEEK_SET) != 0) {
    return disk_failed(file);
  }
  start = wall_s();
  for (std::size_t done = 0; done < kDiskBytes; done += kChunk) {
    if (::read(fd.get(), chunk.data(), kChunk) != static_cast<ssize_t>(kChunk)) return disk_failed(file);
  }
  report.read_gb_s = gb / (wall_s() - start);
  return {};
}

// Pieces without work.
class NoWork final : public cluster::Work {
 public:
  NoWork() : pieces_(kWordPieces) {
    for (std::size_t i = 0; i < pieces_.size(); ++i) pieces_[i].name = std::to_string(i);
  }
  const std::vector<cluster::Piece>& pieces() const override { return pieces_; }
  bool done(std::size_t /*piece*/) const override { return false; }
  Status run(std::size_t /*piece*/, const cluster::Beat& /*beat*/) override { return {}; }

 private:
  std::vector<cluster::Piece> pieces_;
};

// What rank 0 does for a piece: reads the word that one is done, and finds and writes the next.
double measure_words() {
  NoWork work;
  cluster::Coordinator coordinator(work, kWordRanks, 1e9);
  for (int rank = 1; rank < kWordRanks; ++rank) coordinator.heard(rank, 0.0);
  const double start = processor_s();
  std::size_t words = 0;
  while (!coordinator.finished()) {
    for (int rank = 0; rank < kWordRanks; ++rank) {
      const auto piece = coordinator.next(rank);
      if (!piece) continue;
      words += nlohmann::json{{"piece", *piece}}.dump().size();
      const auto word = nlohmann::json::parse(nlohmann::json{{"did", *piece}, {"seconds", 21.5}}.dump());
      coordinator.did(rank, word.at("did").get<std::size_t>(), 1.0);
    }
  }
  return words == 0 ? 0.0 : (processor_s() - start) / static_cast<double>(kWordPieces);
}

// One of each kind of piece, on the same capture.
class Pieces {
 public:
  Pieces(const DeblurRequest& request, const Scratch& scratch, const cluster::JobFolder& folder)
      : request_(request), scratch_(scratch), folder_(folder) {}

  Status once() {
    auto run = CaptureRun::open(request_, scratch_ / "in.h5", true);
    if (!run) return tl::unexpected(run.error());
    Status status = time_block(*run);
    if (status) status = time_walk(*run);
    if (status) status = time_together(*run);
    return status ? time_smallest() : status;
  }

  PieceCosts costs() const {
    PieceCosts costs;
    costs.deblur_s = median(deblur_s_);
    costs.walk_s = walk_s_.empty() ? 0.0 : median(walk_s_);
    costs.together_s = median(together_s_);
    costs.piece_s = std::max(0.0, median(smallest_s_) - costs.deblur_s);
    costs.raw_bytes = raw_bytes_;
    costs.sharp_bytes = sharp_bytes_;
    return costs;
  }
  const std::string& solver_text() const { return solver_text_; }

 private:
  Status time_block(CaptureRun& run) {
    const double start = processor_s();
    auto block = run.block({0, kFrames}, {}, scratch_ / "block", go_on);
    if (!block) return tl::unexpected(block.error());
    deblur_s_.push_back((processor_s() - start) / kFrames);
    block_ = std::move(*block);
    raw_bytes_ = static_cast<double>(plane_bytes(run.info().format.geometry, run.info().format.type));
    sharp_bytes_ = static_cast<double>(run.plane_size());
    return {};
  }

  Status time_walk(CaptureRun& run) {
    const auto needed = run.needs_walk();
    if (!needed || !*needed) return needed ? Status{} : tl::unexpected(needed.error());
    const double start = processor_s();
    const auto state = run.walk(0, {}, kFrames - 1, go_on);
    if (!state) return tl::unexpected(state.error());
    walk_s_.push_back((processor_s() - start) / kFrames);
    return {};
  }

  Status time_together(CaptureRun& run) {
    nlohmann::json record{{"crc", block_.crc}, {"written", nlohmann::json::array()}};
    for (const replay::FrameRange& frames : block_.written) record["written"].push_back({frames.first, frames.end});
    BlockPlanes planes({{scratch_ / "block", record}}, run.plane_size(), [](std::size_t) {});
    const double start = processor_s();
    const auto facts = run.put_together(
        scratch_ / "out.h5", [&planes] { return planes.next(); }, go_on);
    if (!facts) return tl::unexpected(facts.error());
    together_s_.push_back((processor_s() - start) / kFrames);
    solver_text_ = facts->solver_text;
    return {};
  }

  // From the name of the capture to the record on the disk; by the clock, for it waits for the disk.
  Status time_smallest() {
    const double start = wall_s();
    auto run = CaptureRun::open(request_, scratch_ / "in.h5", true);
    if (!run) return tl::unexpected(run.error());
    const fs::path own = folder_.unfinished("block");
    const auto block = run->block({0, 1}, {}, own, go_on);
    if (!block) return tl::unexpected(block.error());
    if (Status status = cluster::publish(own, folder_.data("block")); !status) return status;
    if (Status status = folder_.add_record("block", {{"crc", block->crc}}); !status) return status;
    smallest_s_.push_back(wall_s() - start);
    return {};
  }

  const DeblurRequest& request_;
  const Scratch& scratch_;
  const cluster::JobFolder& folder_;
  CaptureRun::Block block_;
  double raw_bytes_ = 0.0;
  double sharp_bytes_ = 0.0;
  std::string solver_text_;
  std::vector<double> deblur_s_;
  std::vector<double> walk_s_;
  std::vector<double> together_s_;
  std::vector<double> smallest_s_;
};

}  // namespace

Result<ClusterReport> bench_cluster(const ClusterBenchOptions& options) {
  const auto scratch = Scratch::make(options.scratch);
  if (!scratch) return tl::unexpected(scratch.error());
  const auto folder = cluster::JobFolder::open(*scratch / "job", {{"bolo_job", 1}});
  if (!folder) return tl::unexpected(folder.error());
  ClusterReport report;
  report.task = options.task;
  report.frames = kFrames;
  Status status = write_street(*scratch / "in.h5");
  if (status) status = measure_disk(*scratch / "disk", report);
  Pieces pieces(options.request, *scratch, *folder);
  const double start = wall_s();
  while (status && (report.repeats < kLeastRepeats || wall_s() - start < options.seconds)) {
    status = pieces.once();
    ++report.repeats;
  }
  if (!status) return tl::unexpected(status.error());
  report.costs = pieces.costs();
  report.costs.word_s = measure_words();
  report.solver_text = pieces.solver_text();
  for (const double count : options.counts) {
    ClusterMachines machines = options.machines;
    machines.machines = count;
    ClusterTask task = options.task;
    const auto captures = static_cast<std::size_t>(std::ceil(task.hours / task.capture_hours));
    const auto ranks = static_cast<std::size_t>(std::ceil(count * machines.cores));
    const auto frames = static_cast<std::size_t>(task.hours * 3600.0 * task.rate_hz);
    if (options.automatic_block) task.block_frames = static_cast<double>(automatic_block(captures, frames, ranks));
    report.machines.push_back(machines);
    report.block_frames.push_back(task.block_frames);
    report.times.push_back(calculate(report.costs, task, machines));
  }
  return report;
}

}  // namespace bolo::tools
