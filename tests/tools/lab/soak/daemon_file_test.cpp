// The soak's daemon: a user's keys stay, those that the soak must decide do not.
#include <gtest/gtest.h>

#include <fstream>

#include "tests/scratch.hpp"
#include "tools/bolod/config.hpp"
#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak::daemon_file_test {
namespace {

class SoakDaemonFile : public testing::Test {
 protected:
  DaemonFile file(const std::string& base = "") const {
    DaemonFile file;
    if (!base.empty()) {
      file.base = folder_ / "base.toml";
      std::ofstream(file.base) << base;
    }
    file.folder = folder_.path();
    file.name = "soak-test";
    file.address = "127.1.2.3";
    file.geometry = {64, 24};
    return file;
  }
  Scratch folder_;
};

TEST_F(SoakDaemonFile, IsRightWithoutABase) {
  ASSERT_TRUE(write_daemon_file(file()));
  const auto config = daemon::read_config(config_of(file()));
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->name, "soak-test");
  EXPECT_EQ(config->camera.address, "127.1.2.3");
  EXPECT_EQ(config->camera.width, 64);
  EXPECT_TRUE(config->camera.resend);
  EXPECT_TRUE(config->pipeline.undo.drop_repeated);
}

TEST_F(SoakDaemonFile, KeepsAUsersKeysAndProfile) {
  std::ofstream(folder_ / "mine.toml") << "tau_s = 0.009\nframe_period_s = 0.005\nnoise_k = 0.03\n"
                                          "quantisation_k = 0.01\n";
  const DaemonFile with_base = file(
      "name = 'front'\nprofile = 'mine.toml'\n[source]\naddress = '192.168.2.5'\nbuffers = 50\n"
      "[deblur]\nsolver = 'dual'\n[v4l2]\nenable = true\n[metrics]\nenable = true\n");
  ASSERT_TRUE(write_daemon_file(with_base));
  const auto config = daemon::read_config(config_of(with_base));
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_EQ(config->name, "soak-test");
  EXPECT_EQ(config->camera.address, "127.1.2.3");
  EXPECT_EQ(config->camera.buffers, 50);
  EXPECT_EQ(config->pipeline.deblur.method, deblur::Method::kDual);
  EXPECT_DOUBLE_EQ(config->pipeline.deblur.tau_s, 0.009);
  EXPECT_TRUE(config->pipeline.undo.drop_repeated);
  EXPECT_EQ(config->sinks[1]->make({}), nullptr) << "V4L2, behind shared memory";
  EXPECT_FALSE(config->metrics.enabled);
}

TEST_F(SoakDaemonFile, NamesABaseThatCannotBeRead) {
  DaemonFile absent = file();
  absent.base = folder_ / "no.toml";
  const Status refused = write_daemon_file(absent);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(refused.error().message.find("no.toml"), std::string::npos);
  EXPECT_FALSE(write_daemon_file(file("name = = 3\n")));
}

}  // namespace
}  // namespace bolo::tools::soak::daemon_file_test
