#include "tools/lab/blind/blind.hpp"

#include <gtest/gtest.h>

namespace bolo::tools::blind::seal_test {
namespace {

std::vector<Session> two_sessions() {
  return {draw_session({}, Kind::kSingle, 0).value(), draw_session({}, Kind::kPair, 1).value()};
}

TEST(BlindSeal, DigestsAsTheStandardSays) {  // FIPS 180-4, examples of NIST
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(BlindSeal, OpensForTheSameAnswers) {
  const auto sessions = two_sessions();
  const auto seal = Seal::close(sessions);
  ASSERT_TRUE(seal);
  const auto opened = seal->open(two_sessions());
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(sha256(opened->answers + opened->nonce), seal->digest());
  EXPECT_EQ(opened->nonce.size(), 64U);
  EXPECT_EQ(nlohmann::json::parse(opened->answers).at(1).at("kind"), "pair");
}

TEST(BlindSeal, RefusesAnswersThatWereChanged) {
  auto sessions = two_sessions();
  const auto seal = Seal::close(sessions);
  ASSERT_TRUE(seal);
  auto& values = sessions[0].effects.at(0).values;
  ASSERT_FALSE(values.empty());
  values.begin()->second *= 1.0 + 1e-12;
  EXPECT_FALSE(seal->open(sessions));
  sessions = two_sessions();
  sessions.pop_back();
  EXPECT_FALSE(seal->open(sessions));
}

TEST(BlindSeal, TheSameAnswersHaveAnotherDigestEachTime) {
  const auto sessions = two_sessions();
  EXPECT_NE(Seal::close(sessions)->digest(), Seal::close(sessions)->digest());
}

}  // namespace
}  // namespace bolo::tools::blind::seal_test
