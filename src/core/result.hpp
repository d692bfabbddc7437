// Errors as values. Every call that can fail at set-up returns Result<T>; the hot path is noexcept and counts.
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include <tl/expected.hpp>  // std::expected for C++20

namespace bolo {

// What the program's exit code must say about a failure.
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

// The same error with the place put before it: "FILE: message". Thread: any.
inline tl::unexpected<Error> at(std::string_view where, Error error) {
  error.message.insert(0, std::string(where) + ": ");
  return tl::unexpected<Error>(std::move(error));
}

}  // namespace bolo
