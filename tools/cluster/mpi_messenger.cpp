// bolo-mpi.so: messages by MPI.
#include <mpi.h>

#include <unistd.h>

#include <cstdlib>
#include <list>
#include <utility>
#include <vector>

#include "tools/cluster/mpi.hpp"

namespace bolo::tools::cluster {
namespace {

constexpr int kTag = 0;

// Sends are begun and never waited for: one to a process that died would wait for ever.
class MpiMessenger final : public Messenger {
 public:
  MpiMessenger() {
    MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &size_);
    MPI_Comm here = MPI_COMM_NULL;
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &here);
    MPI_Comm_size(here, &local_);
    MPI_Comm_free(&here);
  }

  int rank() const override { return rank_; }
  int size() const override { return size_; }
  int local() const override { return local_; }

  void send(int to, const std::string& text) override {
    sent_.remove_if([](Sent& sent) {
      int done = 0;
      return MPI_Test(&sent.request, &done, MPI_STATUS_IGNORE) != MPI_SUCCESS || done != 0;
    });
    Sent& sent = sent_.emplace_back(Sent{text, MPI_REQUEST_NULL});
    // Looked at by later sends, waited for when all take leave.
    MPI_Isend(sent.text.data(), static_cast<int>(sent.text.size()), MPI_CHAR, to, kTag, MPI_COMM_WORLD, &sent.request);
  }  // NOLINT(clang-analyzer-optin.mpi.MPI-Checker): see above

  std::optional<Message> receive() override {
    int there = 0;
    MPI_Status status;
    if (MPI_Iprobe(MPI_ANY_SOURCE, kTag, MPI_COMM_WORLD, &there, &status) != MPI_SUCCESS || there == 0) return {};
    int size = 0;
    MPI_Get_count(&status, MPI_CHAR, &size);
    Message message{status.MPI_SOURCE, std::string(static_cast<std::size_t>(size), '\0')};
    const int got =
        MPI_Recv(message.text.data(), size, MPI_CHAR, message.from, kTag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
    return got == MPI_SUCCESS ? std::optional(std::move(message)) : std::nullopt;
  }

  void leave(bool all_present) override {
    if (!all_present) return;  // MPI's end waits for all: without some of them the process just ends
    for (Sent& sent : sent_) {
      MPI_Wait(&sent.request, MPI_STATUS_IGNORE);  // NOLINT(clang-analyzer-optin.mpi.MPI-Checker): send() began it
    }
    sent_.clear();
    MPI_Finalize();
  }

 private:
  struct Sent {
    std::string text;
    MPI_Request request;
  };

  int rank_ = 0;
  int size_ = 1;
  int local_ = 1;
  std::list<Sent> sent_;  // a list: MPI reads the texts where they are
};

}  // namespace
}  // namespace bolo::tools::cluster

extern "C" void bolo_open_mpi(bolo::Result<std::unique_ptr<bolo::tools::cluster::Messenger>>& made) {
  int level = 0;
  if (MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &level) != MPI_SUCCESS) {
    made = bolo::bad_input("MPI does not start; try a small MPI program under the same launcher");
    return;
  }
  made = std::make_unique<bolo::tools::cluster::MpiMessenger>();
}
