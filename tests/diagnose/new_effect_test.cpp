// One file in each of two folders adds an effect. example/ has the two files shown in CONTRIBUTING.md; this program's
// catalogues are generated from the real folders and these files by the layers' templates.
#include "src/diagnose/effect.hpp"
#include "src/diagnose/report.hpp"
#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::new_effect_test {

constexpr const char* kNew = "column_droop";

TEST(NewEffect, IsInBothLists) {
  ASSERT_NE(sim::find_effect(kNew), nullptr);
  ASSERT_NE(find_effect(kNew), nullptr);
  EXPECT_EQ(find_effect(kNew)->stage, sim::name_of(sim::find_effect(kNew)->stage));
  EXPECT_NE(find_effect("tau_global"), nullptr) << "those of the catalogue are still there";
}

std::string text_of(const std::string& file) {
  std::ifstream in(std::string(BOLO_SOURCE_DIR) + "/" + file);
  std::string text;
  for (std::string line; std::getline(in, line);) {
    text += line.substr(std::min(line.size(), line.find_first_not_of(' '))) + "\n";
  }
  return text;
}

TEST(NewEffect, IsTheOneThatContributingShows) {
  const std::string page = text_of("CONTRIBUTING.md");
  for (const char* folder : {"sim", "diagnose"}) {
    const std::string code = text_of("tests/diagnose/example/" + std::string(folder) + "/column_droop.cpp");
    ASSERT_FALSE(code.empty());
    EXPECT_NE(page.find(code), std::string::npos) << "CONTRIBUTING.md differs from example/" << folder;
  }
}

TEST(NewEffect, IsSimulatedAndDiagnosed) {
  sim::CameraSettings camera = testing::noisy_camera();
  camera.effects.push_back(*must(sim::parse_effect("column_droop:droop_k=0.06")));
  const Scratch scratch;
  std::vector<std::filesystem::path> files;
  const std::vector<capture::Stimulus> stimuli{capture::Uniform{300.0}, capture::Uniform{325.0}, testing::odd_chopper(),
                                               testing::slanted_bars(70.0)};
  for (const capture::Stimulus& stimulus : stimuli) {
    const auto file = scratch / ("capture-" + std::to_string(files.size()) + ".h5");
    camera.readout.seed = files.size() + 1;
    files.push_back(testing::write(testing::record(camera, stimulus, 240), file));
  }
  const Report report = testing::diagnosed(files);
  ASSERT_EQ(testing::told(report), "explained: column_droop") << report.unexplained.where;
  EXPECT_NEAR(report.effects.front().parameters.at("droop_k").value, 0.06, 0.004);
  EXPECT_LT(report.gap.after, 1.05);
  EXPECT_NE(report_json(report).find(kNew), std::string::npos);
  EXPECT_NE(report_html(report).find("The offset falls towards the right"), std::string::npos) << "its words";
}

}  // namespace bolo::diagnose::new_effect_test
