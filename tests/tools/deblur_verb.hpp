// `bolo deblur` as its user meets it, for its tests.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "src/capture/capture.hpp"
#include "tests/tools/blurred_capture.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {

namespace fs = std::filesystem;

class DeblurVerb : public ProgramTest {
 protected:
  DeblurVerb() : ProgramTest({BOLO_PROGRAM, "deblur"}) {}

  // Runs on in.h5 with `more` options, expects success, and opens the output.
  capture::CaptureReader deblurred(const std::vector<std::string>& more = {}, const std::string& name = "out.h5") {
    std::vector<std::string> words{file("in.h5"), "-o", file(name), "--overwrite"};
    words.insert(words.end(), more.begin(), more.end());
    last_ = run(words);
    EXPECT_EQ(last_.exit_code, 0) << last_.err;
    EXPECT_FALSE(fs::exists(file(name + ".part")));
    auto reader = capture::CaptureReader::open(file(name));
    if (!reader) throw std::runtime_error(reader.error().message);
    return std::move(*reader);
  }

  Outcome last_;
};

inline std::vector<float> frame_of(const capture::CaptureReader& reader, std::size_t index) {
  const std::size_t pixels = reader.info().format.geometry.pixels();
  std::vector<float> values(pixels);
  if (reader.info().format.type == PixelType::kFloat32) {
    EXPECT_TRUE(reader.read_frame(index, values.data()));
    return values;
  }
  std::vector<std::uint16_t> counts(pixels);
  EXPECT_TRUE(reader.read_frame(index, counts.data()));
  for (std::size_t i = 0; i < pixels; ++i) values[i] = static_cast<float>(counts[i]);
  return values;
}

template <typename T>
std::optional<T> attribute(const capture::CaptureReader& reader, const std::string& name) {
  const auto attributes = reader.attributes();
  EXPECT_TRUE(attributes);
  for (const capture::Attribute& a : attributes.value_or(std::vector<capture::Attribute>{})) {
    if (a.name == name && std::holds_alternative<T>(a.value)) return std::get<T>(a.value);
  }
  return std::nullopt;
}

}  // namespace bolo::tools::test
