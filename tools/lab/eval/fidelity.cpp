#include "tools/lab/eval/fidelity.hpp"

#include <algorithm>
#include <cstdio>
#include <new>
#include <optional>

#include "src/report/text.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/eval/fidelity_plot.hpp"
#include "tools/lab/eval/fidelity_report.hpp"
#include "tools/lab/eval/jobs.hpp"

namespace bolo::tools {
namespace {

using namespace fidelity;

constexpr std::uint64_t kOtherStreet = 1000;  // away from the seeds of the judged street and noise: the training's
constexpr int kLongestLookahead = 4;          // of the picture of latency against quality
constexpr int kDropTargets = 720;             // frames of the streams with losses
constexpr int kDropRows = 16;

class Evaluation {
 public:
  explicit Evaluation(const Options& options)
      : options_(options),
        longest_(*std::ranges::max_element(options.lookaheads)),
        progress_("fidelity", options.scenes.size() * options.motions.size() * jobs_a_motion()) {}

  Result<Table> run() {
    for (const std::string& scene : options_.scenes) {
      for (const Motion& motion : options_.motions) {
        if (Status done = run_motion(scene, motion); !done) return tl::unexpected(done.error());
      }
    }
    table_.verdicts = verdicts(table_.cells, table_.drops);
    return std::move(table_);
  }

 private:
  // Everything at one noise.
  struct Noise {
    Sequence sequence;
    Sequence training;
    Sequence lossy;
    std::vector<Column> spatial;
    std::vector<std::optional<Cell>> cells;
    std::vector<std::optional<std::vector<DropRow>>> drops;
    std::optional<LatencyCurves> latency;
  };

  std::uint64_t jobs_a_motion() const {
    const std::uint64_t lookaheads = options_.lookaheads.size();
    return options_.noises_k.size() * (2 + lookaheads * (options_.drop > 0.0 ? 2 : 1));
  }

  // The picture shows one motion's latency: the pan nearest to the paper's, over the first scene.
  bool shows_latency(const std::string& scene, const Motion& motion) const {
    constexpr double kShownSpeed = 300.0;
    const auto distance = [](const Motion& m) { return m.is_pan() ? std::abs(m.speed_px_s - kShownSpeed) : 1e9; };
    const auto nearest = std::ranges::min_element(options_.motions, {}, distance);
    return !options_.plot.empty() && scene == options_.scenes.front() && &*nearest == &motion;
  }

  SequenceTask task_of(const std::string& scene, const Motion& motion) const {
    SequenceTask task{scene,    motion,        options_.crop,   options_.frames, stride_of(motion),
                      longest_, options_.seed, options_.threads};
    if (shows_latency(scene, motion)) task.lookahead = std::max(longest_, kLongestLookahead);
    return task;
  }

  Status run_motion(const std::string& scene, const Motion& motion) {
    const SequenceTask task = task_of(scene, motion);
    SequenceTask other = task;
    other.scene = "street";
    other.seed = options_.seed + kOtherStreet;
    SequenceTask lossy = task;
    lossy.targets = kDropTargets;
    lossy.stride = 1;
    lossy.crop.height = std::min(lossy.crop.height, kDropRows);
    const auto clean = simulate(task);
    const auto training = simulate(other);
    const auto stream = options_.drop > 0.0 ? simulate(lossy) : Result<CleanSequence>(CleanSequence{});
    for (const auto* made : {&clean, &training, &stream}) {
      if (!*made) return tl::unexpected(made->error());
    }
    std::vector<Noise> noises(options_.noises_k.size());
    Jobs jobs;
    for (std::size_t n = 0; n < noises.size(); ++n) {
      jobs.add([&, n]() -> Status {
        const double noise_k = options_.noises_k[n];
        noises[n].sequence = read_out(*clean, noise_k, options_.seed);
        noises[n].training = read_out(*training, noise_k, options_.seed + kOtherStreet);
        if (options_.drop > 0.0) noises[n].lossy = read_out(*stream, noise_k, options_.seed);
        return {};
      });
    }
    if (Status done = jobs.run(options_.threads, progress_, done_); !done) return done;
    for (Noise& noise : noises) add_jobs(jobs, noise, shows_latency(scene, motion));
    if (Status done = jobs.run(options_.threads, progress_, done_); !done) return done;
    for (Noise& noise : noises) collect(noise);
    return {};
  }

  void add_jobs(Jobs& jobs, Noise& noise, bool latency) {
    noise.cells.resize(options_.lookaheads.size());
    noise.drops.resize(options_.lookaheads.size());
    jobs.add([&noise]() -> Status {
      noise.spatial = spatial_columns(noise.sequence);
      return {};
    });
    if (latency) jobs.add(keep(noise.latency, [&noise] { return latency_curves(noise.sequence, kLongestLookahead); }));
    for (std::size_t l = 0; l < options_.lookaheads.size(); ++l) {
      const int lookahead = options_.lookaheads[l];
      jobs.add(
          keep(noise.cells[l], [&noise, lookahead] { return evaluate(noise.sequence, noise.training, lookahead); }));
      if (options_.drop <= 0.0) continue;
      jobs.add(keep(noise.drops[l], [this, &noise, lookahead] {
        return drop_rows(noise.lossy, lookahead, options_.drop, options_.seed);
      }));
    }
  }

  void collect(Noise& noise) {
    for (auto& cell : noise.cells) {
      cell->columns.insert(cell->columns.end(), noise.spatial.begin(), noise.spatial.end());
      std::ranges::sort(cell->columns, {}, &Column::kind);
      table_.cells.push_back(std::move(*cell));
    }
    for (auto& rows : noise.drops) {
      if (rows) table_.drops.insert(table_.drops.end(), rows->begin(), rows->end());
    }
    if (noise.latency) table_.latency.push_back(std::move(*noise.latency));
  }

  const Options& options_;
  int longest_;
  Progress progress_;
  std::uint64_t done_ = 0;
  Table table_;
};

Status run(const Options& options) {
  auto table = Evaluation(options).run();
  if (!table) return tl::unexpected(table.error());
  if (options.json) {
    std::printf("%s\n", to_json(options, *table).dump(2).c_str());
  } else {
    print_text(options, *table);
  }
  if (options.plot.empty()) return {};
  plot::Sheet sheet = sheet_of(*table);
  sheet.how = plot::format(
      "bolo-lab eval fidelity --frames %d --crop %dx%d --seed %llu: simulated camera, 200 frames/s, tau 11 ms.",
      options.frames, options.crop.width, options.crop.height, static_cast<unsigned long long>(options.seed));
  return save(sheet, options.plot);
}

}  // namespace

int eval_fidelity_main(int argc, char** argv) {
  auto cli = declare();
  cxxopts::ParseResult given;
  if (const auto code = parse(cli, argc, argv, given)) return *code;
  try {
    const auto options = options_of(given);
    if (!options) return report("eval fidelity", options.error());
    catch_interrupts();
    const Status done = run(*options);
    return done ? kExitDone : report("eval fidelity", done.error());
  } catch (const std::bad_alloc&) {
    return report("eval fidelity", {ErrorKind::kFailed, "not enough memory; take a smaller --crop or fewer --frames"});
  }
}

}  // namespace bolo::tools
