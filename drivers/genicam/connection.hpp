// Finds the camera, opens it and takes control of it.
#pragma once

#include <string>
#include <vector>

#include "bolo/core/result.hpp"
#include "drivers/genicam/genicam_source.hpp"
#include "drivers/genicam/gobject.hpp"
#include "drivers/genicam/network.hpp"

namespace bolo::genicam {

struct Connection {
  Ref<ArvDevice> device;
  std::string name;     // for messages: "camera 192.168.0.7"
  std::string address;  // GigE Vision only, as is the route
  Route route;

  bool is_gige() const { return ARV_IS_GV_DEVICE(device.get()) != FALSE; }
};

// Opens by IP whenever an address is known: opening by device id may choose an interface that the stream never reaches.
// Errors as GenicamSource::open(). Thread: setup.
Result<Connection> connect(const CameraOptions& options);

}  // namespace bolo::genicam
