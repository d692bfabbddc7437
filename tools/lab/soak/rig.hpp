// The processes of a soak: camera, daemon and readers; their state, and the acts that disturb them.
#pragma once

#include <future>

#include "tools/cli/process.hpp"
#include "tools/lab/soak/findings.hpp"
#include "tools/lab/soak/schedule.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak {

struct DaemonFile {
  std::filesystem::path folder;  // existing folder of all files, including bolod.toml and profile.toml
  std::string name;              // of the shared memory
  std::string address;           // of the camera
  Geometry geometry{640, 120};
  double nuc_interval_s = 300.0;  // live key; no effect with nuc.policy = "camera": shows that a reload was applied
};
inline constexpr double kRateHz = 200.0;

// Writes bolod.toml and profile.toml. Thread: any.
Status write_daemon_file(const DaemonFile& file);

std::filesystem::path config_of(const DaemonFile& file);

struct Programs {
  std::filesystem::path lab;  // this program
  std::filesystem::path bolo;
  std::filesystem::path bolod;
  std::filesystem::path stress;  // stress-ng
};
// Finds bolo and bolod beside this program or in PATH, stress-ng in PATH. kBadInput: one is missing. Thread: any.
Result<Programs> find_programs();

// Account of all camera processes: those that ended, and the present one.
class CameraBook {
 public:
  void begin() { ++camera_; }  // a new process
  void add(const CameraAccount& account);
  void end();  // adds its last account

  int camera() const noexcept { return camera_; }
  const std::optional<CameraAccount>& present() const noexcept { return present_; }
  // True if the fault counts have not changed since the previous account: no fault is active.
  bool quiet() const noexcept { return quiet_; }
  // The camera's part of a mark, by the present account.
  Mark mark() const;
  std::uint64_t sent() const;

 private:
  int camera_ = -1;
  std::optional<CameraAccount> present_;
  bool quiet_ = false;
  Mark past_;  // sums over ended cameras
  std::uint64_t past_sent_ = 0;
};

// Thread: one at a time.
class Rig {
 public:
  // Chooses name and address for the daemon's file.
  static Result<std::unique_ptr<Rig>> set_up(const Programs& programs, const DaemonFile& file);
  ~Rig();
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  Status start_camera(const Round& round);
  // Waits until it serves; false if it does not: see camera_error().
  bool wait_for_camera();
  std::string camera_error() const { return contents(camera_->log().string() + ".err"); }
  std::string daemon_error() const { return contents(daemon_log()); }
  // Ends the camera and closes its account.
  Status end_camera();
  Status start_daemon();
  Status start_readers();
  Status replace_reader();
  void read_camera();

  Process& camera() { return *camera_; }
  Process& daemon() { return *daemon_; }
  bool has_camera() const noexcept { return camera_.has_value(); }
  std::vector<Process>& readers() { return readers_; }
  CameraBook& book() { return book_; }
  const Truth& truth() const { return *truth_; }
  DaemonFile& daemon_file() { return file_; }
  const Programs& programs() const noexcept { return programs_; }
  const std::string& name() const noexcept { return file_.name; }
  std::filesystem::path daemon_log() const { return file_.folder / "bolod.err"; }
  std::filesystem::path file(const std::string& name) const { return file_.folder / name; }

 private:
  Rig(Programs programs, DaemonFile file) : programs_(std::move(programs)), file_(std::move(file)) {}
  Status make_files();

  Programs programs_;
  DaemonFile file_;
  std::optional<Truth> truth_;
  CameraBook book_;
  std::optional<LineTail> camera_lines_;
  std::optional<Process> camera_;
  std::optional<Process> daemon_;
  std::vector<Process> readers_;
  int started_readers_ = 0;
};

// --- A reader process: reads every frame through libbolo-client, like any program.

// Reads until `stop`; prints a line of JSON twice a second and at the end: frames, missed, restarts, and disorder
// (frames whose numbers or times are out of order). Thread: setup.
Status read_along(const std::string& name, const std::atomic<bool>& stop);

// The last complete line of these reports; zeros if there is none. Thread: any.
Json last_account(const std::string& file);

// --- Disturbances that run beside the soak's own thread.

// Disturbs the processes, by kind; the camera's own faults come from its script. Thread: one at a time.
class Acts {
 public:
  Acts(Rig& rig, Findings& findings) : rig_(rig), findings_(findings) {}

  void begin(const Disturbance& disturbance);
  void end(const Disturbance& disturbance);
  void finish() { jobs_.clear(); }

 private:
  void record(const Disturbance& disturbance);
  void take(Kind kind);
  void give_back();
  void write_config(bool right);

  // Starts a job that takes time and is judged at its end: a recording or a command.
  void run_beside(std::function<void()> job) { jobs_.push_back(std::async(std::launch::async, std::move(job))); }

  Rig& rig_;
  Findings& findings_;
  std::vector<std::future<void>> jobs_;  // destructors wait
  std::optional<Process> helper_;        // stress-ng
  int count_ = 0;
};

}  // namespace bolo::tools::soak
