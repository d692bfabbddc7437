// Errors as values. Every call that can fail at set-up returns Result<T>; the hot path is noexcept and counts.
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include <tl/expected.hpp>  // std::expected for C++20

namespace bolo {

enum class ErrorKind {
  kFailed,    // something broke while running: exit code 1
  kBadInput,  // usage, configuration, file or device the user can put right: exit code 2
};

// One clear line: what is wrong, where, and what to do about it.
struct Error {
  ErrorKind kind = ErrorKind::kFailed;
  std::string message;

  int exit_code() const { return kind == ErrorKind::kBadInput ? 2 : 1; }
};

template <typename T>
using Result = tl::expected<T, Error>;

using Status = Result<void>;

// Thread: any.
inline tl::unexpected<Error> bad_input(std::string message) {
  return tl::unexpected<Error>(Error{ErrorKind::kBadInput, std::move(message)});
}

// Thread: any.
inline tl::unexpected<Error> failed(std::string message) {
  return tl::unexpected<Error>(Error{ErrorKind::kFailed, std::move(message)});
}

// Prefixes an error with its place: "FILE: message". Thread: any.
inline tl::unexpected<Error> at(std::string_view where, Error error) {
  error.message.insert(0, std::string(where) + ": ");
  return tl::unexpected<Error>(std::move(error));
}
template <typename T>
Result<T> at(std::string_view where, Result<T> answer) {
  return answer ? std::move(answer) : at(where, std::move(answer).error());
}

}  // namespace bolo

// NOLINTBEGIN(bugprone-macro-parentheses): a target is no expression
#define BOLO_JOIN_NAMES(a, b) a##b
#define BOLO_LINE_NAME(name, line) BOLO_JOIN_NAMES(name, line)
#define BOLO_ASSIGN_OR_RETURN(result, target, ...)                            \
  auto result = (__VA_ARGS__);                                                \
  if (!result) return tl::unexpected<bolo::Error>(std::move(result).error()); \
  target = *std::move(result)

// Assigns the value of a Result to `target`, a variable or a declaration; an error is returned from the function:
//   ASSIGN_OR_RETURN(const auto reader, CaptureReader::open(file));
#define ASSIGN_OR_RETURN(target, ...) BOLO_ASSIGN_OR_RETURN(BOLO_LINE_NAME(result_, __LINE__), target, __VA_ARGS__)

// The same for a Status, or a Result whose value does not matter.
#define RETURN_IF_ERROR(...) BOLO_RETURN_IF_ERROR(BOLO_LINE_NAME(status_, __LINE__), __VA_ARGS__)
#define BOLO_RETURN_IF_ERROR(status, ...) \
  if (auto status = (__VA_ARGS__); !status) return tl::unexpected<bolo::Error>(std::move(status).error())
// NOLINTEND(bugprone-macro-parentheses)
