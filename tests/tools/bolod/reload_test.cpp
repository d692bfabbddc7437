// Which keys a running daemon takes up, told from two readings of its file.
#include "tools/bolod/reload.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/scratch.hpp"

namespace bolo::daemon::reload_test {
namespace {

using Keys = std::vector<std::string>;

class Reload : public testing::Test {
 protected:
  DaemonConfig read(const std::string& text) const {
    std::ofstream(folder_ / "bolod.toml") << text;
    auto config = read_config(folder_ / "bolod.toml");
    EXPECT_TRUE(config) << config.error().message;
    return config.value_or(DaemonConfig());
  }

  Scratch folder_;
};

TEST_F(Reload, TellsLiveKeysFromOthers) {
  const ConfigChange change = compare(read(""), read("[source]\nwidth = 320\n[deblur]\nlambda = 0.5\n[log]\n"
                                                     "level = 'debug'\n[nuc]\nhold_ms = 300\npolicy = 'timed'\n"
                                                     "[v4l2]\nplane = 'raw'\n[v4l2_second]\nlow_k = 200\n"));
  EXPECT_EQ(change.live, (Keys{"log.level", "nuc.hold_ms", "nuc.policy", "v4l2_second.low_k"}));
  EXPECT_EQ(change.restart, (Keys{"deblur.lambda", "source.width", "v4l2.plane"}));
}

TEST_F(Reload, SeesNoChangeInOtherWords) {
  const ConfigChange change =
      compare(read("[nuc]\ninterval_s = 60\n[source]\nwidth = 640\n"), read("[nuc]\ninterval_s = 60.0\n"));
  EXPECT_EQ(change.live, Keys{});
  EXPECT_EQ(change.restart, Keys{}) << key_list(change.restart);
}

TEST_F(Reload, SeesAKeyWithoutDefaultComeAndGo) {
  EXPECT_EQ(compare(read(""), read("[source]\nrate_hz = 200.0\n")).restart, Keys{"source.rate_hz"});
  EXPECT_EQ(compare(read("[source]\npixel_order = 'big'\n"), read("")).restart, Keys{"source.pixel_order"});
  EXPECT_EQ(compare(read("[source]\npixel_order = 'big'\n"), read("[source]\npixel_order = 'little'\n")).restart,
            Keys{"source.pixel_order"});
}

TEST_F(Reload, SeesAnotherContentOfTheProfile) {
  const std::string text = "profile = 'camera.toml'\n";
  std::ofstream(folder_ / "camera.toml") << "tau_s = 0.011\n";
  const DaemonConfig before = read(text);
  EXPECT_EQ(compare(before, read(text)).restart, Keys{});
  std::ofstream(folder_ / "camera.toml") << "tau_s = 0.012\n";
  EXPECT_EQ(compare(before, read(text)).restart, Keys{"what the profile says"});
}

TEST_F(Reload, EveryLiveKeyExists) {
  const DaemonConfig config = read("");
  for (const std::string& key : live_keys(config)) EXPECT_TRUE(config.texts.contains(key)) << key;
}

}  // namespace
}  // namespace bolo::daemon::reload_test
