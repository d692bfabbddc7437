#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cstdlib>

#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tools/doctor/checks.hpp"

namespace {
int g_looks_at_files = 0;  // calls of stat for open files that are no terminals
}  // namespace

extern "C" {
int stat(const char* path, struct stat* about) {
  const std::string name = path;
  std::error_code none;
  g_looks_at_files += name.starts_with("/proc/") && std::filesystem::read_symlink(name, none).extension() == ".h5";
  return fstatat(AT_FDCWD, path, about, 0);
}

// Like a tmpfs without a limit.
int statvfs(const char*, struct statvfs* about) {
  *about = {};
  return 0;
}
}

namespace bolo::tools::doctor::doctor_test {

// A vehicle computer without findings.
Facts good_host() {
  Facts facts;
  facts.receive_buffer_max = 16 << 20;
  facts.backlog = 1000;
  facts.interfaces = {{"lo", "127.0.0.1", 8, 65536, true, true}, {"eth1", "192.168.7.1", 24, 9000, false, true}};
  facts.route_interface = "eth1";
  facts.reverse_path_strict = false;
  facts.processors = facts.configured_cpus = 4;
  facts.governors = {"performance", "performance"};
  facts.priority_limit = 99;
  facts.memlock_limit = ~std::uint64_t{0};
  facts.shared_free = std::uint64_t{1} << 30;
  facts.loopback_module = true;
  facts.videos = {{"/dev/video10", "v4l2 loopback"}};
  facts.aravis = "0.8.26";
  facts.hdf5 = "1.10.8";
  facts.cameras = {{"FLIR-1", "A655sc", "1", "192.168.7.2"}};
  facts.answers = true;
  facts.clock = ClockState{true, 800'000};
  return facts;
}

Needs live_needs() {
  Needs needs;
  needs.realtime_priority = 20;
  needs.shared_bytes = 20 << 20;
  needs.address = "192.168.7.2";
  needs.video = true;
  return needs;
}

Check check_of(const std::vector<Check>& checks, const std::string& name) {
  const auto at = std::ranges::find(checks, name, &Check::name);
  EXPECT_NE(at, checks.end()) << name;
  return at != checks.end() ? *at : Check{};
}

TEST(Doctor, HasNothingToSayOfAGoodHost) {
  for (const Check& check : judge(good_host(), live_needs())) {
    EXPECT_EQ(check.verdict, Verdict::kGood) << check.name << ": " << check.found;
    EXPECT_TRUE(check.fix.empty()) << check.fix;
    EXPECT_FALSE(check.found.empty()) << check.name;
  }
}

void add_network(Facts& facts) { facts.interfaces.push_back({"wlan0", "10.0.0.9", 8, 1500, false, true}); }

TEST(Doctor, NamesAFaultWithItsFix) {
  using enum Verdict;
  struct Fault {
    const char* check;
    Verdict verdict;
    const char* fix;  // part of it
    void (*make)(Facts&, Needs&);
  };
  const std::vector<Fault> faults{
      {"receive_buffer", kProblem, "net.core.rmem_max=8388608",
       [](Facts& f, Needs&) { f.receive_buffer_max = 212'992; }},
      {"receive_buffer", kAdvice, "rmem_max", [](Facts& f, Needs&) { f.receive_buffer_max = 6 << 20; }},
      {"backlog", kAdvice, "netdev_max_backlog", [](Facts& f, Needs&) { f.backlog = 300; }},
      {"mtu", kAdvice, "eth1 mtu 9000", [](Facts& f, Needs&) { f.interfaces[1].mtu = 1500; }},
      {"mtu", kProblem, "mtu 8192",
       [](Facts& f, Needs& n) {
         f.interfaces[1].mtu = 1500;
         n.packet_bytes = 8192;
       }},
      {"interfaces", kProblem, "eth1 and wlan0",
       [](Facts& f, Needs&) {
         f.interfaces.push_back({"wlan0", "192.168.7.9", 16, 1500, false, true});
       }},
      {"interfaces", kGood, "by its IP address", [](Facts& f, Needs&) { add_network(f); }},
      {"firewall", kAdvice, "ufw allow in on eth1", [](Facts& f, Needs&) { f.firewalls = {"ufw"}; }},
      {"reverse_path", kAdvice, "rp_filter=2",
       [](Facts& f, Needs&) {
         f.reverse_path_strict = true;
         add_network(f);
       }},
      {"realtime", kProblem, "LimitRTPRIO=20", [](Facts& f, Needs&) { f.priority_limit = 0; }},
      {"locked_memory", kAdvice, "LimitMEMLOCK", [](Facts& f, Needs&) { f.memlock_limit = 8 << 20; }},
      {"governor", kAdvice, "performance", [](Facts& f, Needs&) { f.governors.front() = "powersave"; }},
      {"isolation", kProblem, "names CPU 4",
       [](Facts&, Needs& n) {
         n.cpus = {1, 4};
       }},
      {"isolation", kAdvice, "pipeline.cpus = [2, 3]",
       [](Facts& f, Needs&) {
         f.isolated = {2, 3};
       }},
      {"shared_memory", kProblem, "--shm-size", [](Facts& f, Needs&) { f.shared_free = 10 << 20; }},
      {"shared_memory", kGood, "", [](Facts& f, Needs&) { f.shared_free = kNoLimit; }},
      {"shared_memory", kProblem, "mount -t tmpfs", [](Facts& f, Needs&) { f.shared_free.reset(); }},
      {"v4l2loopback", kProblem, "v4l2loopback-dkms",
       [](Facts& f, Needs&) {
         f.loopback_module = false;
         f.videos = {{"/dev/video0", "uvcvideo"}};
       }},
      {"v4l2loopback", kProblem, "modprobe -r", [](Facts& f, Needs&) { f.videos.clear(); }},
      {"usb", kAdvice, "udev rule",
       [](Facts& f, Needs&) {
         f.usb = {{"09cb:1996", "A655sc", "/dev/bus/usb/001/004", false}};
       }},
      {"aravis", kProblem, "0.8.26", [](Facts& f, Needs&) { f.aravis = "0.8.6"; }},
      {"camera", kProblem, "ping 192.168.7.2", [](Facts& f, Needs&) { f.answers = false; }},
      {"camera", kAdvice, "bolo fakecam",
       [](Facts& f, Needs& n) {
         f.cameras.clear();
         f.answers.reset();
         n.address.clear();
       }},
      {"camera", kProblem, "plug the camera in", [](Facts& f, Needs&) { f.device = bad_input("plug the camera in"); }},
      {"camera", kGood, "", [](Facts& f, Needs&) { f.device = "Boson"; }},
      {"mtu", kGood, "",
       [](Facts& f, Needs&) {
         f.device = "Boson";
         f.route_interface.reset();
       }},
      {"clock", kAdvice, "chrony", [](Facts& f, Needs&) { f.clock = ClockState{}; }},
  };
  for (const Fault& fault : faults) {
    SCOPED_TRACE(std::string(fault.check) + ": " + fault.fix);
    Facts facts = good_host();
    Needs needs = live_needs();
    fault.make(facts, needs);
    for (const Check& check : judge(facts, needs)) {
      if (check.name != fault.check) {
        EXPECT_NE(check.verdict, kProblem) << check.name << ": " << check.found;
        continue;
      }
      EXPECT_EQ(check.verdict, fault.verdict) << check.found;
      expect_parts(check.fix, {fault.fix});
    }
  }
}

TEST(Doctor, SaysWhoKeepsTheClockAndHowWell) {
  // Output of chronyd 4.3 and ptp4l 3.1.
  const std::string tracking =
      "C0A80701,ntp.example,2,1763926262.123456789,-0.000012345,0.000001,0.000020,-4.512,0.001,0.021,0.000412,0.000310,"
      "64.2,Normal\n";
  EXPECT_EQ(describe_chrony(tracking), "chrony follows ntp.example (stratum 2), 0.0123 ms away");
  EXPECT_EQ(describe_chrony("00000000,,0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised\n"),
            "chrony runs, but follows nothing yet");
  EXPECT_EQ(describe_chrony("506 Cannot talk to daemon\n"), "");
  EXPECT_EQ(describe_chrony(""), "");
  const std::string ptp =
      "sending: GET TIME_STATUS_NP\n\taa.bb-0 seq 0 RESPONSE MANAGEMENT TIME_STATUS_NP\n\t\tmaster_offset  -37\n"
      "\t\tgmPresent   true\n";
  EXPECT_EQ(describe_ptp(ptp), "ptp4l follows a grandmaster, -37 ns away");
  EXPECT_EQ(describe_ptp("\t\tmaster_offset 0\n\t\tgmPresent false\n"), "ptp4l runs, but follows no grandmaster");
  EXPECT_EQ(describe_ptp("sending: GET TIME_STATUS_NP\n"), "");

  Facts facts = good_host();
  facts.time_services = {describe_chrony(tracking)};
  EXPECT_EQ(check_of(judge(facts, live_needs()), "clock").found,
            "the clock is synchronised, to 0.8 ms; chrony follows ntp.example (stratum 2), 0.0123 ms away");
  facts.clock = ClockState{};
  const Check unsynchronised = check_of(judge(facts, live_needs()), "clock");
  EXPECT_EQ(unsynchronised.verdict, Verdict::kAdvice);
  expect_parts(unsynchronised.fix, {"rtcsync"});  // chrony keeps time, but has not told the kernel
}

TEST(Doctor, WhatCannotBeLookedAtIsUnknown) {
  Facts facts = good_host();
  facts.receive_buffer_max.reset();
  facts.route_interface.reset();
  facts.clock.reset();
  const auto checks = judge(facts, live_needs());
  for (const char* name : {"receive_buffer", "mtu", "clock"}) {
    EXPECT_EQ(check_of(checks, name).verdict, Verdict::kUnknown) << name;
  }
}

TEST(Doctor, NamesTheProcessThatHasAVideoDevice) {
  const Scratch scratch;
  const std::ofstream on_a_disk_that_hangs(scratch / "open.h5");  // must not be inspected
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY);
  ASSERT_EQ(grantpt(terminal) + unlockpt(terminal), 0);
  const std::string device = ptsname(terminal);
  const Error refused{ErrorKind::kBadInput, device + ": another program uses it"};
  EXPECT_EQ(used_by(refused, "no-such-daemon").error().message, refused.message);
  const int side = open(device.c_str(), O_RDWR | O_NOCTTY);
  const std::string process = device + ": process " + std::to_string(getpid());
  EXPECT_EQ(used_by(refused, "").error().message, process + " (doctor_test) uses it: end that program");
  prctl(PR_SET_NAME, "bolod");
  EXPECT_EQ(used_by(refused, "").value_or(""), process + " (bolod) uses it");
  prctl(PR_SET_NAME, "doctor_test");
  EXPECT_EQ(g_looks_at_files, 0);
  close(side);
  close(terminal);
}

// A fake host made of files.
class Host : public ScratchTest {
 protected:
  void write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name) << text << "\n";
  }
  const std::filesystem::path root_ = scratch_.path();
};

TEST_F(Host, IsReadFromTheKernelsFiles) {
  write("proc/sys/net/core/rmem_max", "212992");
  write("proc/sys/net/core/netdev_max_backlog", "1000");
  write("proc/sys/net/ipv4/conf/all/rp_filter", "1");
  write("proc/modules", "snd 1 0\nv4l2loopback 49152 0 - Live 0x0");
  write("etc/ufw/ufw.conf", "LOGLEVEL=low\nENABLED=yes");
  write("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave");
  write("sys/devices/system/cpu/isolated", "2-3,7");
  write("sys/bus/usb/devices/1-2/idVendor", "09cb");
  write("sys/bus/usb/devices/1-2/idProduct", "1996");
  write("sys/bus/usb/devices/1-2/busnum", "1");
  write("sys/bus/usb/devices/1-2/devnum", "4");
  write("sys/bus/usb/devices/1-3/idVendor", "1d6b");
  write("sys/class/video4linux/video10/name", "bolo");
  std::filesystem::create_directories(root_ / "dev/shm");
  const Facts facts = gather({}, root_);
  EXPECT_EQ(facts.receive_buffer_max, 212'992);
  EXPECT_EQ(facts.backlog, 1000);
  EXPECT_EQ(facts.reverse_path_strict, true);
  EXPECT_TRUE(facts.loopback_module);
  EXPECT_EQ(facts.firewalls, std::vector<std::string>{"ufw"});
  EXPECT_EQ(facts.governors, std::vector<std::string>{"powersave"});
  EXPECT_EQ(facts.isolated, (std::vector<int>{2, 3, 7}));
  ASSERT_EQ(facts.usb.size(), 1U);
  EXPECT_EQ(facts.usb[0].id, "09cb:1996");
  EXPECT_EQ(facts.usb[0].node, "/dev/bus/usb/001/004");
  EXPECT_FALSE(facts.usb[0].writable);
  ASSERT_EQ(facts.videos.size(), 1U);
  EXPECT_EQ(facts.videos[0].path, "/dev/video10");
  EXPECT_TRUE(facts.videos[0].driver.empty());
  EXPECT_EQ(facts.shared_free, kNoLimit);
  EXPECT_GE(facts.processors, 1);
  EXPECT_FALSE(facts.hdf5.empty());
  EXPECT_FALSE(facts.aravis.empty());
}

}  // namespace bolo::tools::doctor::doctor_test
