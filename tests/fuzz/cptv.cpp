// A CPTV film. zlib passes input that is not gzip through unchanged, which lets the fuzzer reach the parser.
#include "tests/fuzz/input.hpp"
#include "tools/convert/footage.hpp"

using namespace bolo;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const fuzz::InputFile file({data, bytes});
  const auto film = tools::open_cptv(file.name(), {});
  if (!film) return 0;
  tools::Frame frame;
  for (std::size_t i = 0; i < (*film)->info().frames; ++i) {
    if (!(*film)->read(i, frame)) break;
  }
  return 0;
}
