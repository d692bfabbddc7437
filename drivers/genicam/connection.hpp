// Finds the camera, opens it and takes control of it.
#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "drivers/genicam/genicam_source.hpp"
#include "drivers/genicam/gobject.hpp"
#include "drivers/genicam/network.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

struct Connection {
  // Set by the device's heartbeat thread when control is lost; outlives that thread. Relaxed: publishes no other data.
  std::unique_ptr<std::atomic<bool>> control_lost = std::make_unique<std::atomic<bool>>(false);
  Ref<ArvDevice> device;
  std::string name;     // for messages: "camera 192.168.0.7"
  std::string address;  // GigE Vision only, like the route
  Route route;

  bool is_gige() const { return ARV_IS_GV_DEVICE(device.get()) != FALSE; }
};

// Opens by IP address if known, because opening by id may choose an interface that the stream does not reach. A given
// serial number must match: another camera at the address is released unchanged and the serial searched for (a second);
// with `search`, also when nothing answers. Errors: see GenicamSource::open(). Thread: setup.
Result<Connection> connect(const CameraOptions& options, bool search);

// True if a program controls the camera and the camera answers. Blocks for seconds when it is silent. Thread: setup.
bool is_controlled(const Connection& connection);

}  // namespace bolo::genicam
