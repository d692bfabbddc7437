#include "tools/cli/scratch_folder.hpp"

#include <cstdlib>
#include <string>
#include <system_error>

namespace bolo::tools {

Result<ScratchFolder> ScratchFolder::make(std::filesystem::path parent) {
  std::error_code error;
  if (parent.empty()) parent = std::filesystem::temp_directory_path(error);
  if (!error) parent = std::filesystem::absolute(parent, error);
  std::string name = (parent / "bolo-XXXXXX").string();
  if (error || mkdtemp(name.data()) == nullptr) {
    return failed((parent.empty() ? "TMPDIR" : parent.string()) +
                  ": no folder can be made there; choose another with TMPDIR");
  }
  return ScratchFolder(name);
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
}

}  // namespace bolo::tools
