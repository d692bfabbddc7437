#include "tools/deblur/deblur_work.hpp"

#include <algorithm>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

#include "tools/deblur/block_planes.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;

std::string numbered(const char* what, std::size_t number) {
  std::string digits = std::to_string(number);
  digits.insert(0, digits.size() < 5 ? 5 - digits.size() : 0, '0');
  return what + digits;
}

std::uint64_t size_of(const fs::path& file) {
  std::error_code error;
  const auto size = fs::file_size(file, error);
  return error ? 0 : size;
}

// Removes what was being written when it is not wanted any more.
class Unfinished {
 public:
  explicit Unfinished(fs::path file) : file_(std::move(file)) {}
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;
  ~Unfinished() {
    std::error_code ignored;
    fs::remove(file_, ignored);
  }
  const fs::path& path() const { return file_; }

 private:
  fs::path file_;
};

}  // namespace

DeblurWork::DeblurWork(const DeblurRequest& request, DeblurPlan plan, const cluster::JobFolder& folder)
    : request_(request), plan_(std::move(plan)), folder_(folder) {
  shares_.resize(plan_.captures.size());
  for (std::size_t i = 0; i < plan_.captures.size(); ++i) {
    const std::string name = numbered("c", i);
    if (plan_.blocks_of(plan_.captures[i]) == 1) {
      shares_[i].push_back(pieces_.size());
      add({Kind::kWhole, i, 0}, {name, i, cluster::Role::kShare, plan_.captures[i].frames, {}});
    } else {
      add_blocks(i, name);
    }
    last_.push_back(pieces_.size() - 1);
  }
}

void DeblurWork::add(Task task, cluster::Piece piece) {
  task.place = pieces_.size();
  tasks_.push_back(task);
  pieces_.push_back(std::move(piece));
}

// Walks before blocks, each behind the one before it; what comes last needs all blocks.
void DeblurWork::add_blocks(std::size_t capture, const std::string& name) {
  const PlannedCapture& planned = plan_.captures[capture];
  const std::size_t blocks = plan_.blocks_of(planned);
  const std::size_t walks = planned.walked ? blocks - 1 : 0;
  const std::size_t first_walk = pieces_.size();
  for (std::size_t k = 1; k <= walks; ++k) {
    std::vector<std::size_t> needs;
    if (k > 1) needs.push_back(pieces_.size() - 1);
    add({Kind::kWalk, capture, k}, {name + numbered("-walk-", k), capture, cluster::Role::kPrelude, 0, needs});
  }
  for (std::size_t k = 0; k < blocks; ++k) {
    std::vector<std::size_t> needs;
    if (k > 0 && walks > 0) needs.push_back(first_walk + k - 1);
    const Task task{Kind::kBlock, capture, k};
    const replay::FrameRange frames = frames_of(task);
    shares_[capture].push_back(pieces_.size());
    add(task, {name + numbered("-block-", k), capture, cluster::Role::kShare, frames.end - frames.first, needs});
  }
  add({Kind::kOutput, capture, 0}, {name + "-output", capture, cluster::Role::kClosing, 0, shares_[capture]});
}

replay::FrameRange DeblurWork::frames_of(const Task& task) const {
  const std::size_t frames = plan_.captures[task.capture].frames;
  if (task.kind == Kind::kWhole) return {0, frames};
  return {task.block * plan_.block_frames, std::min(frames, (task.block + 1) * plan_.block_frames)};
}

bool DeblurWork::output_there(std::size_t capture) const {
  const auto record = folder_.record(pieces_[last_[capture]].name);
  return record && size_of(plan_.captures[capture].file.output) == record->at("bytes");
}

// With the output there, all before it is done, though its data are gone.
bool DeblurWork::done(std::size_t piece) const {
  const Task& task = tasks_[piece];
  if (task.kind == Kind::kWhole || task.kind == Kind::kOutput) return output_there(task.capture);
  const auto record = folder_.record(name_of(task));
  if (!record) return false;
  const fs::path data = data_of(task);
  std::error_code ignored;
  if (fs::exists(data, ignored) && size_of(data) == record->at("bytes")) return true;
  return output_there(task.capture);
}

Result<CaptureRun*> DeblurWork::capture(std::size_t index) {
  if (opened_ != index) {
    opened_.reset();
    run_.reset();
    auto run = CaptureRun::open(request_, plan_.captures[index].file.input, true);
    if (!run) return tl::unexpected(run.error());
    if (run->info().frames != plan_.captures[index].frames) {
      return bad_input(plan_.captures[index].file.input.string() + ": has changed since the job was planned; remove " +
                       folder_.path().string() + " to begin anew");
    }
    run_.emplace(std::move(*run));
    opened_ = index;
  }
  return &*run_;
}

Status DeblurWork::run(std::size_t piece, const cluster::Beat& beat) {
  const Task& task = tasks_[piece];
  switch (task.kind) {
    case Kind::kWhole:
      return run_whole(task, beat);
    case Kind::kWalk:
      return run_walk(task, beat);
    case Kind::kBlock:
      return run_block(task, beat);
    case Kind::kOutput:
      break;
  }
  return run_output(task, beat);
}

// The output under its name, then the record of it.
Status DeblurWork::keep_output(const Task& task, const fs::path& written, const RunFacts& facts,
                               nlohmann::json record) {
  const fs::path& output = plan_.captures[task.capture].file.output;
  record["bytes"] = size_of(written);
  record["frames_out"] = facts.frames_out;
  record["solver_text"] = facts.solver_text;
  record["iterations"] = facts.settings.iterations;
  record["period_s"] = facts.settings.period_s;
  record["isa"] = facts.isa;
  if (facts.rmse) record["rmse"] = {facts.rmse->blurred_k, facts.rmse->deblurred_k};
  if (Status status = cluster::publish(written, output); !status) return status;
  return folder_.add_record(name_of(task), std::move(record));
}

Status DeblurWork::run_whole(const Task& task, const cluster::Beat& beat) {
  const auto run = capture(task.capture);
  if (!run) return tl::unexpected(run.error());
  const Unfinished written(folder_.unfinished(pieces_[last_[task.capture]].name + ".h5"));
  const auto facts = (*run)->whole(written.path(), beat);
  if (!facts) return tl::unexpected(facts.error());
  return keep_output(task, written.path(), *facts, {{"lost", facts->lost}, {"deblur_ms", facts->deblur_ms}});
}

Result<std::string> DeblurWork::state_for(const Task& task) const {
  if (task.block == 0 || !plan_.captures[task.capture].walked) return std::string();
  const Task& walk = *std::ranges::find_if(tasks_, [&](const Task& other) {
    return other.kind == Kind::kWalk && other.capture == task.capture && other.block == task.block;
  });
  std::ifstream in(data_of(walk), std::ios::binary);
  std::ostringstream bytes;
  if (in) bytes << in.rdbuf();
  const std::string state = bytes.str();
  const auto record = folder_.record(name_of(walk));
  if (in && record && record->at("crc") == crc_of(state)) return state;
  folder_.forget(name_of(walk));
  return failed(data_of(walk).string() + ": was damaged after it had been written; it is made again");
}

Status DeblurWork::run_walk(const Task& task, const cluster::Beat& beat) {
  const auto run = capture(task.capture);
  if (!run) return tl::unexpected(run.error());
  const Task before{Kind::kBlock, task.capture, task.block - 1};
  const auto state = state_for(before);
  if (!state) return tl::unexpected(state.error());
  const auto next =
      (*run)->walk(frames_of(before).first, *state, frames_of({Kind::kBlock, task.capture, task.block}).first, beat);
  if (!next) return tl::unexpected(next.error());
  const Unfinished written(folder_.unfinished(name_of(task)));
  std::ofstream out(written.path(), std::ios::binary);
  out << *next;
  out.close();
  if (!out) return failed(written.path().string() + ": cannot be written (is the disk full?)");
  if (Status status = cluster::publish(written.path(), data_of(task)); !status) return status;
  return folder_.add_record(name_of(task), {{"bytes", next->size()}, {"crc", crc_of(*next)}});
}

Status DeblurWork::run_block(const Task& task, const cluster::Beat& beat) {
  const auto run = capture(task.capture);
  if (!run) return tl::unexpected(run.error());
  const auto state = state_for(task);
  if (!state) return tl::unexpected(state.error());
  const Unfinished written(folder_.unfinished(name_of(task)));
  auto block = (*run)->block(frames_of(task), *state, written.path(), beat);
  if (!block) return tl::unexpected(block.error());
  nlohmann::json record{{"bytes", size_of(written.path())},
                        {"crc", block->crc},
                        {"lost", block->lost},
                        {"deblur_ms", block->deblur_ms},
                        {"written", nlohmann::json::array()}};
  for (const replay::FrameRange& frames : block->written) record["written"].push_back({frames.first, frames.end});
  for (const SquareErrors& errors : block->errors) record["errors"].push_back({errors.blurred, errors.deblurred});
  if (Status status = cluster::publish(written.path(), data_of(task)); !status) return status;
  return folder_.add_record(name_of(task), std::move(record));
}

Status DeblurWork::run_output(const Task& task, const cluster::Beat& beat) {
  const auto run = capture(task.capture);
  if (!run) return tl::unexpected(run.error());
  std::vector<BlockPlanes::Source> sources;
  const std::vector<std::size_t>& blocks = shares_[task.capture];
  nlohmann::json sums{{"lost", std::uint64_t{0}}, {"deblur_ms", 0.0}};
  for (const std::size_t block : blocks) {
    auto record = folder_.record(pieces_[block].name);
    if (!record) return failed(pieces_[block].name + ": its record is gone; the block is done again");
    sums["lost"] = sums["lost"].get<std::uint64_t>() + record->at("lost").get<std::uint64_t>();
    sums["deblur_ms"] = sums["deblur_ms"].get<double>() + record->at("deblur_ms").get<double>();
    sources.push_back({data_of(tasks_[block]), std::move(*record)});
  }
  BlockPlanes planes(std::move(sources), (*run)->plane_size(),
                     [&](std::size_t place) { folder_.forget(pieces_[blocks[place]].name); });
  const Unfinished written(folder_.unfinished(pieces_[last_[task.capture]].name + ".h5"));
  const auto facts = (*run)->put_together(
      written.path(), [&planes] { return planes.next(); }, beat);
  if (!facts) return tl::unexpected(facts.error());
  if (Status status = keep_output(task, written.path(), *facts, std::move(sums)); !status) return status;
  for (std::size_t i = 0; i < tasks_.size(); ++i) {
    std::error_code ignored;
    if (tasks_[i].capture == task.capture) fs::remove(data_of(tasks_[i]), ignored);
  }
  return {};
}

}  // namespace bolo::tools
