#pragma once

#include "src/core/result.hpp"
#include "tests/test.hpp"

namespace bolo {

inline void expect_parts(const std::string& text, std::initializer_list<std::string> parts) {
  for (const std::string& part : parts) {
    EXPECT_NE(text.find(part), std::string::npos) << part << "\nis not in: " << text;
  }
}

inline void expect_none(const std::string& text, std::initializer_list<std::string> parts) {
  for (const std::string& part : parts) EXPECT_EQ(text.find(part), std::string::npos) << part << "\nis in: " << text;
}

inline std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++found;
  return found;
}

template <typename T>
void expect_error(const Result<T>& answer, std::initializer_list<std::string> parts) {
  ASSERT_FALSE(answer);
  expect_parts(answer.error().message, parts);
}

// Expects a one-line error that the user can fix (kBadInput), with all parts.
template <typename T>
void expect_refused(const Result<T>& answer, std::initializer_list<std::string> parts) {
  expect_error(answer, parts);
  if (!answer) {
    EXPECT_EQ(answer.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(answer.error().message.find('\n'), std::string::npos) << answer.error().message;
  }
}

}  // namespace bolo
