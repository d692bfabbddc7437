#include "src/pipeline/input_check.hpp"

#include "tests/pipeline/fakes.hpp"
#include "tests/test.hpp"

namespace bolo::pipeline::test {
namespace {

std::size_t told(const Script& script, const PipelineOptions& options, std::string_view what) {
  MemorySink sink;
  std::size_t count = 0;
  const auto pipeline = *must(Pipeline::create(std::make_unique<ScriptedSource>(script), {&sink}, options));
  std::atomic<bool> stop{false};
  EXPECT_TRUE(pipeline->run(stop));
  for (int i = 0; i < 2; ++i) {
    for (const Notice& notice : pipeline->take_notices()) {
      if (notice.text.find(what) == std::string::npos) continue;
      EXPECT_TRUE(notice.warning);
      EXPECT_EQ(notice.event, event::kSettingsDoubted);
      ++count;
    }
  }
  return count;
}

// Counts of 10 mK with noise of 0.5 K.
void fill_noise(rt::FrameSlot& slot, const StreamFormat& format) {
  std::mt19937 random(static_cast<unsigned>(slot.meta.frame_id));
  std::normal_distribution<double> noise(0.0, 50.0);
  for (std::size_t i = 0; i < format.geometry.pixels(); ++i) {
    slot.u16()[i] = static_cast<std::uint16_t>(30'000.0 + noise(random));
  }
}

TEST(InputCheck, NoiseThatTheFramesDoNotShowIsToldOnce) {
  Script script{.info = small_source(96, 48), .frames = run_of(0, 80), .fill = fill_noise};
  const auto lines = [&](deblur::Method method, double noise_k, double tau_s) {
    deblur::Settings settings{.method = method, .tau_s = tau_s, .noise_k = noise_k};
    settings.auto_lambda = true;
    return told(script, {.deblur = settings}, " is told, ");
  };
  for (const double noise_k : {0.0, 0.15, 0.3, 0.9, 1.5}) {
    const bool small = noise_k == 0.15;
    const bool large = noise_k == 1.5;
    EXPECT_EQ(lines(deblur::Method::kMmae, noise_k, 0.011), small || large ? 1U : 0U) << noise_k;
    // A period of 0.8 of it: what moves looks like noise.
    EXPECT_EQ(lines(deblur::Method::kMmae, noise_k, 0.006), large ? 1U : 0U) << noise_k;
  }
  for (const auto method : {deblur::Method::kMotion, deblur::Method::kAdmm}) EXPECT_EQ(lines(method, 0.15, 0.011), 1U);
}

TEST(InputCheck, FramesThatComeTwiceAreToldButNotAShutter) {
  Script script{.frames = run_of(0, 80)};
  EXPECT_EQ(told(script, {}, "twice"), 0U);
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    for (std::size_t i = 0; i < format.geometry.pixels(); ++i) {
      slot.u16()[i] = static_cast<std::uint16_t>(30'000U + slot.meta.frame_id / 2 + i);
    }
  };
  EXPECT_EQ(told(script, {}, "twice"), 1U);
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    for (std::size_t i = 0; i < format.geometry.pixels(); ++i) {
      slot.u16()[i] = static_cast<std::uint16_t>(30'000U + slot.meta.frame_id * 3 / 20 + i);
    }
  };
  EXPECT_EQ(told(script, {}, "twice"), 1U) << "9 Hz read at 60";
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    const std::uint64_t shown =
        slot.meta.frame_id < 30 ? slot.meta.frame_id : std::max<std::uint64_t>(slot.meta.frame_id, 70);
    for (std::size_t i = 0; i < format.geometry.pixels(); ++i) {
      slot.u16()[i] = static_cast<std::uint16_t>(30'000U + shown + i);
    }
  };
  EXPECT_EQ(told(script, {}, "twice"), 0U);
}

}  // namespace
}  // namespace bolo::pipeline::test
