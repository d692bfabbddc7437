#include "tools/lab/detect/run.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <utility>

#include "tools/lab/detect/detector.hpp"
#include "tools/lab/detect/learned.hpp"
#include "tools/lab/detect/view_truth.hpp"
#include "tools/lab/eval/jobs.hpp"

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
    auto detector = Detector::open(description, options.classes);
    if (!detector) return tl::unexpected(detector.error());
    networks.detectors.push_back(std::move(*detector));
  }
  for (const std::filesystem::path& file : options.models) {
    auto model = LearnedDeblurring::open(file);
    if (!model) return tl::unexpected(model.error());
    networks.models.push_back(std::move(*model));
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
    if (Status ready = prepare(); !ready) return tl::unexpected(ready.error());
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
    if (Status outcome = jobs.run(options_.threads, progress, done); !outcome) return tl::unexpected(outcome.error());
    return std::move(found_);
  }

 private:
  Status prepare() {
    for (int i = 0; i < options_.threads; ++i) {
      auto networks = open_networks(options_);
      if (!networks) return tl::unexpected(networks.error());
      if (i == 0) {
        describe(*networks);
        if (Status good = try_out(*networks); !good) return good;
      }
      lender_.add(std::move(*networks));
    }
    for (const std::filesystem::path& file : options_.scenes) {
      auto still = read_still(file, options_.classes);
      if (!still) return tl::unexpected(still.error());
      found_.stills.push_back(std::move(*still));
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
      if (auto boxes = detector.detect(grey, options_.picture); !boxes) return tl::unexpected(boxes.error());
    }
    for (LearnedDeblurring& model : networks.models) {
      if (auto made = model.apply(grey, options_.picture); !made) return tl::unexpected(made.error());
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
    const auto clean = simulate(still, options_.trajectories[look.view.motion], look.view, options_.picture);
    if (!clean) return tl::unexpected(clean.error());
    look.speed_px_s = std::hypot(clean->content_v.front().x_px, clean->content_v.front().y_px);
    if (still.labelled) {
      look.labels = truth_in_view(still.labels, static_cast<int>(options_.classes.size()), still.size, options_.picture,
                                  look.view.looks_at);
    }
    auto shown = shown_columns(fidelity::read_out(*clean, options_.noise_k, options_.seed + index));
    if (!shown) return tl::unexpected(shown.error());
    for (LearnedDeblurring& model : networks.models) {
      auto made = model.apply((*shown)[kBlurredColumn].levels, options_.picture);
      if (!made) return tl::unexpected(made.error());
      shown->push_back({std::move(*made), {}});
    }
    return detect(index, *shown, networks.detectors);
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

}  // namespace

Result<Found> run(const Options& options) { return Runner(options).run(); }

}  // namespace bolo::tools::detect
