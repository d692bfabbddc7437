#include "tools/bolod/control.hpp"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <system_error>

#include "drivers/shm/camera_block.hpp"
#include "drivers/shm/shm_object.hpp"
#include "src/core/clock.hpp"
#include "src/core/threads.hpp"
#include "src/core/unique_fd.hpp"
#include "tools/bolod/supervisor.hpp"

namespace bolo::daemon {
namespace {

constexpr RequestServer::Limits kLimits{.clients = 16, .patience_ms = 1000, .longest_request = 256};

// With write permission to the folder another user could replace the socket, unless it is sticky (/tmp).
Status check_folder(const std::string& folder) {
  struct stat status {};
  if (stat(folder.c_str(), &status) != 0) return {};  // bind() reports why
  if (status.st_uid != 0 && status.st_uid != geteuid()) {
    return bad_input(folder + " belongs to " + shm::describe_user(status.st_uid) +
                     ", who could put a control socket of his own there; remove it, or set control.socket");
  }
  if ((status.st_mode & S_IWOTH) == 0 || (status.st_mode & S_ISVTX) != 0) return {};
  return bad_input(folder +
                   " may be written to by everybody, who could put a control socket of his own there: chmod o-w " +
                   folder + ", or set control.socket");
}

// A missing folder is created without write permission for others, regardless of the umask.
void make_folder(const std::filesystem::path& folder) {
  using std::filesystem::perms;
  std::error_code ignored;  // bind() reports why
  if (folder.empty() || !std::filesystem::create_directories(folder, ignored)) return;
  std::filesystem::permissions(folder, perms::group_write | perms::others_write, std::filesystem::perm_options::remove,
                               ignored);
}

bool is_listening(const sockaddr_un& address) {
  const UniqueFd probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  return connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 || errno == EAGAIN;
}

// Device and inode; zeros if the path does not exist.
std::pair<dev_t, ino_t> file_at(const std::string& path) {
  struct stat status {};
  return lstat(path.c_str(), &status) == 0 ? std::pair(status.st_dev, status.st_ino) : std::pair<dev_t, ino_t>();
}

tl::unexpected<Error> cannot(const std::string& path, int code) {
  return bad_input("control socket " + path + ": " + std::strerror(code) +
                   "; set control.socket to a place where the daemon may write, or control.enable = false");
}

using shm::JsonMembers;

std::string latency_json(const rt::LatencyHistogram& histogram) {
  const auto counts = histogram.counts();
  JsonMembers json;
  json.add("p50_ms", rt::LatencyHistogram::percentile_ms(counts, 0.5));
  json.add("p99_ms", rt::LatencyHistogram::percentile_ms(counts, 0.99));
  json.add("max_ms", rt::LatencyHistogram::percentile_ms(counts, 1.0));
  return json.text();
}

template <typename Enum, std::size_t N>
std::string by_name(const std::array<std::uint64_t, N>& counts) {
  JsonMembers json;
  for (std::size_t i = 0; i < N; ++i) json.add(name(static_cast<Enum>(i)), counts[i]);
  return json.text();
}

std::string sink_json(const pipeline::SinkStatistics& sink) {
  JsonMembers json;
  json.add(sink.label, sink.name);
  for (const pipeline::SinkNumber& number : sink.numbers) {
    number.counts() ? json.add(number.key, number.value) : json.add(number.key, number.value != 0);
  }
  return json.text();
}

std::string sinks_json(const pipeline::Pipeline& pipeline, std::string_view group) {
  std::string list;
  for (const pipeline::FrameSink* sink : pipeline.sinks()) {
    const pipeline::SinkStatistics statistics = sink->statistics();
    if (statistics.group == group) list += (list.empty() ? "" : ",") + sink_json(statistics);
  }
  return "[" + list + "]";
}

std::string stages_json(const pipeline::PipelineStats& stats) {
  JsonMembers json;
  for (const auto& stage : pipeline::kStages) json.add_text(stage.name, latency_json(stats.stages.*stage.latency));
  json.add_text("total", latency_json(stats.latency));
  return json.text();
}

}  // namespace

std::string default_control_socket(const std::string& name) {
  const auto given = [](const char* variable) {
    const char* value = std::getenv(variable);
    return std::string(value != nullptr ? value : "");
  };
  std::string folder = given("RUNTIME_DIRECTORY");
  if (folder.empty() && geteuid() == 0) folder = "/run/bolo";
  if (folder.empty() && !given("XDG_RUNTIME_DIR").empty()) folder = given("XDG_RUNTIME_DIR") + "/bolo";
  if (folder.empty()) folder = "/tmp/bolo-" + std::to_string(geteuid());
  return folder + "/" + name + ".sock";
}

Status check_control_socket(const std::string& path) {
  constexpr std::size_t kLongest = sizeof(sockaddr_un::sun_path) - 1;
  if (path.size() <= kLongest) return {};
  return bad_input("control socket " + path + ": longer than " + std::to_string(kLongest) +
                   " letters; set control.socket to a shorter path");
}

Result<std::unique_ptr<ControlServer>> ControlServer::start(const std::string& path, unsigned mode, Answer answer) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  RETURN_IF_ERROR(check_control_socket(path));
  path.copy(address.sun_path, path.size());
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  make_folder(folder);
  RETURN_IF_ERROR(check_folder(folder.empty() ? "." : folder.string()));
  if (is_listening(address)) return bad_input("control socket " + path + ": another daemon listens there; stop it");
  struct stat there {};
  if (lstat(path.c_str(), &there) == 0) {
    if (!S_ISSOCK(there.st_mode)) {
      return bad_input("control socket " + path +
                       ": a file that is no socket is there; remove it, or set control.socket");
    }
    unlink(path.c_str());
  }

  UniqueFd listener(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int fd = listener.get();
  if (fd < 0 || bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return cannot(path, errno);
  // Does not follow links: another user may have replaced the folder or the socket by one.
  if (fchmodat(AT_FDCWD, path.c_str(), static_cast<mode_t>(mode), AT_SYMLINK_NOFOLLOW) != 0 ||
      listen(fd, RequestServer::kBacklog) != 0)
    return cannot(path, errno);
  try {
    return std::unique_ptr<ControlServer>(new ControlServer(path, std::move(listener), std::move(answer)));
  } catch (const std::system_error& e) {
    unlink(path.c_str());
    return failed("control socket " + path + ": " + describe_exception(e));
  }
}

// A request is one line.
ControlServer::ControlServer(std::string path, UniqueFd listener, Answer answer)
    : path_(std::move(path)),
      file_(file_at(path_)),
      server_(std::move(listener), kLimits,
              [answer = std::move(answer)](std::string_view received) -> std::optional<std::string> {
                const std::size_t end = received.find('\n');
                if (end == std::string_view::npos) return std::nullopt;
                return answer(received.substr(0, end)) + "\n";
              }) {}

ControlServer::~ControlServer() {
  if (is_there()) unlink(path_.c_str());
}

// The inode number stays unique while the socket is open, even without a name.
bool ControlServer::is_there() const { return file_at(path_) == file_; }

std::string state_json(const DaemonConfig& config, const pipeline::Pipeline& pipeline) {
  const pipeline::PipelineStats& stats = pipeline.stats();
  JsonMembers json;
  json.add("ok", true);
  json.add("name", config.name);
  json.add("received", stats.inlet.received());
  for (const auto& row : pipeline::kFrameCounters) {  // the others are in shared memory
    if (row.shared != 0 || row.key.empty()) continue;
    const std::uint64_t word = row.read(stats, 0);
    if (row.kind != pipeline::RowKind::kReal) json.add(row.key, word);
    if (row.kind == pipeline::RowKind::kReal) {
      json.add(row.key, word == 0 ? nlohmann::json() : nlohmann::json(std::bit_cast<double>(word)));
    }
  }
  json.add("lost_total", stats.inlet.losses().total());
  json.add_text("lost", by_name<LossCause>(loss_counts(stats)));
  JsonMembers effort;
  effort.add("now", name(stats.effort.value()));
  effort.add_text("frames", by_name<pipeline::QualityLevel>(quality_counts(stats)));
  json.add_text("effort", effort.text());
  json.add_text("stages", stages_json(stats));
  const bool camera = stats.source != nullptr;
  json.add_text("camera", camera ? shm::camera_json(shm::camera_block(*stats.source), monotonic_ns()) : "null");
  for (const auto& section : config.sinks) {
    if (!section->group().empty()) json.add_text(section->group(), sinks_json(pipeline, section->group()));
  }
  return json.text();
}

}  // namespace bolo::daemon
