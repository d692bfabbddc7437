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
  // Set by the device's heartbeat thread when control is lost; made before and destroyed after that thread. Relaxed: a
  // flag and nothing else.
  std::unique_ptr<std::atomic<bool>> control_lost = std::make_unique<std::atomic<bool>>(false);
  Ref<ArvDevice> device;
  std::string name;     // for messages: "camera 192.168.0.7"
  std::string address;  // GigE Vision only, as is the route
  Route route;

  bool is_gige() const { return ARV_IS_GV_DEVICE(device.get()) != FALSE; }
};

// Opens by IP whenever an address is known: opening by device id may choose an interface that the stream never reaches.
// A serial number in the options must be the camera's: another camera at the address is let go of unchanged, and the
// number looked for elsewhere, which takes a second; also where nothing answers at the address, when `search`. Errors
// as GenicamSource::open(). Thread: setup.
Result<Connection> connect(const CameraOptions& options, bool search);

// True if the camera has a controlling program, and answers us. Blocks some seconds when it is silent. Thread: setup.
bool is_controlled(const Connection& connection);

}  // namespace bolo::genicam
