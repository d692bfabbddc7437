// Why frames are lost. Each lost frame is counted once, under the first cause that took it.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace bolo {

// The order is part of the shared-memory layout (shm_layout.h): append only.
enum class LossCause : std::size_t {
  kIncomplete,     // network: some packets of the frame never came
  kMissing,        // the camera's counter jumped: no packet of the frame came
  kPoolExhausted,  // deblurring is behind: no free slot to copy the frame into
  kQueueFull,      // deblurring is behind: the frame queue was full
  kBadFrame,       // the frame came whole but with another size or pixel format than agreed
  kDriver,         // the transport library aborted or cleared the frame
  kOutOfOrder,     // older than, or the same as, a frame that was already delivered
  kCount
};

inline constexpr std::size_t kLossCauses = static_cast<std::size_t>(LossCause::kCount);

// Names as `bolo stat`, JSON and the metrics print them. Thread: any.
constexpr std::string_view name(LossCause cause) {
  constexpr std::array<std::string_view, kLossCauses> kNames{"incomplete", "missing", "pool_exhausted", "queue_full",
                                                             "bad_frame",  "driver",  "out_of_order"};
  return kNames[static_cast<std::size_t>(cause)];
}

}  // namespace bolo
