// The processes of a soak: camera, daemon, readers; their state, and the acts of each kind of trouble.
#pragma once

#include <future>

#include "tools/cli/process.hpp"
#include "tools/lab/soak/findings.hpp"
#include "tools/lab/soak/schedule.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak {

// The configuration of the soak's daemon.
struct DaemonFile {
  std::filesystem::path folder;  // for all files, bolod.toml and profile.toml among them; exists
  std::string name;              // of the shared memory
  std::string address;           // of the camera
  Geometry geometry{640, 120};
  double nuc_interval_s = 300.0;  // a live key, with nuc.policy = "camera" of no effect: to see a reload taken up
};
inline constexpr double kRateHz = 200.0;

// Writes both. Thread: any.
Status write_daemon_file(const DaemonFile& file);

// The configuration that was written.
std::filesystem::path config_of(const DaemonFile& file);

struct Programs {
  std::filesystem::path lab;  // this program
  std::filesystem::path bolo;
  std::filesystem::path bolod;
  std::filesystem::path stress;  // stress-ng
};
// bolo and bolod are beside this program or in PATH, stress-ng is in PATH. kBadInput: one is not there. Thread: any.
Result<Programs> find_programs();

// The books of all camera processes: those that ended, and the present one.
class CameraBook {
 public:
  void begin() { ++camera_; }  // another process
  void add(const CameraAccount& account);
  void end();  // its last account was added

  int camera() const noexcept { return camera_; }
  const std::optional<CameraAccount>& present() const noexcept { return present_; }
  // The present account is the same, as far as faults go, as the one before: nothing strikes just now.
  bool quiet() const noexcept { return quiet_; }
  // The camera's part of a mark, as of the present account.
  Mark mark() const;
  std::uint64_t sent() const;

 private:
  int camera_ = -1;
  std::optional<CameraAccount> present_;
  bool quiet_ = false;
  Mark past_;  // sums over cameras that ended
  std::uint64_t past_sent_ = 0;
};

// Thread: one at a time.
class Rig {
 public:
  // Gives the daemon's file a name and an address.
  static Result<std::unique_ptr<Rig>> set_up(const Programs& programs, const DaemonFile& file);
  ~Rig();
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  // A camera with this script, at the rig's address.
  Status start_camera(const Round& round);
  // Waits until it serves; false when it does not: camera_error().
  bool wait_for_camera();
  std::string camera_error() const { return contents(camera_->log().string() + ".err"); }
  std::string daemon_error() const { return contents(daemon_log()); }
  // Ends it and closes its book.
  Status end_camera();
  Status start_daemon();
  Status start_readers();
  Status replace_reader();
  // Reads the camera's reports so far.
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

// --- A reader process: reads every frame as any program does, with libbolo-client.

// Until `stop`; prints a line of JSON twice a second and at the end: frames, missed, restarts, and disorder, frames out
// of the order of their numbers and times. Thread: setup.
Status read_along(const std::string& name, const std::atomic<bool>& stop);

// The last whole line of such; zeros of none. Thread: any.
Json last_account(const std::string& file);

// --- What a soak does beside its own thread.

// Acts of each kind of trouble on the processes; the camera's own faults, by its script, need none. Thread: one at a
// time.
class Acts {
 public:
  Acts(Rig& rig, Findings& findings) : rig_(rig), findings_(findings) {}

  void begin(const Disturbance& disturbance);
  void end(const Disturbance& disturbance);
  // Waits for what still runs.
  void finish() { jobs_.clear(); }

 private:
  void record(const Disturbance& disturbance);
  void take(Kind kind);
  void give_back();
  void write_config(bool right);

  // Does what takes its time and is judged at its end: recordings and commands.
  void run_beside(std::function<void()> job) { jobs_.push_back(std::async(std::launch::async, std::move(job))); }

  Rig& rig_;
  Findings& findings_;
  std::vector<std::future<void>> jobs_;  // each is waited for where it goes
  std::optional<Process> helper_;        // stress-ng
  int count_ = 0;
};

}  // namespace bolo::tools::soak
