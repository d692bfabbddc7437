// Blind-check sessions as files, for tests that know the hidden effects.
#pragma once

#include "tests/diagnose/bench.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::diagnose::testing {

class BlindBench : public ::testing::Test {
 protected:
  using Kind = tools::blind::Kind;

  // The first `captures` of a session's six; each has all drawn effects and `effects`.
  std::vector<std::filesystem::path> bench(const tools::blind::DrawOptions& options,
                                           const std::vector<std::string>& effects = {}, Kind kind = Kind::kEffectFree,
                                           std::size_t index = 0, std::size_t captures = 6) {
    session_ = tools::blind::draw_session(options, kind, index).value();
    session_.captures.resize(captures);
    for (const std::string& text : effects) {
      const sim::EffectSpec effect = sim::parse_effect(text).value();
      for (auto& capture : session_.captures) capture.effects.push_back(effect);
      session_.effects.push_back(effect);
    }
    return tools::blind::write_captures(session_, scratch_.path()).value();
  }

  tools::blind::Session session_;
  Scratch scratch_;
};

}  // namespace bolo::diagnose::testing
