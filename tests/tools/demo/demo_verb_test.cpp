// `bolo demo` in a folder given by the user, with other files in it.
#include "tests/tools/program.hpp"

namespace bolo::tools::test::demo_verb_test {

class DemoVerb : public ProgramTest {
 protected:
  DemoVerb() : ProgramTest({BOLO_PROGRAM, "demo", "--no-page", "--seconds", "1"}) {}
};

TEST_F(DemoVerb, ReplacesNothing) {
  for (const std::string name : {"street.h5", "before_after.svg", "bolod.toml", "bolod.err", "view.out"}) {
    const std::string theirs = write(name, "precious");
    refused({"-o", folder_}, name + " is there already");
    EXPECT_EQ(contents(theirs), "precious");
    std::filesystem::remove(theirs);
  }
}

// A file system without a size limit reports none: then any problem must be another one.
TEST_F(DemoVerb, SaysHowMuchRoomItNeedsBeforeItBegins) {
  const std::string mounted =
      "mount -t tmpfs -o size=$1 none \"$0\" || exit 77; shift; touch \"$0/street.h5\"; exec \"$@\"";
  for (const auto& [size, message] :
       {std::pair{"8m", ": 8 MB are free, and the demonstration needs 400 MB"}, {"0", "street.h5 is there already"}}) {
    Program demo({"/usr/bin/unshare", "--mount", "--map-root-user", "/bin/sh", "-c", mounted, folder_, size,
                  BOLO_PROGRAM, "demo", "--no-page", "--seconds", "1", "-o", folder_},
                 file("demo"));
    const int code = demo.wait();
    if (code != 2) GTEST_SKIP() << "no mount namespace here: " << demo.err();
    expect_parts(demo.err(), {message});
  }
}

}  // namespace bolo::tools::test::demo_verb_test
