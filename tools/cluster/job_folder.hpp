// The manifest of shared work: a folder that all hosts see, with the plan and a record of each piece that is done.
//
//   plan.json        what is to be done; whoever comes first writes it, all others must want the same
//   done/NAME.json   the record of a piece; there is none before everything it speaks of is on the disk
//   data/            what pieces leave for others, and what is being written, under names of host and process
//
// Files get their names whole: written under another name, flushed to the disk, then renamed. So a record is there or
// is not, and two that write the same one do no harm. Each has the digest of its plan and its own.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "src/core/result.hpp"

namespace bolo::tools::cluster {

// This host's name. Thread: any.
std::string own_host();

// This process among all that use a folder: "HOST-PID". Thread: any.
std::string own_name();

// Flushes a file that was written, and the folder that names it, to the disk. kFailed with the file and the reason.
// Thread: any.
Status flush(const std::filesystem::path& file);

// flush() of `written`, then gives it the name `file`, in whose folder it must lie. Thread: any.
Status publish(const std::filesystem::path& written, const std::filesystem::path& file);

// Like publish(), but leaves the file of somebody who was faster as it is; `written` is gone then. Thread: any.
Status publish_first(const std::filesystem::path& written, const std::filesystem::path& file);

// Thread: any one at a time.
class JobFolder {
 public:
  // Makes the folder and its plan, or finds the same plan there. kBadInput when another one is there, with the first
  // thing that differs, or when no folder can be made.
  static Result<JobFolder> open(const std::filesystem::path& folder, const nlohmann::json& plan);
  // The plan that a folder has, if it has one.
  static std::optional<nlohmann::json> plan_in(const std::filesystem::path& folder);

  const std::filesystem::path& path() const { return folder_; }
  // A piece's data under its final name, and a name under which the caller alone may write it: another one each time.
  std::filesystem::path data(const std::string& name) const { return folder_ / "data" / name; }
  std::filesystem::path unfinished(const std::string& name) const;

  // Nothing when there is none, or when it is torn, changed, or of another plan: what is given is what was added.
  std::optional<nlohmann::json> record(const std::string& piece) const;
  Status add_record(const std::string& piece, nlohmann::json record) const;
  // What was done counts no more.
  void forget(const std::string& piece) const;
  // Nothing of the work is left to do: what lies about is removed, of processes that died too.
  void clear_data() const;

 private:
  JobFolder(std::filesystem::path folder, std::string digest);

  std::filesystem::path record_file(const std::string& piece) const { return folder_ / "done" / (piece + ".json"); }

  std::filesystem::path folder_;
  std::string digest_;  // of the plan; each record has it
};

}  // namespace bolo::tools::cluster
