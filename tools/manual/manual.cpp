// Writes the manual pages and the completion scripts: bolo_manual FOLDER VERSION DATE. Part of the build; what it
// writes is installed.
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "src/model/camera_profile.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/bolod/config.hpp"
#include "tools/bolod/options.hpp"
#include "tools/manual/command.hpp"
#include "tools/manual/completion.hpp"
#include "tools/manual/man_page.hpp"

namespace {

using namespace bolo::tools;

const std::array<PageSection, 5> kDaemonSections{{
    {"AS A SERVICE",
     "bolod@NAME.service runs /etc/bolo/NAME.toml as the user bolo, watched and confined: video and USB devices, "
     "cameras "
     "with private addresses. What else one needs goes into a drop-in (systemctl edit bolod@NAME): IPAddressAllow= for "
     "a camera with a public address, Group= for readers of another group, BindReadOnlyPaths= for captures in /home."
     "\n\nbolo-fakecam.service is a camera without hardware, and bolod@demo takes its frames."},
    {"SIGNALS",
     "SIGTERM and SIGINT end it in good order. SIGHUP has it read its configuration again: systemctl reload."},
    {"EXIT STATUS",
     "0: ended as it was told. 1: failed while running; started by systemd also when the camera does not answer yet, "
     "to "
     "be tried again. 2: wrong usage, configuration or input, with one line on standard error that says what, where "
     "and "
     "what to do."},
    {"FILES",
     "/etc/bolo/NAME.toml: what bolod@NAME.service runs; bolod.toml(5) has every key.\n\n/dev/shm/bolo.NAME: the "
     "frames. Members of the group bolo may read them when [shm] mode is 0o640.\n\n/run/bolo/NAME.sock: hears "
     "bolo-nuc(1). Members of the group bolo may write to it."},
    {"SEE ALSO", "bolo(1), bolod.toml(5), bolo-profile(5), bolo-doctor(1)"},
}};

std::vector<Command> read_verbs() {
  std::vector<Command> verbs;
  for (const Verb& verb : kVerbs) verbs.push_back(read_verb(verb, {}, "bolo"));
  return verbs;
}

class Folder {
 public:
  explicit Folder(std::filesystem::path path) : path_(std::move(path)) {}
  void write(const std::filesystem::path& name, const std::string& text) {
    std::error_code error;
    std::filesystem::create_directories((path_ / name).parent_path(), error);
    std::ofstream file(path_ / name, std::ios::binary | std::ios::trunc);
    file << text << std::flush;
    good_ = good_ && file.good();
  }
  bool good() const { return good_; }

 private:
  std::filesystem::path path_;
  bool good_ = true;
};

bool write_pages(const std::filesystem::path& path, std::span<const Command> verbs, const Command& daemon,
                 const PageOrigin& origin) {
  Folder folder(path);
  folder.write("man1/bolo.1", overview_page(verbs, origin));
  const std::array<PageSection, 2> sections{{exit_status(), {"SEE ALSO", "bolo(1), bolod(8)"}}};
  for (const Command& verb : verbs) folder.write("man1/" + verb.page() + ".1", command_page(verb, 1, sections, origin));
  folder.write("man8/bolod.8", command_page(daemon, 8, kDaemonSections, origin));
  const std::array<PageSection, 1> see{{{"SEE ALSO", "bolod(8), bolo-doctor(1), bolo-calibrate(1), bolo-diagnose(1)"}}};
  folder.write("man5/bolod.toml.5", settings_page("bolod.toml", "configuration of bolod, one file a camera",
                                                  bolo::daemon::document_config(), see, origin));
  folder.write("man5/bolo-profile.5", settings_page("bolo-profile", "what is known of one camera",
                                                    bolo::model::document_profile({}), see, origin));
  return folder.good();
}

bool write_completion(const std::filesystem::path& path, std::span<const Command> verbs, const Command& daemon) {
  Folder folder(path);
  folder.write("bolo.bash", bash_completion(verbs, daemon));
  folder.write("_bolo", zsh_completion(verbs, daemon));
  folder.write("bolo.fish", fish_completion(verbs));
  folder.write("bolod.fish", fish_completion(daemon));
  return folder.good();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fputs("usage: bolo_manual FOLDER VERSION DATE\n", stderr);
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  const std::vector<Command> verbs = read_verbs();
  const Command daemon = read_command(bolod_options(), "deblurs a thermal camera's frames, live");
  if (write_pages(folder / "man", verbs, daemon, {argv[2], argv[3]}) &&
      write_completion(folder / "completion", verbs, daemon)) {
    return 0;
  }
  std::fprintf(stderr, "bolo_manual: cannot write below %s\n", argv[1]);
  return 1;
}
