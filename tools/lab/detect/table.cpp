#include <algorithm>
#include <mutex>

#include "src/core/statistics.hpp"
#include "tools/lab/detect/table.hpp"

namespace bolo::tools::detect {
namespace {

using Networks = std::vector<Detector>;  // one set per thread

Result<Networks> open_networks(const Options& options) {
  Networks networks;
  for (const DetectorDescription& description : options.detectors) {
    ASSIGN_OR_RETURN(auto detector, Detector::open(description, options.classes));
    networks.push_back(std::move(detector));
  }
  return networks;
}

class Runner {
 public:
  explicit Runner(const Options& options) : options_(options) {}

  Result<Found> run() {
    RETURN_IF_ERROR(prepare());
    Progress progress("detect", found_.observations.size());
    std::uint64_t done = 0;
    Jobs jobs;
    for (std::size_t i = 0; i < found_.observations.size(); ++i) {
      jobs.add([this, i]() -> Status {
        Networks networks = [this] {
          const std::lock_guard lock(mutex_);
          Networks free = std::move(free_.back());
          free_.pop_back();
          return free;
        }();
        Status outcome = observe(i, networks);
        const std::lock_guard lock(mutex_);
        free_.push_back(std::move(networks));
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
        RETURN_IF_ERROR(try_out(networks));
      }
      free_.push_back(std::move(networks));
    }
    for (const std::filesystem::path& file : options_.scenes) {
      ASSIGN_OR_RETURN(auto still, read_still(file, options_.classes));
      found_.stills.push_back(std::move(still));
    }
    ASSIGN_OR_RETURN(const auto views, plan_views(found_.stills, options_.trajectories,
                                                  {options_.picture, options_.repeats, options_.seed}));
    for (const View& view : views) found_.observations.emplace_back().view = view;
    return {};
  }

  void describe(const Networks& networks) {
    for (const Detector& detector : networks) {
      std::vector<bool>& knows = found_.knows.emplace_back();
      for (std::size_t label = 0; label < options_.classes.size(); ++label) {
        knows.push_back(detector.knows(static_cast<int>(label)));
      }
    }
  }

  // Finds errors of description and network before minutes of simulation.
  Status try_out(Networks& networks) const {
    const Levels grey(options_.picture.pixels(), 128.0F);
    for (Detector& detector : networks) RETURN_IF_ERROR(detector.detect(grey, options_.picture));
    return {};
  }

  Status observe(std::size_t index, Networks& networks) {
    Observation& observation = found_.observations[index];
    const Still& still = found_.stills[observation.view.still];
    ASSIGN_OR_RETURN(const auto clean, simulate(still, options_.trajectories[observation.view.motion], observation.view,
                                                options_.picture));
    observation.speed_px_s = std::hypot(clean.content_v.front().x_px, clean.content_v.front().y_px);
    if (still.labelled) {
      observation.labels = truth_in_view(still.labels, static_cast<int>(options_.classes.size()), still.size,
                                         options_.picture, observation.view.origin);
    }
    ASSIGN_OR_RETURN(const auto shown,
                     shown_columns(fidelity::read_out(clean, options_.noise_k, options_.seed + index)));
    for (Detector& detector : networks) {
      auto& found = observation.found.emplace_back();
      for (const Levels& one : shown) {
        ASSIGN_OR_RETURN(auto boxes, detector.detect(one, options_.picture));
        found.push_back(std::move(boxes));
      }
    }
    return {};
  }

  const Options& options_;
  Found found_;
  std::mutex mutex_;
  std::vector<Networks> free_;  // one per thread
};

constexpr double kPercent = 100.0;

// AP of each column in percent: of the data, and of each bootstrap draw.
struct Scores {
  double objects = 0.0;
  std::vector<double> ap;
  std::vector<std::vector<double>> draws;  // [column][draw]
};

// Observations in one motion, of stills either with labels or without.
struct Group {
  std::size_t motion = 0;
  bool labelled = false;
  std::vector<const Observation*> observations;
  std::vector<std::size_t> stills;  // those that can be drawn
};

void add(Json& to, const std::string& key, double value, std::vector<double> draws) {
  const Interval interval = interval_95(std::move(draws));
  to[key] = value;
  to[key + "_ci95"] = std::isfinite(interval.low) ? Json{interval.low, interval.high} : Json();
}

// (AP - blurred) / (sharp - blurred); undefined if blur costs nothing.
double share_recovered(double ap, double blurred, double sharp) {
  constexpr double kLeastLoss = 0.1;  // percent points
  return sharp - blurred > kLeastLoss ? (ap - blurred) / (sharp - blurred) : kNoScore;
}

Json cell_of(const Scores& s, std::size_t column) {
  const std::vector<double>& draws = s.draws[column];
  const std::vector<double>& blurred = s.draws[kBlurredColumn];
  std::vector<double> gained;
  std::vector<double> recovered;
  for (std::size_t i = 0; i < draws.size(); ++i) {
    gained.push_back(draws[i] - blurred[i]);
    recovered.push_back(share_recovered(draws[i], blurred[i], s.draws[kSharpColumn][i]));
  }
  Json cell;
  add(cell, "ap", s.ap[column], draws);
  add(cell, "delta_ap", s.ap[column] - s.ap[kBlurredColumn], std::move(gained));
  add(cell, "recovered", share_recovered(s.ap[column], s.ap[kBlurredColumn], s.ap[kSharpColumn]), std::move(recovered));
  return cell;
}

// Boxes that a detector should find: labels of the classes that it knows, or, without labels, its own boxes on the
// sharp frame with a score of at least `truth_score`.
std::vector<Truth> truth_of(const Observation& observation, bool labelled, std::size_t detector, double truth_score,
                            const std::vector<bool>& knows) {
  std::vector<Truth> truth;
  if (labelled) {
    std::ranges::copy_if(observation.labels, std::back_inserter(truth),
                         [&](const Truth& one) { return knows[static_cast<std::size_t>(one.label)]; });
    return truth;
  }
  for (const Detection& one : observation.found[detector][kSharpColumn]) {
    if (one.score >= truth_score) truth.push_back({one.label, one.box});
  }
  return truth;
}

class Judge {
 public:
  Judge(const Found& found, const Options& options) : found_(found), options_(options) {}

  Scores score(const Group& group, std::size_t detector, const std::vector<bool>& knows) const {
    Scores scores;
    for (std::size_t column = 0; column < columns().size(); ++column) {
      const Evaluator evaluator = evaluator_of(group, detector, column, knows);
      const ApScore score = evaluator.score();
      scores.objects = score.objects;
      scores.ap.push_back(kPercent * score.ap);
      std::vector<double>& draws = scores.draws.emplace_back();
      for (int i = 0; i < options_.resamples; ++i) {
        draws.push_back(kPercent * evaluator.score(weights(group, static_cast<std::uint64_t>(i))).ap);
      }
    }
    return scores;
  }

  // `detector`: null for the mean of all.
  Json row(const Group& group, const Json& detector, const Scores& scores) const {
    Json cells;
    for (std::size_t i = 0; i < columns().size(); ++i) cells[columns()[i].name] = cell_of(scores, i);
    return {{"truth", group.labelled ? "labels" : "own_boxes"},
            {"detector", detector},
            {"motion", options_.trajectories[group.motion].stem().string()},
            {"looks", group.observations.size()},
            {"stills", group.stills.size()},
            {"objects", scores.objects},
            {"columns", cells}};
  }

 private:
  Evaluator evaluator_of(const Group& group, std::size_t detector, std::size_t column,
                         const std::vector<bool>& knows) const {
    std::vector<ImageBoxes> images;
    for (const Observation* observation : group.observations) {
      images.push_back(
          {truth_of(*observation, group.labelled, detector, options_.detectors[detector].truth_score, knows),
           observation->found[detector][column]});
    }
    return {images, static_cast<int>(options_.classes.size())};
  }

  // The same stills are drawn for every column, detector and motion, so that differences compare the same stills.
  std::vector<int> weights(const Group& group, std::uint64_t draw) const {
    const std::vector<int> times = drawn_scenes(group.stills.size(), options_.seed, draw);
    std::vector<int> weights;
    for (const Observation* observation : group.observations) {
      const auto at = std::ranges::find(group.stills, observation->view.still) - group.stills.begin();
      weights.push_back(times[static_cast<std::size_t>(at)]);
    }
    return weights;
  }

  const Found& found_;
  const Options& options_;
};

// Mean over the detectors with something to find, draw by draw.
Scores mean_of(std::vector<Scores> several) {
  std::erase_if(several, [](const Scores& one) { return !std::isfinite(one.ap.front()); });
  const auto count = static_cast<double>(several.size());
  const auto mean_at = [&](auto of) { return sum_of(several, of) / count; };
  Scores mean{sum_of(several, &Scores::objects), {}, {}};
  for (std::size_t column = 0; column < several.front().ap.size(); ++column) {
    mean.ap.push_back(mean_at([&](const Scores& one) { return one.ap[column]; }));
    std::vector<double>& draws = mean.draws.emplace_back();
    for (std::size_t i = 0; i < several.front().draws[column].size(); ++i) {
      draws.push_back(mean_at([&](const Scores& one) { return one.draws[column][i]; }));
    }
  }
  return mean;
}

Group group_of(const Found& found, std::size_t motion, bool labelled) {
  Group group{motion, labelled, {}, {}};
  for (const Observation& observation : found.observations) {
    if (observation.view.motion != motion || found.stills[observation.view.still].labelled != labelled) continue;
    group.observations.push_back(&observation);
    if (std::ranges::find(group.stills, observation.view.still) == group.stills.end())
      group.stills.push_back(observation.view.still);
  }
  return group;
}

std::vector<double> speeds_of(const Found& found, std::size_t motion) {
  std::vector<double> speeds;
  for (const Observation& observation : found.observations) {
    if (observation.view.motion == motion) speeds.push_back(observation.speed_px_s);
  }
  return speeds;
}

}  // namespace

Result<Found> run(const Options& options) { return Runner(options).run(); }

Json table_of(const Found& found, const Options& options) {
  Json motions = Json::array();
  std::vector<std::pair<double, std::size_t>> order;  // by speed
  for (std::size_t motion = 0; motion < options.trajectories.size(); ++motion) {
    const auto speed = [&](double share) { return bolo::quantile(speeds_of(found, motion), share); };
    motions.push_back({{"name", options.trajectories[motion].stem().string()},
                       {"speed_px_s", {{"p10", speed(0.1)}, {"p50", speed(0.5)}, {"p90", speed(0.9)}}}});
    order.emplace_back(speed(0.5), motion);
  }
  std::ranges::sort(order);
  const Judge judge(found, options);
  Json rows = Json::array();
  for (const bool labelled : {true, false}) {
    for (const auto& [speed, motion] : order) {
      const Group group = group_of(found, motion, labelled);
      if (group.observations.empty()) continue;
      std::vector<Scores> all;
      for (std::size_t d = 0; d < options.detectors.size(); ++d) {
        all.push_back(judge.score(group, d, found.knows[d]));
        rows.push_back(judge.row(group, options.detectors[d].name, all.back()));
      }
      const auto finite = [](const Scores& one) { return std::isfinite(one.ap.front()); };
      if (std::ranges::count_if(all, finite) > 1) rows.push_back(judge.row(group, {}, mean_of(all)));
    }
  }
  return {{"settings",
           {{"picture", {options.picture.width, options.picture.height}},
            {"repeats", options.repeats},
            {"noise_k", options.noise_k},
            {"resamples", options.resamples},
            {"seed", options.seed}}},
          {"columns", list_of(columns(),
                              [](const Column& c) {
                                return Json{{"name", c.name}, {"words", c.words}};
                              })},
          {"motions", motions},
          {"rows", rows}};
}

}  // namespace bolo::tools::detect
