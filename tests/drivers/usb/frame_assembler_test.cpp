#include "drivers/usb/frame_assembler.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace bolo::usb {
namespace {

using Bytes = std::vector<std::byte>;

// Frames of 2 x 1 pixels after a header of 4 bytes that begins with "AB", and a trailer of one: 9 bytes.
FrameLayout layout(Framing framing) {
  FrameLayout layout;
  layout.geometry = {2, 1};
  layout.header_bytes = 4;
  layout.magic = {std::byte{'A'}, std::byte{'B'}};
  layout.trailer_bytes = 1;
  layout.framing = framing;
  return layout;
}

Bytes bytes(const std::string& text) {
  Bytes all;
  for (const char c : text) all.push_back(static_cast<std::byte>(c));
  return all;
}

// What comes out, in order: the frames as text, the losses by name.
std::string pieces(FrameAssembler& assembler, const std::string& transfer, bool ended) {
  const Bytes data = bytes(transfer);
  assembler.feed(data, ended);
  std::string all;
  while (const auto piece = assembler.next()) {
    if (!all.empty()) all += ' ';
    if (piece->frame.empty()) all += '!' + std::string(name(piece->cause));
    for (const std::byte b : piece->frame) all += static_cast<char>(b);
  }
  return all;
}

TEST(ShortPacketFrames, AreTransfers) {
  FrameAssembler assembler(layout(Framing::kShortPacket));
  EXPECT_EQ(pieces(assembler, "AB1-wxyzt", true), "AB1-wxyzt");
  EXPECT_EQ(pieces(assembler, "", true), "");  // a packet of no bytes is no frame
  EXPECT_EQ(pieces(assembler, "AB2-wxyzt", true), "AB2-wxyzt");
}

TEST(ShortPacketFrames, OfWrongSizeAreCountedOnce) {
  FrameAssembler assembler(layout(Framing::kShortPacket));
  EXPECT_EQ(pieces(assembler, "AB1-wx", true), "!incomplete");
  EXPECT_EQ(pieces(assembler, "AB2-wxyzt+", true), "!bad_frame");
  // Longer than transfers are: skipped to its end.
  EXPECT_EQ(pieces(assembler, "AB3-wxyzt...", false), "!bad_frame");
  EXPECT_EQ(pieces(assembler, "AB..........", false), "");
  EXPECT_EQ(pieces(assembler, "AB4-wxyzt", true), "");
  EXPECT_EQ(pieces(assembler, "AB5-wxyzt", true), "AB5-wxyzt");
}

TEST(ShortPacketFrames, NeedTheMagic) {
  FrameAssembler assembler(layout(Framing::kShortPacket));
  EXPECT_EQ(pieces(assembler, "AC1-wxyzt", true), "!bad_frame");
}

TEST(PackedFrames, AreCutFromTransfersOfAnySize) {
  const std::string stream = "AB1-wxyztAB2-wxyztAB3-wxyzt";
  for (std::size_t size = 1; size <= stream.size(); ++size) {
    FrameAssembler assembler(layout(Framing::kPacked));
    std::string all;
    for (std::size_t at = 0; at < stream.size(); at += size) {
      const std::string more = pieces(assembler, stream.substr(at, size), false);
      all += (all.empty() || more.empty() ? "" : " ") + more;
    }
    EXPECT_EQ(all, "AB1-wxyzt AB2-wxyzt AB3-wxyzt") << "transfers of " << size;
  }
}

TEST(PackedFrames, AreCutOffByAShortPacket) {
  FrameAssembler assembler(layout(Framing::kPacked));
  EXPECT_EQ(pieces(assembler, "AB1-wx", true), "!incomplete");
  EXPECT_EQ(pieces(assembler, "AB2-wxyzt", true), "AB2-wxyzt");  // between frames it cuts nothing off
  EXPECT_EQ(pieces(assembler, "AB3-wxyztAB", true), "AB3-wxyzt !incomplete");
}

TEST(PackedFrames, AreFoundAgainByTheMagic) {
  FrameAssembler assembler(layout(Framing::kPacked));
  EXPECT_EQ(pieces(assembler, "AB1-wxyzt..A.AAB2-wxyzt", false), "AB1-wxyzt !bad_frame AB2-wxyzt");
}

TEST(PackedFrames, BeginWithTheMagicAfterARestart) {
  FrameAssembler assembler(layout(Framing::kPacked));
  EXPECT_EQ(pieces(assembler, "wxyztAB1-wx", false), "");  // what came before is not a lost frame
  EXPECT_TRUE(assembler.restart());
  EXPECT_EQ(pieces(assembler, "yztAB2-wxyzt", false), "AB2-wxyzt");
  EXPECT_FALSE(assembler.restart());
}

TEST(PackedFrames, WithoutMagicFollowTheShortPacket) {
  FrameLayout plain = layout(Framing::kPacked);
  plain.magic.clear();
  FrameAssembler assembler(plain);
  EXPECT_EQ(pieces(assembler, "1234wxyzt5678w", true), "1234wxyzt !incomplete");
  EXPECT_EQ(pieces(assembler, "1234wxyzt", false), "1234wxyzt");
}

TEST(FrameLayout, ThatCannotBeIsRefused) {
  FrameLayout wrong = layout(Framing::kPacked);
  wrong.header_bytes = 1;
  EXPECT_NE(check(wrong).error().message.find("magic"), std::string::npos);
  wrong = layout(Framing::kPacked);
  wrong.counter = CounterField{.offset = 1, .bytes = 4};
  EXPECT_NE(check(wrong).error().message.find("outside the header"), std::string::npos);
  wrong.counter = CounterField{.offset = 0, .bytes = 3};
  EXPECT_NE(check(wrong).error().message.find("1, 2, 4 or 8"), std::string::npos);
  wrong = layout(Framing::kPacked);
  wrong.geometry.width = 0;
  EXPECT_EQ(check(wrong).error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(check(layout(Framing::kPacked)));
}

}  // namespace
}  // namespace bolo::usb
