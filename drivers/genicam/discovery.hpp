// Discovery of cameras.
#pragma once

#include <string>
#include <vector>

namespace bolo::genicam {

struct FoundCamera {
  std::string id;       // Aravis's: "FLIR Systems-A655sc-12345"
  std::string address;  // IP address, or what the transport has instead
  std::string model;
  std::string serial;
};

// Asks every interface and waits for answers, about a second. Thread: setup.
std::vector<FoundCamera> find_cameras();

// Version of Aravis as it runs, "0.8.26". Thread: any.
std::string aravis_version();

}  // namespace bolo::genicam
