// Whether this process was started by MPI's launcher, and MPI itself, which is loaded only then.
//
// It is in a library beside the program (bolo-mpi.so), so that bolo needs no MPI where there is none.
#pragma once

#include <memory>

#include "src/core/result.hpp"
#include "tools/cluster/messenger.hpp"

namespace bolo::tools::cluster {

struct Launch {
  int rank = 0;
  int size = 0;  // 0: not told
};

// What mpirun, mpiexec or srun said in the environment; size 0 and rank 0 when nothing did. Thread: setup.
Launch mpi_launch();

// True when there are other processes of the same start, or may be. Thread: setup.
bool launched_by_mpi();

// Connects to the others; once. kBadInput when this bolo has no MPI, or it does not start, with what to do. Thread:
// setup.
Result<std::unique_ptr<Messenger>> open_mpi();

// The one function of the library, found by its name; C linkage, so that the name is its own.
inline constexpr const char* kOpenMpiName = "bolo_open_mpi";
using OpenMpi = void (*)(Result<std::unique_ptr<Messenger>>& made);

}  // namespace bolo::tools::cluster
