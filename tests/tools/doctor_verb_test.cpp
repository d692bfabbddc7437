#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test::doctor_verb_test {

struct DoctorVerb : ProgramTest {
  DoctorVerb() : ProgramTest({BOLO_PROGRAM, "doctor"}) {}
};

TEST_F(DoctorVerb, SaysWhatItFoundAndEndsByIt) {
  const Outcome outcome = run({"--json", "--no-camera"});
  ASSERT_TRUE(outcome.exit_code == 0 || outcome.exit_code == 1) << outcome.err;
  const auto json = nlohmann::json::parse(outcome.out);
  EXPECT_EQ(json.at("ok").get<bool>(), outcome.exit_code == 0);
  std::set<std::string> names;
  bool problem = false;
  for (const auto& check : json.at("checks")) {
    names.insert(check.at("name").get<std::string>());
    EXPECT_FALSE(check.at("found").get<std::string>().empty()) << check;
    problem |= check.at("verdict") == "problem";
    EXPECT_TRUE(check.at("verdict") != "problem" || check.at("fix").is_string()) << check;
  }
  EXPECT_EQ(problem, outcome.exit_code == 1);
  for (const char* name : {"receive_buffer", "mtu", "firewall", "interfaces", "realtime", "governor", "isolation",
                           "shared_memory", "v4l2loopback", "hdf5", "aravis", "camera", "clock"}) {
    EXPECT_EQ(names.count(name), 1U) << name;
  }
}

TEST_F(DoctorVerb, ASilentAddressIsAProblem) {
  expect_parts(ended(1, {"--address", "127.231.4.9"}), {"127.231.4.9 does not answer", "ping 127.231.4.9"});
}

TEST_F(DoctorVerb, ReadsTheConfiguration) {
  const std::string config = write("bolod.toml", "[shm]\nslots = 60000\n[pipeline]\ncpus = [4000]\n");
  expect_parts(ended(1, {"--no-camera", "--config", config}),
               {"names CPU 4000", "17585.5 MiB needed"});  // 60000 slots of two planes
}

TEST_F(DoctorVerb, LooksAtTheVideoDevicesOfTheConfiguration) {
  const std::string camera = write("camera.toml", "[source]\ntype = \"v4l2\"\ndevice = \"/dev/video4321\"\n");
  expect_parts(ended(1, {"--config", camera}), {"/dev/video4321: it is not there: plug the camera in"});
  const std::string sink = write("sink.toml", "[v4l2]\nenable = true\n");
  const auto json = nlohmann::json::parse(run({"--json", "--no-camera", "--config", sink}).out);
  for (const auto& check : json.at("checks")) {
    EXPECT_TRUE(check.at("name") != "v4l2loopback" || check.at("verdict") != "advice") << "bolod refuses without";
  }
}

TEST_F(DoctorVerb, AWrongConfigurationIsOneLineAndExitCode2) {
  refused({"--config", write("bolod.toml", "[shm]\nslotz = 1\n")});
}

}  // namespace bolo::tools::test::doctor_verb_test
