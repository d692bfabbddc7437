// The authors' `.mat` version 7.3 (HDF5 after 512 bytes of MATLAB's own): `t` 1 x n (s), `frames` n x width x height
// (kelvin) as MATLAB shows them; HDF5 lists dimensions in reverse, so `/frames` is (height, width, n) here.
#include <algorithm>
#include <cmath>

#include "src/capture/contents.hpp"

namespace bolo::capture {
namespace {

// MATLAB has no frame counter: whole periods that are missing in t are lost frames.
std::vector<std::uint64_t> ids_from_times(const std::vector<double>& t, double period_s) {
  constexpr double kMostPeriods = 1e15;  // keeps the rounding in range whatever t holds
  std::vector<std::uint64_t> id(t.size());
  for (std::size_t i = 1; i < t.size(); ++i) {
    const double periods = std::clamp(std::round((t[i] - t[i - 1]) / period_s), 1.0, kMostPeriods);
    id[i] = id[i - 1] + static_cast<std::uint64_t>(periods);
  }
  return id;
}

}  // namespace

bool looks_like_matlab_capture(hid_t file) {
  const h5::Handle group(H5Gopen2(file, "/", H5P_DEFAULT));
  return !h5::has_attribute({group.get(), "root"}, "format") && !h5::exists(file, "/frame_id") &&
         h5::exists(file, "/frames") && h5::exists(file, "/t");
}

Result<Contents> read_matlab_capture(hid_t file) {
  Contents contents;
  contents.file_format = FileFormat::kMatlab;
  Result<FrameStore> frames = FrameStore::open(file, "/frames", FrameOrder::kMatlab);
  if (!frames) return tl::unexpected<Error>(std::move(frames.error()));
  Result<std::vector<double>> t = h5::read_doubles(file, "/t");
  if (!t) return tl::unexpected<Error>(std::move(t.error()));
  if (t->size() != frames->frames()) {
    return bad_input("t has " + std::to_string(t->size()) +
                     " values but frames, in MATLAB's order n x width x height, is " +
                     std::to_string(frames->frames()) + " x " + std::to_string(frames->geometry().width) + " x " +
                     std::to_string(frames->geometry().height));
  }
  if (t->size() < 2) return bad_input("t has a single value; the frame period needs at least two frames");
  if (Status good = check_times(*t); !good) return tl::unexpected<Error>(std::move(good.error()));

  const double period_s = median_step(*t);
  contents.info.format = {frames->geometry(), frames->type(), LinearScale{Unit::kKelvin, 1.0, 0.0}, period_s, 1};
  contents.info.frames = frames->frames();
  contents.frame_id = ids_from_times(*t, period_s);
  contents.t = std::move(*t);
  contents.frames = std::move(*frames);
  check_plausible(contents);
  return contents;
}

}  // namespace bolo::capture
