#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <fstream>

#include "bolo/client.h"
#include "src/core/clock.hpp"
#include "tools/bolod/config.hpp"
#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak {
namespace {

constexpr double kCameraEnd_s = 5.0;
constexpr auto kServeLimit = std::chrono::seconds(30);
constexpr std::size_t kReaders = 2;
constexpr std::size_t kSmallFrame = 20'000;  // pixels: smaller frames get small packets, so that they have several
constexpr int kSmallPacket = 576;            // bytes
constexpr std::size_t kLap = 240;            // frames of the scene

// Enough frames for a reader that gets no processor for a second.
constexpr int kRingFrames = 256;

constexpr int kOpen_ms = 10'000;
constexpr int kReaderPoll_ms = 100;
constexpr std::int64_t kReportNs = 500'000'000;
constexpr std::streamoff kEnd = 1024;  // bytes: several lines

struct Close {
  void operator()(bolo_client* client) const { bolo_client_close(client); }
};

}  // namespace

Result<Programs> find_programs() {
  Programs programs;
  std::error_code error;
  programs.lab = std::filesystem::read_symlink("/proc/self/exe", error);
  for (const auto& [name, path] : {std::pair{"bolo", &programs.bolo}, std::pair{"bolod", &programs.bolod}}) {
    ASSIGN_OR_RETURN(*path, find_own_program(name));
  }
  programs.stress = find_program("stress-ng");
  if (programs.stress.empty()) return bad_input("there is no stress-ng in PATH; install the package stress-ng");
  return programs;
}

void CameraBook::add(const CameraAccount& account) {
  const auto same = [](const fakecam::InjectedFault& a, const fakecam::InjectedFault& b) {
    return a.times == b.times && a.frames == b.frames && a.packets == b.packets;
  };
  quiet_ = present_ && std::equal(account.injected.begin(), account.injected.end(), present_->injected.begin(),
                                  present_->injected.end(), same);
  present_ = account;
}

void CameraBook::end() {
  if (!present_) return;
  past_ = mark();
  past_sent_ += present_->sent;
  present_.reset();
  quiet_ = false;
}

Mark CameraBook::mark() const {
  Mark mark = past_;
  mark.camera = camera_;
  if (!present_) return mark;
  mark.passed += present_->passed;
  mark.skipped_ids += present_->skipped_ids();
  mark.streams += present_->streams;
  return mark;
}

std::uint64_t CameraBook::sent() const { return past_sent_ + (present_ ? present_->sent : 0); }

Result<std::unique_ptr<Rig>> Rig::set_up(const Programs& programs, const DaemonFile& file) {
  std::unique_ptr<Rig> rig(new Rig(programs, file));
  RETURN_IF_ERROR(rig->make_files());
  return rig;
}

Rig::~Rig() {
  readers_.clear();
  daemon_.reset();
  camera_.reset();
  shm_unlink(("/bolo." + file_.name).c_str());  // left by a killed daemon
}

Status Rig::make_files() {
  file_.name = "soak-" + std::to_string(getpid());
  file_.address = faults::fresh_address();
  RETURN_IF_ERROR(write_daemon_file(file_));
  ASSIGN_OR_RETURN(const auto config, daemon::read_config(config_of(file_)));
  ASSIGN_OR_RETURN(auto truth, make_scene(file_.geometry, kRateHz, kLap, config.pipeline, file("scene.h5")));
  truth_.emplace(std::move(truth));
  return {};
}

Status Rig::start_camera(const Round& round) {
  Command command;
  command.words = {
      programs_.bolo, "fakecam",     file("scene.h5"), "--loop",       "--rate", plot::format("%g", kRateHz),
      "--interface",  file_.address, "--json",         "--tell-every", "0.25"};
  for (const std::string& fault : round.faults()) {
    command.words.emplace_back("--fault");
    command.words.push_back(fault);
  }
  book_.begin();
  command.log = file("camera-" + std::to_string(book_.camera()));
  camera_lines_.emplace(command.log.string() + ".out");
  ASSIGN_OR_RETURN(auto started, Process::start(command));
  camera_.emplace(std::move(started));
  return {};
}

bool Rig::wait_for_camera() {
  const auto deadline = std::chrono::steady_clock::now() + kServeLimit;
  while (std::chrono::steady_clock::now() < deadline && !camera_->ended()) {
    if (contents(camera_->log().string() + ".out").find("\"serving\"") != std::string::npos) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

Status Rig::end_camera() {
  camera_->signal(SIGCONT);
  camera_->signal(SIGTERM);
  const auto code = camera_->wait(kCameraEnd_s);
  read_camera();
  book_.end();
  std::error_code ignored;  // of a file that goes on for megabytes
  std::filesystem::remove(camera_->log().string() + ".out", ignored);
  camera_.reset();
  if (!code) return failed("the camera did not end within " + std::to_string(static_cast<int>(kCameraEnd_s)) + " s");
  return *code == 0 ? Status{} : failed("the camera ended with exit code " + std::to_string(*code));
}

Status Rig::start_daemon() {
  ASSIGN_OR_RETURN(auto started, Process::start({{programs_.bolod, "--config", config_of(file_)}, file("bolod")}));
  daemon_.emplace(std::move(started));
  return {};
}

Status Rig::start_readers() {
  while (readers_.size() < kReaders) {
    const std::filesystem::path log = file("reader-" + std::to_string(started_readers_++));
    ASSIGN_OR_RETURN(auto started, Process::start({{programs_.lab, "soak", "--read", file_.name}, log}));
    readers_.push_back(std::move(started));
  }
  return {};
}

Status Rig::replace_reader() {
  readers_.erase(readers_.begin());
  return start_readers();
}

void Rig::read_camera() {
  for (const std::string& line : camera_lines_->take()) {
    if (const auto account = parse_account(line)) book_.add(*account);
  }
}

std::filesystem::path config_of(const DaemonFile& file) { return file.folder / "bolod.toml"; }

Status write_daemon_file(const DaemonFile& file) {
  const std::filesystem::path profile = file.folder / "profile.toml";
  // The camera drops the frames that a shutter repeats.
  RETURN_IF_ERROR(write_file({profile, Replace::kExisting}, "[firmware]\ndrop_repeated = true\n"));
  std::string text = "name = '" + file.name + "'\nprofile = '" + profile.string() + "'\n[source]\n";
  text += "type = 'genicam'\nserial = ''\nir_format = '10mk'\nresend = true\naddress = '" + file.address + "'\n";
  text += plot::format("width = %d\nheight = %d\nrate_hz = %.1f\npacket_size = %d\n", file.geometry.width,
                       file.geometry.height, kRateHz, file.geometry.pixels() < kSmallFrame ? kSmallPacket : 0);
  // Planes are compared bit for bit, but the noise measured by lambda = "auto" depends on frames before a fault.
  text += "[deblur]\nlambda = 0.001\n[log]\nlevel = 'info'\nformat = 'text'\n";
  text += plot::format("[nuc]\npolicy = 'camera'\ninterval_s = %.1f\n", file.nuc_interval_s);
  text += plot::format("[shm]\nslots = %d\n[control]\nsocket = '%s'\n", kRingFrames, (file.folder / "control").c_str());
  return write_file({config_of(file), Replace::kExisting}, text);
}

// Reads from the end of the file, which grows for hours.
Json last_account(const std::string& file) {
  std::ifstream in(file, std::ios::ate);
  const std::streamoff size = in.tellg();
  in.seekg(std::max<std::streamoff>(0, size - kEnd));
  Json account{{"frames", 0}, {"missed", 0}, {"restarts", 0}, {"disorder", 0}};
  for (std::string line; std::getline(in, line);) {
    const Json status = Json::parse(line, nullptr, false);
    if (status.is_object()) account.update(status);
  }
  return account;
}

Status read_along(const std::string& name, const std::atomic<bool>& stop) {
  bolo_client* opened = nullptr;
  if (bolo_client_open(name.c_str(), kOpen_ms, &opened) != BOLO_CLIENT_OK) return failed(bolo_client_error(nullptr));
  const std::unique_ptr<bolo_client, Close> client(opened);
  const bolo_client_info* info = bolo_client_get_info(client.get());
  std::vector<std::uint16_t> raw(std::size_t{info->width} * info->height);
  std::vector<std::uint16_t> deblurred(raw.size());
  std::uint64_t frames = 0;
  std::uint64_t missed = 0;
  std::uint64_t restarts = 0;
  std::uint64_t disorder = 0;
  const auto report = [&] {
    const Json account{{"frames", frames}, {"missed", missed}, {"restarts", restarts}, {"disorder", disorder}};
    std::puts(account.dump().c_str());
    std::fflush(stdout);
  };
  bolo_client_frame frame{};
  std::int64_t last_publish_ns = 0;
  std::int64_t next_report_ns = monotonic_ns();
  while (!stop.load(std::memory_order_relaxed)) {
    if (monotonic_ns() >= next_report_ns) {
      report();
      next_report_ns = monotonic_ns() + kReportNs;
    }
    const int got = bolo_client_next(client.get(), kReaderPoll_ms, &frame);
    if (got == BOLO_CLIENT_RESTARTED) ++restarts;
    if (got < 0) return failed(bolo_client_error(client.get()));
    if (got != BOLO_CLIENT_OK) continue;
    missed += frame.missed;
    if (bolo_client_copy(&frame, raw.data(), deblurred.data()) != BOLO_CLIENT_OK) {
      ++missed;
      continue;
    }
    ++frames;
    if (frame.publish_ns <= last_publish_ns) ++disorder;
    last_publish_ns = frame.publish_ns;
  }
  report();
  return {};
}

}  // namespace bolo::tools::soak
