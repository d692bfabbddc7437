#include "tools/lab/blind/nonce.hpp"

#include <gtest/gtest.h>

#include <sys/stat.h>

#include <fstream>

#include "tests/scratch.hpp"
#include "tools/cluster/digest.hpp"
#include "tools/lab/blind/seal.hpp"

namespace bolo::tools::blind {
namespace {

namespace fs = std::filesystem;

TEST(BlindNonce, IsKeptWhereOnlyItsUserReads) {
  const Scratch folder;
  const fs::path job = folder / "deep/job";
  const auto none = kept_nonce(job);
  ASSERT_TRUE(none);
  EXPECT_FALSE(*none);
  const mode_t before = umask(0);
  const auto nonce = keep_nonce(job);
  umask(before);
  ASSERT_TRUE(nonce) << nonce.error().message;
  EXPECT_EQ(nonce->size(), 64U);
  struct stat facts {};
  ASSERT_EQ(stat(nonce_file(job).c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777U, 0600U);
  EXPECT_EQ(kept_nonce(job).value(), *nonce);
  EXPECT_TRUE(fs::is_empty(job / "data")) << "nothing lies about";
}

TEST(BlindNonce, IsThatOfWhoeverCameFirst) {
  const Scratch folder;
  const std::string first = keep_nonce(folder.path()).value();
  EXPECT_EQ(keep_nonce(folder.path()).value(), first);
  EXPECT_EQ(kept_nonce(folder.path()).value(), first);
  const Scratch other;
  EXPECT_NE(keep_nonce(other.path()).value(), first);
}

TEST(BlindNonce, GivesTheSameSealEachTime) {
  const Scratch folder;
  const std::vector<Session> sessions{draw_session({}, Kind::kSingle, 0).value(),
                                      draw_session({}, Kind::kPair, 1).value()};
  const Seal seal = Seal::close(sessions, keep_nonce(folder.path()).value());
  const Seal later = Seal::close(sessions, kept_nonce(folder.path()).value().value());
  EXPECT_EQ(seal.digest(), later.digest());
  const auto opened = later.open(sessions);
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(opened->digest, seal.digest());
  EXPECT_EQ(cluster::sha256(opened->answers + opened->nonce), seal.digest());
  EXPECT_FALSE(later.open({sessions[0]}));
  EXPECT_NE(Seal::close({sessions[0]}, opened->nonce).digest(), seal.digest());
}

TEST(BlindNonce, AnythingElseInItsPlaceIsRefused) {
  for (const std::string text : {"", "abc\n", "zz"}) {
    const Scratch folder;
    std::ofstream(nonce_file(folder.path())) << text;
    const auto kept = kept_nonce(folder.path());
    ASSERT_FALSE(kept) << text;
    EXPECT_EQ(kept.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(kept.error().message.find("nonce"), std::string::npos) << kept.error().message;
    EXPECT_FALSE(keep_nonce(folder.path()));
  }
  const Scratch folder;
  std::ofstream(folder / "file") << "x";
  const auto none = keep_nonce(folder / "file");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().kind, ErrorKind::kBadInput);
}

}  // namespace
}  // namespace bolo::tools::blind
