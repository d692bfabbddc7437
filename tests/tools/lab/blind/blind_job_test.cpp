#include "tools/lab/blind/blind_job.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/scratch.hpp"
#include "tools/lab/blind/nonce.hpp"

namespace bolo::tools::blind {
namespace {

namespace fs = std::filesystem;

BlindRequest request_in(const fs::path& job) {
  BlindRequest request;
  request.kinds = {Kind::kSingle, Kind::kWithheld};
  request.count = 2;
  for (const Kind kind : request.kinds) {
    for (std::size_t i = 0; i < 2; ++i) request.sessions.push_back(draw_session(request.draw, kind, i).value());
  }
  request.sharing.job = job;
  return request;
}

void quiet(const Seal&) {}

// Of an open job with these words, what keeps it from being made ready.
std::string refusal(const BlindRequest& request) {
  BlindJob job(request, quiet);
  const auto decision = job.decide({});
  if (!decision) return decision.error().message;
  const auto work = job.prepare(*decision, 1);
  return work ? "" : work.error().message;
}

TEST(BlindJob, PublishesOneSealBeforeAnyWork) {
  const Scratch folder;
  const BlindRequest request = request_in(folder / "job");
  std::string published;
  BlindJob job(request, [&](const Seal& seal) { published += seal.digest(); });
  const auto decision = job.decide({});
  ASSERT_TRUE(decision) << decision.error().message;
  EXPECT_EQ(published, "");
  const auto work = job.prepare(*decision, 1);
  ASSERT_TRUE(work) << work.error().message;
  EXPECT_EQ(published, job.seal().digest());
  EXPECT_EQ(cluster::JobFolder::plan_in(folder / "job")->at("sealed_sha256"), published);
  ASSERT_EQ((*work)->pieces().size(), 4U);
  EXPECT_EQ((*work)->pieces()[1].name, "single-00001");
  EXPECT_EQ((*work)->pieces()[2].name, "withheld-00000");
  EXPECT_NE((*work)->pieces()[1].group, (*work)->pieces()[0].group);
  EXPECT_TRUE(job.finish().empty());

  // One that only takes part has the same seal, and does not publish it.
  BlindJob other(request, [&](const Seal&) { published.clear(); });
  ASSERT_TRUE(other.prepare(*decision, 1));
  EXPECT_EQ(other.seal().digest(), published);
}

TEST(BlindJob, ARankThatSeesAnotherFolderIsRefused) {
  const Scratch folder;
  const BlindRequest request = request_in(folder / "job");
  BlindJob job(request, quiet);
  const auto decision = job.decide({});
  ASSERT_TRUE(decision);
  for (const bool used : {false, true}) {
    const BlindRequest elsewhere = request_in(folder / (used ? "used" : "empty"));
    if (used) {
      ASSERT_EQ(refusal(elsewhere), "");
    }
    BlindJob rank(elsewhere, quiet);
    const auto work = rank.prepare(*decision, 1);
    ASSERT_FALSE(work);
    EXPECT_EQ(work.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(work.error().message.find("not the folder of rank 0"), std::string::npos) << work.error().message;
  }
  EXPECT_FALSE(fs::exists(folder / "empty/nonce")) << "only who decides makes a nonce";
}

TEST(BlindJob, AnotherCheckIsRefusedWithWhatDiffers) {
  const Scratch folder;
  const BlindRequest request = request_in(folder / "job");
  ASSERT_EQ(refusal(request), "");
  ASSERT_EQ(refusal(request), "");
  const auto differs = [&](const char* name, auto change) {
    BlindRequest other = request_in(folder / "job");
    change(other);
    EXPECT_NE(refusal(other).find(name), std::string::npos) << refusal(other);
  };
  differs("/draw/seed is 1 there and 2 now", [](BlindRequest& r) {
    r.draw.seed = 2;
    for (Session& s : r.sessions) s = draw_session(r.draw, s.kind, s.index).value();
  });
  differs("/draw/magnitude is 1.0 there and 0.5 now", [](BlindRequest& r) { r.draw.magnitude = 0.5; });
  differs("/draw/imperfect", [](BlindRequest& r) { r.draw.imperfect = true; });
  differs("/draw/width", [](BlindRequest& r) { r.draw.geometry.width = 64; });
  differs("/draw/height", [](BlindRequest& r) { r.draw.geometry.height = 64; });
  differs("/draw/frames_scale", [](BlindRequest& r) { r.draw.frames_scale = 0.5; });
  differs("/draw/only", [](BlindRequest& r) { r.draw.only = "iir"; });
  differs("/draw/kinds/1", [](BlindRequest& r) { r.kinds[1] = Kind::kPair; });
  differs("/draw/first", [](BlindRequest& r) { r.first = 7; });
  differs("/draw/sessions", [](BlindRequest& r) { r.count = 3; });
  differs("/sealed_sha256", [](BlindRequest& r) { r.sessions.pop_back(); });
}

TEST(BlindJob, WithoutItsNonceASealCannotBeOpened) {
  const Scratch folder;
  const BlindRequest request = request_in(folder / "job");
  ASSERT_EQ(refusal(request), "");
  fs::remove(nonce_file(folder / "job"));
  EXPECT_NE(refusal(request).find("nonce: is missing"), std::string::npos) << refusal(request);
  EXPECT_FALSE(fs::exists(nonce_file(folder / "job"))) << "another one would not do";
  BlindRequest other = request_in(folder / "job");
  other.draw.seed = 5;
  EXPECT_NE(refusal(other).find("/draw/seed"), std::string::npos) << refusal(other);
}

TEST(BlindJob, AFolderOfOtherWorkIsLeftAsItIs) {
  const Scratch folder;
  ASSERT_TRUE(cluster::JobFolder::open(folder / "job", {{"bolo_job", 1}, {"verb", "deblur"}}));
  EXPECT_NE(refusal(request_in(folder / "job")).find("belongs to other work"), std::string::npos);
  EXPECT_FALSE(fs::exists(nonce_file(folder / "job")));
}

}  // namespace
}  // namespace bolo::tools::blind
