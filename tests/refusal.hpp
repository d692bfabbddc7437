// Texts that must say something, and answers that say no.
#pragma once

#include "src/core/result.hpp"
#include "tests/test.hpp"

namespace bolo {

// Expects all these parts in the text.
inline void expect_parts(const std::string& text, std::initializer_list<std::string> parts) {
  for (const std::string& part : parts) {
    EXPECT_NE(text.find(part), std::string::npos) << part << "\nis not in: " << text;
  }
}

// Expects an error whose message has all these parts.
template <typename T>
void expect_error(const Result<T>& answer, std::initializer_list<std::string> parts) {
  ASSERT_FALSE(answer);
  expect_parts(answer.error().message, parts);
}

// The same of what the user can put right, in one line.
template <typename T>
void expect_refused(const Result<T>& answer, std::initializer_list<std::string> parts) {
  expect_error(answer, parts);
  if (!answer) {
    EXPECT_EQ(answer.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(answer.error().message.find('\n'), std::string::npos) << answer.error().message;
  }
}

}  // namespace bolo
