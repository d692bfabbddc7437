// The program bolo bench: what it prints, not how fast anything is.
#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test::bench_verb_test {

struct BenchVerb : ProgramTest {
  BenchVerb() : ProgramTest({BOLO_LAB_PROGRAM, "bench"}) {}
};

void expect_measured(const nlohmann::json& m) {
  for (const char* key : {"solver", "isa"}) EXPECT_TRUE(m.at(key).is_string()) << m;
  for (const char* key : {"threads", "iterations", "repeats", "pixels"})
    EXPECT_TRUE(m.at(key).is_number_integer()) << m;
  for (const char* key : {"ms_per_frame", "median_ms_per_frame", "ns_per_pixel", "realtime_factor", "scaling"}) {
    EXPECT_GT(m.at(key).get<double>(), 0.0) << key << " in " << m;
  }
  EXPECT_LE(m.at("ms_per_frame").get<double>(), m.at("median_ms_per_frame").get<double>());
  EXPECT_GE(m.at("rms_error_k").get<double>(), 0.0);
  EXPECT_GE(m.at("max_error_k").get<double>(), m.at("rms_error_k").get<double>());
}

TEST_F(BenchVerb, JsonHasTheMainFiguresAndEveryVariant) {
  const auto result = nlohmann::json::parse(printed(words("deblur --json --seconds 0.1")));
  expect_measured(result);
  EXPECT_EQ(result.at("solver"), "admm");
  EXPECT_EQ(result.at("threads"), 1);
  EXPECT_LE(result.at("rms_error_k").get<double>(), 5e-3);
  EXPECT_LE(result.at("max_error_k").get<double>(), 50e-3);
  int with_profile = 0;
  std::set<std::string> solvers;
  for (const nlohmann::json& variant : result.at("variants")) {
    expect_measured(variant);
    solvers.insert(variant.at("solver"));
    if (!variant.at("profile").get<bool>()) continue;
    ++with_profile;
    EXPECT_GT(variant.at("throughput_of_plain").get<double>(), 0.0);
    EXPECT_LE(variant.at("rms_error_k").get<double>(), 5e-3) << "its maps change no value";
  }
  EXPECT_EQ(with_profile, 6);
  EXPECT_EQ(solvers, (std::set<std::string>{"admm", "dual", "exact", "inverse"}));
  EXPECT_GE(result.at("machine").at("processors").get<int>(), 1);
}

TEST_F(BenchVerb, WrongOptionsAreOneLineAndExitCode2) {
  refused_each("bolo bench measures", "deblur --solver mmae", "deblur --solver motion");
  refused_each("", "", "kettle", "deblur --solver magic", "deblur --isa MMX", "deblur --threads 0",
               "deblur --lambda -1", "deblur --seconds 0");
}

}  // namespace bolo::tools::test::bench_verb_test
