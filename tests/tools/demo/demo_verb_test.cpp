// `bolo demo` in a folder that the user named, and where files of his are.
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

// Where nothing can be stored, and no folder be made.
TEST_F(DemoVerb, SaysHowMuchRoomItNeedsBeforeItBegins) {
  refused({"-o", "/sys/demonstration/of-bolo"}, "/sys: 0 MB are free, and the demonstration needs 400 MB");
}

}  // namespace bolo::tools::test::demo_verb_test
