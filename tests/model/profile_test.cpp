#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "src/model/camera_profile.hpp"

namespace bolo::model::profile_test {
namespace {

const std::string kShipped = std::string(BOLO_SOURCE_DIR) + "/config/a655sc.toml";

Result<CameraProfile> read_text(const std::string& text) {
  const std::string file = testing::TempDir() + "profile-" + std::to_string(getpid()) + ".toml";
  std::ofstream(file) << text;
  auto profile = read_profile(file);
  std::remove(file.c_str());
  return profile;
}

TEST(Profile, FourNumbersSuffice) {
  const auto profile = read_text("tau_s = 0.009\nframe_period_s = 0.02\nnoise_k = 0.05\nquantisation_k = 0.1\n");
  ASSERT_TRUE(profile) << profile.error().message;
  EXPECT_DOUBLE_EQ(profile->tau_s, 0.009);
  EXPECT_DOUBLE_EQ(profile->frame_period_s, 0.02);
  EXPECT_DOUBLE_EQ(profile->noise_k, 0.05);
  EXPECT_DOUBLE_EQ(profile->quantisation_k, 0.1);
  EXPECT_EQ(profile->model, CameraProfile().model) << "the rest keeps its default";
}

TEST(Profile, IdentityAndTransportAreRead) {
  const auto profile =
      read_text("[camera]\nmodel = 'A65'\nserial = '7'\n[transport]\nbyte_order = 'big'\nmetadata_rows = 3\n");
  ASSERT_TRUE(profile) << profile.error().message;
  EXPECT_EQ(profile->model, "A65");
  EXPECT_EQ(profile->serial, "7");
  EXPECT_TRUE(profile->big_endian_pixels);
  EXPECT_EQ(profile->metadata_rows, 3);
}

TEST(Profile, MistakesAreNamed) {
  const auto message = [](const std::string& text) {
    const auto profile = read_text(text);
    return profile ? std::string() : profile.error().message;
  };
  EXPECT_NE(message("tau = 0.011").find(":1:1: unknown key 'tau'; did you mean 'tau_s'?"), std::string::npos);
  EXPECT_NE(message("tau_s = 11").find(":1:9: tau_s = 11 is out of range: 0.0001 to 1 s"), std::string::npos);
  EXPECT_NE(message("tau_s = 0").find("out of range"), std::string::npos);
  EXPECT_NE(message("[transport]\nbyte_order = 'middle'").find(":2:14: transport.byte_order = \"middle\" is none of"),
            std::string::npos);
}

TEST(Profile, TheShippedProfileIsTheDocumentedDefault) {
  std::ifstream in(kShipped);
  std::stringstream text;
  text << in.rdbuf();
  EXPECT_EQ(text.str(), document_profile(CameraProfile())) << "config/a655sc.toml is out of date";
}

TEST(Profile, TheShippedProfileReadsAsTheDefaults) {
  const auto profile = read_profile(kShipped);
  ASSERT_TRUE(profile) << profile.error().message;
  const CameraProfile expected;
  EXPECT_EQ(profile->model, expected.model);
  EXPECT_EQ(profile->serial, expected.serial);
  EXPECT_EQ(profile->tau_s, expected.tau_s);
  EXPECT_EQ(profile->frame_period_s, expected.frame_period_s);
  EXPECT_EQ(profile->noise_k, expected.noise_k);
  EXPECT_EQ(profile->quantisation_k, expected.quantisation_k);
  EXPECT_EQ(profile->big_endian_pixels, expected.big_endian_pixels);
  EXPECT_EQ(profile->metadata_rows, expected.metadata_rows);
  EXPECT_EQ(profile->undo, expected.undo);
}

TEST(Profile, WhatIsUndoneReadsBackAsItWasWritten) {
  CameraProfile profile;
  profile.maps = "maps of one camera.h5";
  profile.undo = {FrameFilter::kBox, 0.75, 0.02, 0.21, 0.04, 0.003, true, 0.96, 288.5, 311.25, 0.012, true, true};
  const auto read = read_text(document_profile(profile));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->undo, profile.undo);
  EXPECT_EQ(read->maps, std::filesystem::path(testing::TempDir()) / "maps of one camera.h5");
}

TEST(Profile, SaysWhereValuesComeFromAndWhatChanged) {
  CameraProfile profile;
  profile.tau_s = 0.011 * 1.1;  // and dust
  profile.undo.emissivity = 0.96;
  const std::string text = document_profile(profile, {{"noise_k", "measured"}});
  EXPECT_NE(text.find("default 0.011\ntau_s = 0.0121\n"), std::string::npos) << text;
  EXPECT_NE(text.find("; measured\nnoise_k = 0.03\n"), std::string::npos) << text;
  EXPECT_EQ(changes({}, profile), (std::vector<std::string>{"radiometry.emissivity = 0.96", "tau_s = 0.0121"}));
  EXPECT_TRUE(changes(profile, profile).empty());
}

TEST(Profile, ABoxThatCannotBeUndoneIsRefused) {
  const auto profile = read_text("[firmware]\nframe_filter = 'box'\nframe_filter_weight = 0.5\n");
  ASSERT_FALSE(profile);
  EXPECT_NE(profile.error().message.find(":3:23: frame_filter_weight of a box must be above 0.5"), std::string::npos)
      << profile.error().message;
  EXPECT_TRUE(read_text("[firmware]\nframe_filter = 'recursive'\nframe_filter_weight = 0.5\n"));
}

}  // namespace
}  // namespace bolo::model::profile_test
