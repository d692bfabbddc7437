#include <utility>

#include "tools/convert/footage.hpp"

namespace bolo::tools {
namespace {

using capture::CaptureReader;

class CaptureFootage final : public Footage {
 public:
  explicit CaptureFootage(CaptureReader reader) : reader_(std::move(reader)) { info_ = reader_.info(); }

  Status read(std::size_t index, Frame& frame) override {
    frame.t_s = reader_.t()[index];
    frame.id = reader_.frame_id()[index];
    const std::size_t pixels = info_.format.geometry.pixels();
    if (info_.format.type == PixelType::kUint16) {
      frame.u16.resize(pixels);
      return reader_.read_frame(index, frame.u16.data());
    }
    frame.f32.resize(pixels);
    return reader_.read_frame(index, frame.f32.data());
  }

  Status copy_extras(capture::CaptureWriter& writer) const override {
    for (const capture::Event& event : reader_.events()) {
      if (Status good = writer.add_event(event); !good) return good;
    }
    const auto attributes = reader_.attributes();
    if (!attributes) return tl::unexpected<Error>(attributes.error());
    if (Status good = writer.write_attributes(*attributes); !good) return good;
    const auto stimulus = reader_.stimulus();
    return stimulus ? writer.write_stimulus(*stimulus) : Status{};
  }

 private:
  CaptureReader reader_;
};

}  // namespace

Result<std::unique_ptr<Footage>> open_capture(const std::filesystem::path& file) {
  Result<CaptureReader> reader = CaptureReader::open(file);
  if (!reader) return tl::unexpected<Error>(reader.error());
  return std::make_unique<CaptureFootage>(std::move(*reader));
}

}  // namespace bolo::tools
