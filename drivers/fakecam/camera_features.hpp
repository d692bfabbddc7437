// The camera's side of the registers: their first values, what a write to each does, and what they say at
// AcquisitionStart.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "drivers/fakecam/frames.hpp"
#include "drivers/fakecam/register_map.hpp"
#include "drivers/fakecam/stats.hpp"

namespace bolo::fakecam {

struct Identity {
  std::string serial;  // at most 15 characters
  std::uint32_t address = 0;
  std::uint32_t netmask = 0;
};

// The GenICam description. Thread: any.
std::string_view description();

// The bootstrap registers that never change, and those that only keep what is written to them. Thread: setup.
void fill_bootstrap(RegisterMap& registers, const Identity& identity);

// Image, acquisition and infrared features. Thread: one at a time; control once the camera runs.
class CameraFeatures {
 public:
  // Called by command registers. A refusal is the write's answer.
  struct Actions {
    std::function<gvcp::Status()> start;
    std::function<void()> stop;
    std::function<bool()> streaming;  // image registers are locked meanwhile
    std::function<void()> windowing_changed;
  };

  // `format`: of the capture; `sensor`: its part that is served; `rate_hz`: the pace until a client writes another.
  CameraFeatures(RegisterMap& registers, Counters& counters, const StreamFormat& format, Geometry sensor,
                 double rate_hz, Actions actions);

  // As at power-on, but for the registers themselves.
  void power_on() { offset_x_given_ = offset_y_given_ = false; }

  // Settings that a stream takes when it starts; region in the sensor's coordinates.
  Region region() const;
  IrFormat ir_format() const;
  double rate_hz() const;  // 0: the capture's own
  bool single_frame() const;

 private:
  void fill_image(double rate_hz);
  void fill_infrared(Unit unit);
  void fill_axis(std::uint32_t size_register, std::uint32_t offset_register, std::uint32_t sensor_size,
                 bool& offset_given);
  void fill_floats();
  void fill_cases();
  void fill_ptp();

  WriteOutcome write_windowing(std::uint32_t value);
  void update_payload();
  void image_register(std::uint32_t address, WriteRule rule);  // refuses while streaming
  void command(std::uint32_t address, std::function<void()> action);

  RegisterMap& registers_;
  Counters& counters_;
  Geometry sensor_;
  Actions actions_;
  float capture_rate_hz_;        // as the register holds it
  bool offset_x_given_ = false;  // otherwise the window is centred
  bool offset_y_given_ = false;
};

}  // namespace bolo::fakecam
