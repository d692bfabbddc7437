// Lost packets at full size: what is counted, and that asking again brings them back.
#include <gtest/gtest.h>

#include "tools/lab/eval/faults.hpp"

namespace bolo::tools::faults {
namespace {

constexpr double kSeconds = 0.5;
constexpr int kTries = 10;  // a busy computer drops packets by itself

class LossTrial : public testing::Test {
 protected:
  static const Result<Recording>& scene() {
    static const Result<Recording> kScene = loss_scene(kSeconds);
    return kScene;
  }
  // The work on the pixels is another test's: few iterations, so that a busy machine keeps up.
  static Json row(double rate, bool resend) {
    EXPECT_TRUE(scene().has_value()) << scene().error().message;
    pipeline::PipelineOptions options;
    options.deblur.method = deblur::Method::kInverse;
    for (int i = 0; i < kTries; ++i) {
      const auto row = try_loss({rate, resend, 9000, kSeconds}, *scene(), options);
      EXPECT_TRUE(row.has_value()) << row.error().message;
      if (!row || row->at("host_dropped_packets") == 0) return row.value_or(Json());
    }
    ADD_FAILURE() << "this computer dropped packets by itself, " << kTries << " times";
    return {};
  }
};

TEST_F(LossTrial, EachFrameThatIsHitIsLostOnce) {
  const Json lossy = row(0.02, false);
  EXPECT_GT(lossy.at("frames_hit"), 10U);
  EXPECT_EQ(lossy.at("frames_lost").at("network"), lossy.at("frames_hit"));
  EXPECT_LT(lossy.at("rmse_deblurred_k"), lossy.at("rmse_raw_k"));
}

TEST_F(LossTrial, AskingAgainBringsMostOfThemBack) {
  const Json lossy = row(0.02, true);
  EXPECT_GT(lossy.at("frames_hit"), 10U);
  EXPECT_LT(lossy.at("frames_lost").at("network").get<int>(), lossy.at("frames_hit").get<int>() / 2);
}

}  // namespace
}  // namespace bolo::tools::faults
