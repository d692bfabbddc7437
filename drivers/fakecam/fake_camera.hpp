// GigE Vision camera in software: replays frames like a FLIR A655sc, so that everything behind the network cable runs
// without one. Device side of GigE Vision 1.2 with its own GenICam description.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "drivers/fakecam/fault_script.hpp"
#include "drivers/fakecam/frames.hpp"
#include "drivers/fakecam/stats.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::fakecam {

struct FakeCameraOptions {
  std::string address = "127.0.0.1";  // of this host (any of 127.0.0.0/8 included); one camera per address
  std::string serial;                 // at most 15 characters; empty: the capture's, or derived from the address
  std::optional<Region> crop;         // part of the capture that acts as the sensor; nothing: all of it
  double rate_hz = 0.0;          // frames per second until a client writes AcquisitionFrameRate; 0: the capture's rate
  std::uint64_t laps = 1;        // times the capture is served after each AcquisitionStart; 0: endlessly
  std::size_t keep_frames = 48;  // sent frames kept for resends
  FaultScript faults;            // at most kMaxFaults
};

// Streams to the controlling client from AcquisitionStart until AcquisitionStop, the end of the capture, or the loss of
// control (released or heartbeat timeout). Each AcquisitionStart begins with the capture's first frame.
class FakeCamera {
 public:
  // Serves until stop() or destruction. Errors (kBadInput): the address is not this host's or is in use, the crop lies
  // outside the capture, a name is too long, the capture has no frames, too many faults. Thread: setup.
  static Result<std::unique_ptr<FakeCamera>> start(const FakeCameraOptions& options, FrameProvider provider);
  ~FakeCamera();

  // Stops streaming and answering; the address is free on return. Idempotent. Thread: setup.
  void stop() noexcept;

  // Thread: any.
  FakeCameraStats stats() const noexcept;

  // Counts of each fault so far, in the script's order. Thread: any.
  std::vector<InjectedFault> injected() const;

  Geometry sensor() const;        // Thread: any
  double rate_hz() const;         // at the start; Thread: any
  std::string serial() const;     // Thread: any
  bool hears_broadcasts() const;  // broadcast discovery works; Thread: setup, before stop()
  Status result() const;          // read error that ended a stream; Thread: setup, after stop()

 private:
  struct Impl;
  explicit FakeCamera(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::fakecam
