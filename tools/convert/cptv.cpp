#include "tools/convert/footage.hpp"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include <fmt/format.h>

#include "src/core/clock.hpp"
#include "src/core/input_file.hpp"
#include "src/core/statistics.hpp"
#include "src/core/text.hpp"

namespace bolo::tools {
namespace {

constexpr std::uint32_t kMostCptvSide = 1U << 14;
constexpr std::size_t kMostPixelsOfAFrame = std::size_t{1} << 24;
constexpr unsigned kMostBits = 32;
constexpr std::size_t kMostFramesOfAFilm = 10'000'000;  // twelve days
constexpr std::size_t kMostBackgrounds = 16;            // cameras write one, before the first frame
constexpr std::uint32_t kCorrecting_ms = 2000;          // time in which a correction (NUC) is over
constexpr double kUsualRate_hz = 9.0;                   // of a Lepton, if neither header nor times state a rate

struct Header {
  Geometry geometry;
  std::int64_t recorded_us = 0;  // UTC since 1970; 0: unknown
  double rate_hz = 0.0;          // 0: unknown
  std::string device;
  std::string model;
  std::string serial;
};

struct FrameHead {
  std::uint32_t time_ms = 0;  // since the camera was switched on, as is:
  std::uint32_t ffc_ms = 0;   // the last correction (NUC)
  std::uint32_t bytes = 0;
  unsigned bits = 0;
  bool background = false;
};

class CptvFile {
 public:
  explicit CptvFile(const std::filesystem::path& file) : name_(file.string()), file_(gzopen(file.c_str(), "rb")) {}
  ~CptvFile() {
    if (file_ != nullptr) gzclose(file_);
  }
  CptvFile(const CptvFile&) = delete;
  CptvFile& operator=(const CptvFile&) = delete;

  // Call once, at the beginning of the file.
  Result<Header> read_header() {
    if (file_ == nullptr) return wrong("it cannot be opened");
    std::array<char, 7> begin{};  // "CPTV", the version, 'H', fields
    if (read(begin.data(), begin.size()) != begin.size() || std::memcmp(begin.data(), "CPTV", 4) != 0) {
      return wrong("it is no CPTV file");
    }
    if (begin[4] != 2) return wrong(fmt::format("it is CPTV version {}; 2 is read", static_cast<int>(begin[4])));
    if (begin[5] != 'H') return wrong("it has no header");
    Header header;
    int compression = -1;
    std::uint32_t width = 0;
    std::uint32_t height = 0;
    for (int left = static_cast<std::uint8_t>(begin[6]); left > 0; --left) {
      ASSIGN_OR_RETURN(const auto field, read_field());
      if (field.code == 'X') width = field.as<std::uint32_t>();
      if (field.code == 'Y') height = field.as<std::uint32_t>();
      if (field.code == 'C') compression = field.as<std::uint8_t>();
      if (field.code == 'T') header.recorded_us = field.as<std::int64_t>();
      if (field.code == 'Z') header.rate_hz = field.as<std::uint8_t>();
      if (field.code == 'D') header.device = field.text();
      if (field.code == 'E') header.model = field.text();
      if (field.code == 'N') {
        header.serial = field.bytes == sizeof(std::uint32_t) ? std::to_string(field.as<std::uint32_t>()) : field.text();
      }
    }
    if (width == 0 || width > kMostCptvSide || height == 0 || height > kMostCptvSide ||
        std::size_t{width} * height > kMostPixelsOfAFrame) {
      return wrong(fmt::format("its frames are {}x{}", width, height));
    }
    if (compression != 1) return wrong(fmt::format("its frames are compressed by scheme {}; 1 is read", compression));
    header.geometry = {static_cast<int>(width), static_cast<int>(height)};
    return header;
  }

  // Reads up to the frame's data; nothing at the end of the file.
  Result<std::optional<FrameHead>> read_frame_head(Geometry geometry) {
    std::array<std::uint8_t, 2> begin{};  // 'F', fields
    const std::size_t got = read(begin.data(), begin.size());
    int error = Z_OK;
    gzerror(file_, &error);
    if (got == 0 && error == Z_OK) return std::optional<FrameHead>{};
    if (got != begin.size()) return cut_off();
    if (begin[0] != 'F') return wrong("something other than a frame stands where one should begin");
    FrameHead frame;
    for (int left = begin[1]; left > 0; --left) {
      ASSIGN_OR_RETURN(const auto field, read_field());
      if (field.code == 't') frame.time_ms = field.as<std::uint32_t>();
      if (field.code == 'c') frame.ffc_ms = field.as<std::uint32_t>();
      if (field.code == 'f') frame.bytes = field.as<std::uint32_t>();
      if (field.code == 'w') frame.bits = field.as<std::uint8_t>();
      if (field.code == 'g') frame.background = field.as<std::uint8_t>() != 0;
    }
    if (frame.bits < 1 || frame.bits > kMostBits) return wrong(fmt::format("a frame has {} bits a pixel", frame.bits));
    const std::size_t least = 4 + ((geometry.pixels() - 1) * frame.bits + 7) / 8;
    if (frame.bytes < least || frame.bytes > 4 + 4 * geometry.pixels() + 8) {
      return wrong(fmt::format("a frame of {}x{} with {} bits a pixel has {} bytes", geometry.width, geometry.height,
                               frame.bits, frame.bytes));
    }
    return std::optional(frame);
  }

  Status read_data(std::vector<std::uint8_t>& data, std::size_t bytes) {
    data.resize(bytes);
    return read(data.data(), bytes) == bytes ? Status{} : cut_off();
  }
  tl::unexpected<Error> wrong(const std::string& what) const { return bad_input(name_ + ": " + what); }

 private:
  struct Field {
    char code = 0;
    std::size_t bytes = 0;
    std::array<char, 255> data{};

    // Reads a number; missing high bytes count as 0.
    template <typename T>
    T as() const {
      T value{};
      std::memcpy(&value, data.data(), std::min(bytes, sizeof value));
      return value;
    }
    std::string text() const { return printable(std::string(data.data(), bytes)); }
  };
  std::size_t read(void* out, std::size_t bytes) {
    const int done = gzread(file_, out, static_cast<unsigned>(bytes));
    return done < 0 ? 0 : static_cast<std::size_t>(done);
  }
  Result<Field> read_field() {
    std::array<std::uint8_t, 2> head{};
    Field field;
    if (read(head.data(), head.size()) != head.size()) return cut_off();
    field.bytes = head[0];
    field.code = static_cast<char>(head[1]);
    if (read(field.data.data(), field.bytes) != field.bytes) return cut_off();
    return field;
  }
  tl::unexpected<Error> cut_off() const {
    int error = Z_OK;
    if (file_ != nullptr) gzerror(file_, &error);
    return wrong(error == Z_DATA_ERROR ? "its gzip data are damaged" : "it is cut off");
  }

  std::string name_;
  gzFile file_;
};

// Adds a frame's differences to `plane`. False: a value exceeds 16 bits.
bool add_difference(const std::vector<std::uint8_t>& data, unsigned bits, Geometry geometry,
                    std::vector<std::uint16_t>& plane) {
  std::int32_t first = 0;
  std::memcpy(&first, data.data(), sizeof first);
  std::int64_t difference = first;
  std::size_t at = sizeof first;
  std::uint64_t waiting = 0;  // bits read but not used yet, in the lowest places
  unsigned count = 0;
  const auto width = static_cast<std::size_t>(geometry.width);
  for (std::size_t i = 0; i < plane.size(); ++i) {
    if (i > 0) {
      for (; count < bits; count += 8) waiting = waiting << 8U | data[at++];
      count -= bits;
      const std::uint64_t raw = waiting >> count & ((std::uint64_t{1} << bits) - 1);
      const std::uint64_t sign = std::uint64_t{1} << bits >> 1U;
      difference += static_cast<std::int64_t>(raw ^ sign) - static_cast<std::int64_t>(sign);  // two's complement
    }
    const std::size_t row = i / width;
    const std::size_t column = row % 2 == 0 ? i % width : width - 1 - i % width;
    std::uint16_t& pixel = plane[row * width + column];
    const std::int64_t value = pixel + difference;
    if (value < 0 || value > std::numeric_limits<std::uint16_t>::max()) return false;
    pixel = static_cast<std::uint16_t>(value);
  }
  return true;
}

class CptvFootage final : public Footage {
 public:
  explicit CptvFootage(const std::filesystem::path& file) : path_(file), file_(std::make_unique<CptvFile>(file)) {}

  Status open(const StatedFormat& stated) {
    CptvFile scanned(path_);
    ASSIGN_OR_RETURN(header_, scanned.read_header());
    plane_.resize(header_.geometry.pixels());
    std::vector<std::uint8_t> data;
    for (std::size_t backgrounds = 0;;) {
      ASSIGN_OR_RETURN(const auto frame, scanned.read_frame_head(header_.geometry));
      if (!frame) break;
      if (Status good = scanned.read_data(data, frame->bytes); !good) return good;
      if (!frame->background) heads_.push_back(*frame);
      if (frame->background && ++backgrounds > kMostBackgrounds)
        return scanned.wrong(fmt::format("it has more than {} background frames", kMostBackgrounds));
      if (heads_.size() > kMostFramesOfAFilm)
        return scanned.wrong(fmt::format("it has more than {} frames", kMostFramesOfAFilm));
    }
    if (heads_.empty()) return scanned.wrong("it has no frame");
    describe(stated);
    const auto again = file_->read_header();
    return again ? Status{} : tl::unexpected<Error>(again.error());
  }

  Status read(std::size_t index, Frame& frame) override {
    for (; next_ <= index; ++next_) {
      if (Status good = read_next(); !good) return good;
    }
    frame.t_s = times_s_[index];
    frame.id = index;
    frame.u16 = plane_;
    return {};
  }

  Result<Extras> extras() const override {
    Extras extras;
    for (std::size_t i = 1; i < heads_.size(); ++i) {
      const FrameHead& head = heads_[i];
      const bool just_now = head.ffc_ms <= head.time_ms && head.time_ms - head.ffc_ms < kCorrecting_ms;
      if (head.ffc_ms == heads_[i - 1].ffc_ms || !just_now) continue;
      extras.events.push_back({times_s_[i], "nuc"});
    }
    extras.attributes.push_back({"device_name", header_.device});
    if (header_.recorded_us > 0 && header_.recorded_us < kLastUtc_us) {
      extras.attributes.push_back({"recorded_at", utc_text(header_.recorded_us * 1000)});
    }
    return extras;
  }

 private:
  static constexpr std::int64_t kLastUtc_us = 4'000'000'000'000'000;  // the year 2096

  // Uses the camera's times if they rise, else its rate.
  void describe(const StatedFormat& stated) {
    std::vector<double> steps_s;
    for (std::size_t i = 1; i < heads_.size(); ++i) {
      steps_s.push_back(1e-3 * (static_cast<double>(heads_[i].time_ms) - static_cast<double>(heads_[i - 1].time_ms)));
    }
    const bool rise = std::all_of(steps_s.begin(), steps_s.end(), [](double s) { return s > 0.0; });
    const double measured_s = rise && !steps_s.empty() ? median(steps_s) : 0.0;
    const double rate_hz = header_.rate_hz > 0.0 ? header_.rate_hz : kUsualRate_hz;
    const double period_s = measured_s > 0.0 ? measured_s : 1.0 / rate_hz;
    for (std::size_t i = 0; i < heads_.size(); ++i) {
      times_s_.push_back(rise ? 1e-3 * heads_[i].time_ms : static_cast<double>(i) * period_s);
    }
    info_.format.geometry = header_.geometry;
    info_.format.type = PixelType::kUint16;
    info_.format.scale = stated.scale.value_or(LinearScale{Unit::kCount, 1.0, 0.0});
    info_.format.frame_period_s = period_s;
    info_.camera_model = header_.model;
    info_.camera_serial = header_.serial;
    info_.frames = heads_.size();
  }

  // Reads the next frame into plane_. Background frames are differences, too: they are applied and skipped.
  Status read_next() {
    for (;;) {
      ASSIGN_OR_RETURN(const auto head, file_->read_frame_head(header_.geometry));
      if (!head) return file_->wrong("it has changed meanwhile");
      if (Status good = file_->read_data(data_, head->bytes); !good) return good;
      if (!add_difference(data_, head->bits, header_.geometry, plane_)) {
        return file_->wrong(fmt::format("frame {} has a value beyond 16 bits: it is damaged", next_));
      }
      if (!head->background) return {};
    }
  }

  std::filesystem::path path_;
  std::unique_ptr<CptvFile> file_;  // positioned before the next frame
  Header header_;
  std::vector<FrameHead> heads_;
  std::vector<double> times_s_;
  std::vector<std::uint16_t> plane_;  // the last frame
  std::vector<std::uint8_t> data_;
  std::size_t next_ = 0;
};

}  // namespace

Result<std::unique_ptr<Footage>> open_cptv(const std::filesystem::path& file, const StatedFormat& stated) {
  RETURN_IF_ERROR(open_input(file));
  auto footage = std::make_unique<CptvFootage>(file);
  RETURN_IF_ERROR(footage->open(stated));
  return footage;
}

}  // namespace bolo::tools
