#include <bit>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>

#include "src/core/byte_order.hpp"
#include "tools/convert/footage.hpp"

namespace bolo::tools {
namespace {

static_assert(std::endian::native == std::endian::little, "values are read as the machine has them");

struct Dump {
  std::filesystem::path file;
  std::size_t first = 0;  // number of its first frame
};

class RawFootage final : public Footage {
 public:
  RawFootage(std::vector<Dump> dumps, std::size_t frames, const RawLayout& layout, const Told& told)
      : dumps_(std::move(dumps)), layout_(layout) {
    StreamFormat& format = info_.format;
    format.geometry = layout.geometry;
    format.type = layout.type == RawLayout::Type::kF32 ? PixelType::kFloat32 : PixelType::kUint16;
    format.frame_period_s = 1.0 / told.rate_hz;
    format.scale = scale_of(format.type, told);
    info_.frames = frames;
  }

  Status read(std::size_t index, Frame& frame) override {
    if (next_ < dumps_.size() && index == dumps_[next_].first) {
      if (Status good = open(dumps_[next_++].file); !good) return good;
    }
    frame.t_s = static_cast<double>(index) * info_.format.frame_period_s;
    frame.id = index;
    frame.u16.resize(layout_.type == RawLayout::Type::kF32 ? 0 : layout_.geometry.pixels());
    frame.f32.resize(layout_.type == RawLayout::Type::kF32 ? layout_.geometry.pixels() : 0);
    char* out =
        frame.u16.empty() ? reinterpret_cast<char*>(frame.f32.data()) : reinterpret_cast<char*>(frame.u16.data());
    const std::size_t bytes = plane_bytes(layout_.geometry, info_.format.type);
    if (!in_.read(out, static_cast<std::streamsize>(bytes))) {
      return bad_input(dumps_[next_ - 1].file.string() + ": frame " + std::to_string(index) + " cannot be read");
    }
    if (layout_.type == RawLayout::Type::kU16Be) {
      for (std::uint16_t& v : frame.u16) v = swap_bytes(v);
    }
    return {};
  }

 private:
  Status open(const std::filesystem::path& file) {
    in_ = std::ifstream(file, std::ios::binary);
    in_.seekg(static_cast<std::streamoff>(layout_.skip_bytes));
    return in_ ? Status{} : bad_input(file.string() + ": cannot be opened");
  }

  std::vector<Dump> dumps_;
  RawLayout layout_;
  std::size_t next_ = 0;
  std::ifstream in_;
};

}  // namespace

Result<std::unique_ptr<Footage>> open_raw(const Files& files, const RawLayout& layout, const Told& told) {
  const PixelType type = layout.type == RawLayout::Type::kF32 ? PixelType::kFloat32 : PixelType::kUint16;
  const std::uint64_t frame_bytes = plane_bytes(layout.geometry, type);
  std::vector<Dump> dumps;
  std::size_t frames = 0;
  for (const std::filesystem::path& file : files) {
    std::error_code error;
    const std::uint64_t size = std::filesystem::file_size(file, error);
    if (error) return bad_input(file.string() + ": " + error.message());
    const std::uint64_t data = size > layout.skip_bytes ? size - layout.skip_bytes : 0;
    if (data == 0 || data % frame_bytes != 0) {
      return bad_input(file.string() + ": " + std::to_string(data) + " bytes are not whole frames of " +
                       std::to_string(frame_bytes) + "; check --raw and --skip");
    }
    dumps.push_back({file, frames});
    frames += data / frame_bytes;
  }
  return std::make_unique<RawFootage>(std::move(dumps), frames, layout, told);
}

}  // namespace bolo::tools
