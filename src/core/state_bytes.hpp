// What an object remembers, as bytes: for work that goes on in another process of the same program.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace bolo {

// Thread: any one at a time.
class StateWriter {
 public:
  template <typename T>
  void operator()(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(value));
  }
  template <typename T>
  void operator()(const std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    (*this)(std::uint64_t{values.size()});
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

// Reads in the order of writing. Once something does not fit, good() is false and nothing more is changed. Thread: any
// one at a time.
class StateReader {
 public:
  explicit StateReader(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  void operator()(T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    copy(&value, sizeof(value));
  }
  // A vector keeps its size: another one does not fit.
  template <typename T>
  void operator()(std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    std::uint64_t size = 0;
    (*this)(size);
    good_ = good_ && size == values.size();
    copy(values.data(), values.size() * sizeof(T));
  }
  bool good() const { return good_; }
  // All was read, and fitted.
  bool complete() const { return good_ && bytes_.empty(); }

 private:
  void copy(void* to, std::size_t size) {
    good_ = good_ && bytes_.size() >= size;
    if (!good_ || size == 0) return;
    std::memcpy(to, bytes_.data(), size);
    bytes_.remove_prefix(size);
  }

  std::string_view bytes_;
  bool good_ = true;
};

}  // namespace bolo
