#include "tools/cluster/mpi.hpp"

#include <dlfcn.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>

namespace bolo::tools::cluster {
namespace {

int number_in(const char* name, int missing) {
  const char* const text = std::getenv(name);
  return text != nullptr ? std::atoi(text) : missing;
}

// Beside the program as it was built, or where the package puts it.
std::filesystem::path library() {
  std::error_code ignored;
  const auto beside = std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path() / "bolo-mpi.so";
  return std::filesystem::exists(beside, ignored) ? beside : std::filesystem::path(BOLO_MODULES) / "bolo-mpi.so";
}

}  // namespace

// Open MPI's mpirun; MPICH's and Intel's mpiexec, srun --mpi=pmi2; srun --mpi=pmix, which tells no size but its own.
Launch mpi_launch() {
  if (std::getenv("OMPI_COMM_WORLD_RANK") != nullptr) {
    return {number_in("OMPI_COMM_WORLD_RANK", 0), number_in("OMPI_COMM_WORLD_SIZE", 0)};
  }
  if (std::getenv("PMI_RANK") != nullptr) return {number_in("PMI_RANK", 0), number_in("PMI_SIZE", 0)};
  if (std::getenv("PMIX_RANK") != nullptr) return {number_in("PMIX_RANK", 0), number_in("SLURM_NTASKS", 0)};
  return {};
}

bool launched_by_mpi() { return mpi_launch().size > 1; }

Result<std::unique_ptr<Messenger>> open_mpi() {
  const std::filesystem::path file = library();
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) {
    return bad_input(file.string() +
                     ": not there, so ranks cannot work together: this bolo was built without MPI; install the package "
                     "bolo-mpi, or libopenmpi-dev and build Bolo again, or start shards (--shard I/N)");
  }
  // MPI's own plug-ins look for its symbols among those of the whole program.
  void* const opened = dlopen(file.c_str(), RTLD_NOW | RTLD_GLOBAL);  // for as long as the program runs
  void* const symbol = opened != nullptr ? dlsym(opened, kOpenMpiName) : nullptr;
  if (symbol == nullptr) {
    const char* const why = dlerror();
    return bad_input(file.string() + ": cannot be loaded: " + (why != nullptr ? why : "not a library of Bolo") +
                     "; build Bolo again");
  }
  Result<std::unique_ptr<Messenger>> made;
  reinterpret_cast<OpenMpi>(symbol)(made);
  return made;
}

}  // namespace bolo::tools::cluster
