#include "tools/cluster/job_folder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

#include "src/core/unique_fd.hpp"
#include "tools/cluster/digest.hpp"

namespace bolo::tools::cluster {
namespace {

namespace fs = std::filesystem;

constexpr int kVersion = 1;
constexpr const char* kCheck = "sha256";  // of the record without it

Status flushed(const fs::path& path, int flags) {
  const UniqueFd file(::open(path.c_str(), flags | O_CLOEXEC));
  // Some file systems cannot flush a folder (EINVAL): there is nothing more to do then.
  if (file.get() >= 0 && (::fsync(file.get()) == 0 || errno == EINVAL)) return {};
  return failed(path.string() + ": cannot be flushed to the disk: " + std::strerror(errno));
}

Status written(const fs::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (out) return {};
  return failed(file.string() + ": cannot be written (is the disk full?)");
}

std::optional<nlohmann::json> json_in(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return std::nullopt;
  std::ostringstream text;
  text << in.rdbuf();
  nlohmann::json json = nlohmann::json::parse(text.str(), nullptr, false);
  if (json.is_discarded() || !json.is_object()) return std::nullopt;
  return json;
}

// "/settings/lambda is 0.5 there and 0.1 now"
std::string first_difference(const nlohmann::json& there, const nlohmann::json& now) {
  const nlohmann::json changes = nlohmann::json::diff(there, now);
  if (changes.empty()) return "nothing";
  const nlohmann::json::json_pointer place(changes[0]["path"].get<std::string>());
  const auto shown = [&](const nlohmann::json& plan) {
    return plan.contains(place) ? plan[place].dump() : std::string("not given");
  };
  return place.to_string() + " is " + shown(there) + " there and " + shown(now) + " now";
}

}  // namespace

std::string own_host() {
  std::array<char, 256> host{};
  return ::gethostname(host.data(), host.size() - 1) == 0 ? host.data() : "host";
}

std::string own_name() { return own_host() + "-" + std::to_string(::getpid()); }

Status flush(const fs::path& file) {
  if (Status status = flushed(file, O_RDONLY); !status) return status;
  return flushed(fs::absolute(file).parent_path(), O_RDONLY | O_DIRECTORY);
}

Status publish(const fs::path& written, const fs::path& file) {
  if (Status status = flushed(written, O_RDONLY); !status) return status;
  std::error_code error;
  fs::rename(written, file, error);
  if (error) return failed(file.string() + ": cannot be renamed from " + written.string() + ": " + error.message());
  return flushed(fs::absolute(file).parent_path(), O_RDONLY | O_DIRECTORY);
}

Status publish_first(const fs::path& written, const fs::path& file) {
  if (Status status = flushed(written, O_RDONLY); !status) return status;
  std::error_code error;
  fs::create_hard_link(written, file, error);  // unlike a rename, it replaces nothing
  std::error_code ignored;
  if (error && !fs::exists(file, ignored)) return publish(written, file);
  fs::remove(written, ignored);
  return flushed(fs::absolute(file).parent_path(), O_RDONLY | O_DIRECTORY);
}

JobFolder::JobFolder(fs::path folder, std::string digest) : folder_(std::move(folder)), digest_(std::move(digest)) {}

std::optional<nlohmann::json> JobFolder::plan_in(const fs::path& folder) { return json_in(folder / "plan.json"); }

Result<JobFolder> JobFolder::open(const fs::path& folder, const nlohmann::json& plan) {
  std::error_code error;
  for (const char* part : {"done", "data"}) {
    fs::create_directories(folder / part, error);
    if (error) return bad_input(folder.string() + ": cannot be made a folder: " + error.message());
  }
  JobFolder job(folder, sha256(plan.dump()));
  const fs::path file = folder / "plan.json";
  if (!fs::exists(file, error)) {
    const fs::path own = job.unfinished("plan.json");
    Status status = written(own, plan.dump(1) + "\n");
    if (status) status = publish_first(own, file);
    if (!status) return tl::unexpected(status.error());
  }
  const auto there = plan_in(folder);
  if (!there) {
    return bad_input(file.string() + ": is no plan; remove " + folder.string() + " to begin anew");
  }
  if (*there == plan) return job;
  return bad_input(folder.string() + ": belongs to other work: " + first_difference(*there, plan) +
                   "; give the same options, another --job, or remove the folder to begin anew");
}

fs::path JobFolder::unfinished(const std::string& name) const {
  static std::atomic<unsigned> count{0};
  return folder_ / "data" / (own_name() + "-" + std::to_string(count.fetch_add(1)) + "-" + name);
}

std::optional<nlohmann::json> JobFolder::record(const std::string& piece) const {
  auto json = json_in(record_file(piece));
  if (!json || !json->contains(kCheck)) return std::nullopt;
  const nlohmann::json check = std::move((*json)[kCheck]);
  json->erase(kCheck);
  const bool whole = check == sha256(json->dump());
  if (!whole || json->at("version") != kVersion || json->at("plan") != digest_) return std::nullopt;
  return json;
}

Status JobFolder::add_record(const std::string& piece, nlohmann::json record) const {
  record["version"] = kVersion;
  record["plan"] = digest_;
  record["by"] = own_name();
  record[kCheck] = sha256(record.dump());
  const fs::path own = unfinished(piece + ".json");
  if (Status status = written(own, record.dump() + "\n"); !status) return status;
  return publish(own, record_file(piece));
}

void JobFolder::forget(const std::string& piece) const {
  std::error_code ignored;
  fs::remove(record_file(piece), ignored);
}

void JobFolder::clear_data() const {
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "data", ignored)) {
    fs::remove_all(entry.path(), ignored);
  }
}

}  // namespace bolo::tools::cluster
