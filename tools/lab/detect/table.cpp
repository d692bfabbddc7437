#include "tools/lab/detect/table.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <numeric>
#include <utility>

#include "src/core/statistics.hpp"
#include "src/report/text.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/detect/boxes.hpp"
#include "tools/lab/detect/detector.hpp"
#include "tools/lab/detect/network.hpp"

namespace bolo::tools::detect {
namespace {

// Networks are used by one thread at a time: one of these a thread.
struct Networks {
  std::vector<Detector> detectors;
  std::vector<LearnedDeblurring> models;
};

// Lends each of several things to one thread at a time.
template <typename T>
class Lender {
 public:
  void add(T one) { free_.push_back(std::make_unique<T>(std::move(one))); }

  // There must be as many as threads that ask.
  std::unique_ptr<T> take() {
    const std::lock_guard lock(mutex_);
    std::unique_ptr<T> one = std::move(free_.back());
    free_.pop_back();
    return one;
  }
  void give_back(std::unique_ptr<T> one) {
    const std::lock_guard lock(mutex_);
    free_.push_back(std::move(one));
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<T>> free_;
};

Result<Networks> open_networks(const Options& options) {
  Networks networks;
  for (const DetectorDescription& description : options.detectors) {
    ASSIGN_OR_RETURN(auto detector, Detector::open(description, options.classes));
    networks.detectors.push_back(std::move(detector));
  }
  for (const std::filesystem::path& file : options.models) {
    ASSIGN_OR_RETURN(auto model, LearnedDeblurring::open(file));
    networks.models.push_back(std::move(model));
  }
  return networks;
}

std::vector<Column> columns_with(const std::vector<LearnedDeblurring>& models) {
  std::vector<Column> columns = own_columns();
  for (const LearnedDeblurring& model : models) {
    columns.push_back(
        {ColumnKind::kLearned, "model:" + model.name(), model.name(), "the given network " + model.name()});
  }
  return columns;
}

class Runner {
 public:
  explicit Runner(const Options& options) : options_(options) {}

  Result<Found> run() {
    RETURN_IF_ERROR(prepare());
    Progress progress("detect", found_.looks.size());
    std::uint64_t done = 0;
    Jobs jobs;
    for (std::size_t i = 0; i < found_.looks.size(); ++i) {
      jobs.add([this, i]() -> Status {
        std::unique_ptr<Networks> networks = lender_.take();
        Status outcome = look(i, *networks);
        lender_.give_back(std::move(networks));
        return outcome;
      });
    }
    RETURN_IF_ERROR(jobs.run(options_.threads, progress, done));
    return std::move(found_);
  }

 private:
  Status prepare() {
    for (int i = 0; i < options_.threads; ++i) {
      ASSIGN_OR_RETURN(auto networks, open_networks(options_));
      if (i == 0) {
        describe(networks);
        if (Status good = try_out(networks); !good) return good;
      }
      lender_.add(std::move(networks));
    }
    for (const std::filesystem::path& file : options_.scenes) {
      ASSIGN_OR_RETURN(auto still, read_still(file, options_.classes));
      found_.stills.push_back(std::move(still));
    }
    const auto views =
        plan_views(found_.stills, options_.trajectories, {options_.picture, options_.repeats, options_.seed});
    if (!views) return tl::unexpected(views.error());
    for (const View& view : *views) found_.looks.emplace_back().view = view;
    if (!options_.plot.empty()) choose_exhibits();
    return {};
  }

  void describe(const Networks& networks) {
    found_.columns = columns_with(networks.models);
    for (const Detector& detector : networks.detectors) {
      std::vector<bool>& knows = found_.knows.emplace_back();
      for (std::size_t label = 0; label < options_.classes.size(); ++label) {
        knows.push_back(detector.knows(static_cast<int>(label)));
      }
    }
  }

  // What does not fit is told before minutes of simulation.
  Status try_out(Networks& networks) const {
    const Levels grey(options_.picture.pixels(), 128.0F);
    for (Detector& detector : networks.detectors) {
      RETURN_IF_ERROR(detector.detect(grey, options_.picture));
    }
    for (LearnedDeblurring& model : networks.models) {
      RETURN_IF_ERROR(model.apply(grey, options_.picture));
    }
    return {};
  }

  // Of each motion the first look at a still with the most labels.
  void choose_exhibits() {
    for (std::size_t motion = 0; motion < options_.trajectories.size(); ++motion) {
      std::size_t best = found_.looks.size();
      for (std::size_t i = 0; i < found_.looks.size(); ++i) {
        if (found_.looks[i].view.motion != motion) continue;
        if (best == found_.looks.size() || labels_of(i) > labels_of(best)) best = i;
      }
      if (best < found_.looks.size()) found_.exhibits.push_back({best, {}});
    }
  }
  std::size_t labels_of(std::size_t look) const { return found_.stills[found_.looks[look].view.still].labels.size(); }

  Status look(std::size_t index, Networks& networks) {
    Look& look = found_.looks[index];
    const Still& still = found_.stills[look.view.still];
    ASSIGN_OR_RETURN(const auto clean,
                     simulate(still, options_.trajectories[look.view.motion], look.view, options_.picture));
    look.speed_px_s = std::hypot(clean.content_v.front().x_px, clean.content_v.front().y_px);
    if (still.labelled) {
      look.labels = truth_in_view(still.labels, static_cast<int>(options_.classes.size()), still.size, options_.picture,
                                  look.view.looks_at);
    }
    ASSIGN_OR_RETURN(auto shown, shown_columns(fidelity::read_out(clean, options_.noise_k, options_.seed + index)));
    for (LearnedDeblurring& model : networks.models) {
      ASSIGN_OR_RETURN(auto made, model.apply(shown[kBlurredColumn].levels, options_.picture));
      shown.push_back({std::move(made), {}});
    }
    return detect(index, shown, networks.detectors);
  }

  Status detect(std::size_t index, std::vector<Shown>& shown, std::vector<Detector>& detectors) {
    Look& look = found_.looks[index];
    look.found.resize(detectors.size());
    for (const Shown& one : shown) {
      look.settings.push_back(one.setting);
      for (std::size_t d = 0; d < detectors.size(); ++d) {
        auto boxes = detectors[d].detect(one.levels, options_.picture);
        if (!boxes) return tl::unexpected(boxes.error());
        look.found[d].push_back(std::move(*boxes));
      }
    }
    for (Exhibit& exhibit : found_.exhibits) {
      if (exhibit.look != index) continue;
      for (Shown& one : shown) exhibit.frames.push_back(std::move(one.levels));
    }
    return {};
  }

  const Options& options_;
  Found found_;
  Lender<Networks> lender_;
};

constexpr double kPercent = 100.0;

// AP of each column, in percent: as it is, and in each draw of the bootstrap.
struct Scores {
  std::vector<ApScore> all;
  std::vector<double> ap;
  std::vector<std::vector<double>> draws;  // [column][draw]
};

// The looks of one motion over stills with or without labels.
struct Group {
  std::size_t motion = 0;
  bool labelled = false;
  std::vector<const Look*> looks;
  std::vector<std::size_t> stills;  // those that can be drawn
};

class Figures {
 public:
  explicit Figures(const Scores& scores) : s_(scores) {}

  Figure ap(std::size_t column) const { return {s_.ap[column], interval_95(s_.draws[column])}; }

  Figure difference(std::size_t column, std::size_t from) const {
    std::vector<double> draws(s_.draws[column].size());
    for (std::size_t i = 0; i < draws.size(); ++i) draws[i] = s_.draws[column][i] - s_.draws[from][i];
    return {s_.ap[column] - s_.ap[from], interval_95(std::move(draws))};
  }

  Figure recovered(std::size_t column) const {
    std::vector<double> draws(s_.draws[column].size());
    for (std::size_t i = 0; i < draws.size(); ++i) {
      draws[i] = share(s_.draws[column][i], s_.draws[kBlurredColumn][i], s_.draws[kSharpColumn][i]);
    }
    return {share(s_.ap[column], s_.ap[kBlurredColumn], s_.ap[kSharpColumn]), interval_95(std::move(draws))};
  }

 private:
  // Of a loss that there is none of, nothing can be recovered.
  static double share(double ap, double blurred, double sharp) {
    constexpr double kLeastLoss = 0.1;  // percent points
    return sharp - blurred > kLeastLoss ? (ap - blurred) / (sharp - blurred) : kNoScore;
  }

  const Scores& s_;
};

class Judge {
 public:
  Judge(const Found& found, const Options& options) : found_(found), options_(options) {}

  Scores score(const Group& group, std::size_t detector, const std::vector<bool>& knows) const {
    Scores scores;
    for (std::size_t column = 0; column < found_.columns.size(); ++column) {
      const Evaluator evaluator = evaluator_of(group, detector, column, knows);
      scores.all.push_back(evaluator.score());
      scores.ap.push_back(kPercent * scores.all.back().total.ap);
      std::vector<double>& draws = scores.draws.emplace_back();
      for (int i = 0; i < options_.resamples; ++i) {
        draws.push_back(kPercent * evaluator.score(weights(group, static_cast<std::uint64_t>(i))).total.ap);
      }
    }
    return scores;
  }

  Row row(const Group& group, std::string detector, const Scores& scores) const {
    Row row;
    row.labelled = group.labelled;
    row.detector = std::move(detector);
    row.motion = group.motion;
    row.looks = static_cast<int>(group.looks.size());
    row.stills = static_cast<int>(group.stills.size());
    const Figures figures(scores);
    for (std::size_t column = 0; column < found_.columns.size(); ++column) {
      row.cells.push_back({scores.all[column], figures.ap(column), figures.difference(column, kBlurredColumn),
                           figures.recovered(column)});
    }
    row.contest = contest_of(scores, figures);
    return row;
  }

 private:
  Evaluator evaluator_of(const Group& group, std::size_t detector, std::size_t column,
                         const std::vector<bool>& knows) const {
    std::vector<ImageBoxes> images;
    for (const Look* look : group.looks) {
      images.push_back({truth_of(*look, group.labelled, detector, options_.detectors[detector].truth_score, knows),
                        look->found[detector][column]});
    }
    ApSettings settings;
    settings.least_area_px2 = options_.least_area_px2;
    return {images, static_cast<int>(options_.classes.size()), settings};
  }

  // The same stills are drawn for every column, detector and motion, so that differences are of the same stills.
  std::vector<int> weights(const Group& group, std::uint64_t draw) const {
    const std::vector<int> times = drawn_scenes(group.stills.size(), options_.seed, draw);
    std::vector<int> weights;
    for (const Look* look : group.looks) {
      const auto at = std::ranges::find(group.stills, look->view.still) - group.stills.begin();
      weights.push_back(times[static_cast<std::size_t>(at)]);
    }
    return weights;
  }

  Contest contest_of(const Scores& scores, const Figures& figures) const {
    const auto best = [&](auto&& of_this_kind) {
      std::size_t choice = kBlurredColumn;
      for (std::size_t column = 0; column < found_.columns.size(); ++column) {
        if (!of_this_kind(found_.columns[column].kind)) continue;
        if (choice == kBlurredColumn || scores.ap[column] > scores.ap[choice]) choice = column;
      }
      return choice;
    };
    Contest contest;
    contest.bolo = best([](ColumnKind kind) { return kind == ColumnKind::kBolo; });
    contest.baseline =
        best([](ColumnKind kind) { return kind == ColumnKind::kBaseline || kind == ColumnKind::kLearned; });
    contest.delta = figures.difference(contest.bolo, contest.baseline);
    return contest;
  }

  const Found& found_;
  const Options& options_;
};

// The mean of the detectors that had something to find, draw by draw.
Scores mean_of(std::vector<Scores> several) {
  Scores mean;
  std::erase_if(several, [](const Scores& one) { return !std::isfinite(one.ap.front()); });
  const auto count = static_cast<double>(several.size());
  for (std::size_t column = 0; column < several.front().ap.size(); ++column) {
    double sum = 0.0;
    double objects = 0.0;
    std::vector<double> draws(several.front().draws[column].size(), 0.0);
    for (const Scores& one : several) {
      sum += one.ap[column];
      objects += one.all[column].total.objects;
      for (std::size_t i = 0; i < draws.size(); ++i) draws[i] += one.draws[column][i];
    }
    for (double& draw : draws) draw /= count;
    mean.ap.push_back(sum / count);
    mean.draws.push_back(std::move(draws));
    ApScore& score = mean.all.emplace_back();
    score.total.ap = sum / count / kPercent;
    score.total.objects = objects;
  }
  return mean;
}

Group group_of(const Found& found, std::size_t motion, bool labelled) {
  Group group{motion, labelled, {}, {}};
  for (const Look& look : found.looks) {
    if (look.view.motion != motion || found.stills[look.view.still].labelled != labelled) continue;
    group.looks.push_back(&look);
    if (std::ranges::find(group.stills, look.view.still) == group.stills.end()) group.stills.push_back(look.view.still);
  }
  return group;
}

Speeds speeds_of(const Found& found, std::size_t motion) {
  std::vector<double> speeds;
  for (const Look& look : found.looks) {
    if (look.view.motion == motion) speeds.push_back(look.speed_px_s);
  }
  return {bolo::quantile(speeds, 0.1), bolo::quantile(speeds, 0.5), bolo::quantile(speeds, 0.9)};
}

}  // namespace

Result<Found> run(const Options& options) { return Runner(options).run(); }

std::vector<Truth> truth_of(const Look& look, bool labelled, std::size_t detector, double truth_score,
                            const std::vector<bool>& knows) {
  std::vector<Truth> truth;
  if (labelled) {
    std::ranges::copy_if(look.labels, std::back_inserter(truth),
                         [&](const Truth& one) { return knows[static_cast<std::size_t>(one.label)]; });
    return truth;
  }
  for (const Detection& one : look.found[detector][kSharpColumn]) {
    if (one.score >= truth_score) truth.push_back({one.label, one.box});
  }
  return truth;
}

std::string motion_words(const Table& table, std::size_t motion) {
  return plot::format("%s (median %.0f px/s)", table.motions[motion].c_str(), table.speeds[motion].p50);
}

Table table_of(const Found& found, const Options& options) {
  Table table;
  table.columns = found.columns;
  for (std::size_t motion = 0; motion < options.trajectories.size(); ++motion) {
    table.motions.push_back(options.trajectories[motion].stem().string());
    table.speeds.push_back(speeds_of(found, motion));
  }
  std::vector<std::size_t> order(table.motions.size());
  std::iota(order.begin(), order.end(), 0U);
  std::ranges::stable_sort(order, {}, [&](std::size_t motion) { return table.speeds[motion].p50; });
  const Judge judge(found, options);
  for (const bool labelled : {true, false}) {
    for (const std::size_t motion : order) {
      const Group group = group_of(found, motion, labelled);
      if (group.looks.empty()) continue;
      std::vector<Scores> all;
      for (std::size_t d = 0; d < options.detectors.size(); ++d) {
        all.push_back(judge.score(group, d, found.knows[d]));
        table.rows.push_back(judge.row(group, options.detectors[d].name, all.back()));
      }
      const auto finite = [](const Scores& one) { return std::isfinite(one.ap.front()); };
      if (std::ranges::count_if(all, finite) > 1) table.rows.push_back(judge.row(group, {}, mean_of(all)));
    }
  }
  return table;
}

}  // namespace bolo::tools::detect
