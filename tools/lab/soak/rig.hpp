// The processes of a soak: camera, daemon, readers; and what is known of them.
#pragma once

#include <array>
#include <atomic>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "tools/cli/process.hpp"
#include "tools/lab/soak/account.hpp"
#include "tools/lab/soak/scene.hpp"
#include "tools/lab/soak/schedule.hpp"

namespace bolo::tools::soak {

// The configuration of the soak's daemon: a user's own, or the defaults, with what the soak must decide put over
// it.

struct DaemonFile {
  std::filesystem::path base;    // empty: bolod's defaults
  std::filesystem::path folder;  // where the files are written: bolod.toml, profile.toml
  std::string name;              // of the shared memory
  std::string address;           // of the camera
  Geometry geometry;
  double rate_hz = 200.0;
  int packet_size = 0;
  double nuc_interval_s = 300.0;  // a live key, with nuc.policy = "camera" of no effect: to see a reload taken up
};

// Writes both. kBadInput: the base or its profile cannot be read. Thread: any.
Status write_daemon_file(const DaemonFile& file);

// The configuration that was written.
std::filesystem::path config_of(const DaemonFile& file);

// All of a file; empty where it cannot be read. Thread: any.
std::string contents(const std::filesystem::path& file);

struct Programs {
  std::filesystem::path lab;  // this program
  std::filesystem::path bolo;
  std::filesystem::path bolod;
  std::filesystem::path stress;  // stress-ng; empty: not installed
};
// bolo and bolod are beside this program or in PATH. kBadInput: one is not there. Thread: any.
Result<Programs> find_programs();

struct RigRequest {
  std::filesystem::path folder;  // for all files; exists
  std::filesystem::path base_config;
  Geometry geometry{640, 120};
  double rate_hz = 200.0;
};

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
  // All that faults have done so far, of all cameras.
  const std::vector<fakecam::InjectedFault>& ended() const noexcept { return ended_; }
  std::uint64_t sent() const;

 private:
  int camera_ = -1;
  std::optional<CameraAccount> present_;
  bool quiet_ = false;
  Mark past_;  // sums over cameras that ended
  std::uint64_t past_sent_ = 0;
  std::vector<fakecam::InjectedFault> ended_;
};

// Thread: one at a time.
class Rig {
 public:
  static Result<std::unique_ptr<Rig>> set_up(const Programs& programs, const RigRequest& request);
  ~Rig();
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  // A camera with this script, at the rig's address.
  Status start_camera(const Round& round);
  // Waits until it serves; false when it does not, and camera_error() says why.
  bool wait_for_camera();
  std::string camera_error() const;
  std::string daemon_error() const;
  // Ends it and closes its book.
  Status end_camera();
  Status start_daemon();
  Status start_readers();
  Status replace_reader();
  // Takes up what the camera has told.
  void read_camera();

  Process& camera() { return *camera_; }
  Process& daemon() { return *daemon_; }
  bool has_camera() const noexcept { return camera_.has_value(); }
  std::vector<Process>& readers() { return readers_; }
  CameraBook& book() { return book_; }
  bool degrades() const noexcept { return degrades_; }  // the daemon spends less on frames rather than lose them
  const Truth& truth() const { return *truth_; }
  DaemonFile& daemon_file() { return file_; }
  const Programs& programs() const noexcept { return programs_; }
  const RigRequest& request() const noexcept { return request_; }
  const std::string& name() const noexcept { return file_.name; }
  std::filesystem::path daemon_log() const { return request_.folder / "bolod.err"; }
  std::filesystem::path file(const std::string& name) const { return request_.folder / name; }

  // A reader process of this rig, by its log's name. slow_ms: it takes as long for each frame.
  Command reader(const std::string& log, int slow_ms) const;

 private:
  Rig(Programs programs, RigRequest request) : programs_(std::move(programs)), request_(std::move(request)) {}
  Status make_files();

  Programs programs_;
  RigRequest request_;
  DaemonFile file_;
  std::optional<Truth> truth_;
  CameraBook book_;
  std::optional<LineTail> camera_lines_;
  std::optional<Process> camera_;
  std::optional<Process> daemon_;
  std::vector<Process> readers_;
  bool degrades_ = false;
  int started_readers_ = 0;
};

// --- A reader process: reads every frame as any program does, with libbolo-client.

// Until `stop`; prints a line of JSON twice a second and at the end: frames, missed, restarts, and disorder, frames
// that came in another order than their numbers and times say. slow_ms: what it takes for each frame. Thread: setup.
Status read_along(const std::string& name, int slow_ms, const std::atomic<bool>& stop);

// That line.
struct ReaderAccount {
  unsigned long long frames = 0;
  unsigned long long missed = 0;
  unsigned long long restarts = 0;
  unsigned long long disorder = 0;
};
std::string text_of(const ReaderAccount& account);
// Of the last whole line of such; zeros of none. Thread: any.
ReaderAccount last_account(const std::string& file);

}  // namespace bolo::tools::soak
