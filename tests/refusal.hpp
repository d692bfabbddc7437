// Answers that say no, and in which words.
#pragma once

#include <gtest/gtest.h>

#include <initializer_list>
#include <string>

#include "src/core/result.hpp"

namespace bolo {

// Expects an error whose message has all these parts.
template <typename T>
void expect_error(const Result<T>& answer, std::initializer_list<std::string> parts) {
  ASSERT_FALSE(answer);
  for (const std::string& part : parts) {
    EXPECT_NE(answer.error().message.find(part), std::string::npos)
        << part << "\nis not in: " << answer.error().message;
  }
}

// The same of what the user can put right.
template <typename T>
void expect_refused(const Result<T>& answer, std::initializer_list<std::string> parts) {
  expect_error(answer, parts);
  if (!answer) {
    EXPECT_EQ(answer.error().kind, ErrorKind::kBadInput);
  }
}

}  // namespace bolo
