// The implementation of bolo_client: C++ on the inside, the C structures that its user reads on the outside.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bolo/client.h"
#include "drivers/shm/followed_stream.hpp"
#include "drivers/shm/point_reader.hpp"

namespace bolo::shm {

// One line of a fixed length, so that saying that memory is short takes none.
class ErrorText {
 public:
  // Cut to fit. Thread: one at a time.
  void set(std::string_view text) noexcept;
  const char* text() const noexcept { return text_.data(); }

 private:
  std::array<char, 512> text_{};
};

// Results are enum bolo_client_result; those below 0, and BOLO_CLIENT_ENDED, leave a line in `error`. Thread: one at a
// time.
class Handle {
 public:
  explicit Handle(FollowedStream stream);
  // info_ points into this.
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;

  const bolo_client_info& info() const noexcept { return info_; }
  const bolo_client_state& update_state();
  // One of FollowedStream's.
  using Take = decltype(&FollowedStream::next);
  int take(Take one, int timeout_ms, bolo_client_frame& frame);
  int kelvin(std::span<const std::uint16_t> values, float* kelvin);
  int points(std::uint64_t number, std::span<const bolo_client_point> points, float* values);
  std::shared_ptr<const void> hold() const noexcept { return stream_.reader().hold(); }

  ErrorText error;

 private:
  void fill_info();
  int choose_points(std::span<const bolo_client_point> points);
  int refuse(int result, std::string_view text);

  FollowedStream stream_;
  bolo_shm_header header_{};
  std::optional<bolo_shm_settings> settings_;
  std::optional<bolo_shm_camera> camera_;
  std::string control_socket_;
  bolo_client_info info_{};
  bolo_client_state state_{};
  std::vector<std::uint32_t> pixels_;  // that point_reader_ was made for
  std::vector<std::uint16_t> solved_;
  std::optional<PointReader> point_reader_;
};

}  // namespace bolo::shm
