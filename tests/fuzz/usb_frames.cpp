// What a bulk endpoint delivers, cut into frames by any layout that the configuration can describe.
#include "drivers/usb/frame_assembler.hpp"
#include "drivers/usb/frame_numbers.hpp"
#include "tests/fuzz/input.hpp"

using namespace bolo;
using namespace bolo::usb;

namespace {

FrameLayout take_layout(fuzz::Input& input) {
  FrameLayout layout;
  layout.geometry = {1 + input.take<std::uint8_t>() % 8, 1 + input.take<std::uint8_t>() % 4};
  layout.header_bytes = input.take<std::uint8_t>() % 16;
  layout.trailer_bytes = input.take<std::uint8_t>() % 8;
  const auto how = input.take<std::uint8_t>();
  layout.framing = (how & 1U) != 0 ? Framing::kPacked : Framing::kShortPacket;
  for (const std::uint8_t byte : input.take_bytes(how >> 1U & 7U)) layout.magic.push_back(std::byte{byte});
  if ((how & 16U) != 0) {
    layout.counter = CounterField{input.take<std::uint8_t>() % 16U, std::size_t{1} << (how >> 5U & 3U), how >= 128};
  }
  return layout;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  fuzz::Input input(data, bytes);
  const FrameLayout layout = take_layout(input);
  if (!check(layout)) return 0;
  FrameAssembler assembler(layout);
  FrameNumbers numbers(layout.counter, 0.005);
  std::int64_t now_ns = 0;
  while (!input.empty()) {
    const auto how = input.take<std::uint8_t>();
    if (how >= 250) {
      assembler.restart();
      numbers.interrupted((how & 1U) != 0);
      continue;
    }
    const auto transfer = input.take_bytes(how);
    assembler.feed(std::as_bytes(transfer), (input.take<std::uint8_t>() & 1U) != 0);
    while (const auto piece = assembler.next()) {
      now_ns += 5'000'000;
      if (piece->frame.empty()) {
        numbers.lost();
      } else if (piece->frame.size() != layout.frame_bytes()) {
        std::abort();
      } else {
        numbers.place(piece->frame, now_ns);
      }
    }
  }
  return 0;
}
