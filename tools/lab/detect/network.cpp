#include "tools/lab/detect/network.hpp"

#include <dlfcn.h>

#include <system_error>

namespace bolo::tools::detect {
namespace {

Result<OpenNetwork> find_in(const std::filesystem::path& library) {
  std::error_code ignored;
  if (!std::filesystem::exists(library, ignored)) {
    return bad_input(library.string() +
                     ": not there, so no network can be run: this bolo was built without OpenCV; install "
                     "libopencv-dnn-dev and build Bolo from source");
  }
  void* const opened = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);  // for as long as the program runs
  void* const symbol = opened != nullptr ? dlsym(opened, kOpenNetworkName) : nullptr;
  if (symbol == nullptr) {
    const char* const why = dlerror();
    return bad_input(library.string() + ": cannot be loaded: " + (why != nullptr ? why : "not a library of Bolo") +
                     "; build Bolo again");
  }
  return reinterpret_cast<OpenNetwork>(symbol);
}

}  // namespace

std::filesystem::path networks_library() {
  std::error_code ignored;
  return std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path() / "bolo-networks.so";
}

Result<std::unique_ptr<Network>> open_network(const NetworkFiles& files, const std::filesystem::path& library) {
  ASSIGN_OR_RETURN(const auto open, find_in(library));
  Result<std::unique_ptr<Network>> made;
  open(files, made);
  return made;
}

}  // namespace bolo::tools::detect
