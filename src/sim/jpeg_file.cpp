#include <turbojpeg.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>

#include "src/sim/grey_image.hpp"

namespace bolo::sim {

Result<GreyImage> read_jpeg(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  const std::vector<unsigned char> bytes{std::istreambuf_iterator<char>(in), {}};
  const std::unique_ptr<void, int (*)(tjhandle)> decoder(tjInitDecompress(), tjDestroy);
  if (!decoder) return failed("libturbojpeg does not start");
  const auto damaged = [&decoder] {
    return bad_input("damaged JPEG, or of a kind that cannot be read: " + std::string(tjGetErrorStr2(decoder.get())));
  };
  int width = 0;
  int height = 0;
  int subsampling = 0;
  int colours = 0;
  if (tjDecompressHeader3(decoder.get(), bytes.data(), bytes.size(), &width, &height, &subsampling, &colours) != 0) {
    return damaged();
  }
  const std::uint64_t pixels = static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  if (pixels > kMaxImagePixels) return bad_input("more than 64 million pixels");
  std::vector<unsigned char> grey(pixels);
  if (tjDecompress2(decoder.get(), bytes.data(), bytes.size(), grey.data(), width, 0, height, TJPF_GRAY,
                    TJFLAG_ACCURATEDCT) != 0) {
    return damaged();
  }
  GreyImage image{width, height, {}};
  image.level.resize(pixels);
  std::ranges::transform(grey, image.level.begin(),
                         [](unsigned char level) { return static_cast<std::uint16_t>(257U * level); });
  return image;
}

}  // namespace bolo::sim
