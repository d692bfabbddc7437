#include "tools/bolo/fakecam_faults.hpp"

#include <cmath>
#include <cstdio>
#include <sstream>
#include <string>

#include <nlohmann/json.hpp>

#include "drivers/fakecam/fault_script.hpp"

namespace bolo::tools {
namespace {

nlohmann::json to_json(const fakecam::FaultType& type) {
  nlohmann::json keys = nlohmann::json::array();
  for (const fakecam::FaultKey& key : type.keys) {
    nlohmann::json standard = nullptr;  // to the end
    if (std::isfinite(key.standard)) standard = key.standard;
    keys.push_back({{"key", key.key},
                    {"unit", key.unit},
                    {"default", standard},
                    {"accepted", {key.low, key.high}},
                    {"about", key.about}});
  }
  return {{"name", type.name}, {"about", type.about}, {"keys", keys}};
}

// "rate=0.01": every key with its standard value; one without is a key that may be left out.
std::string line_of(const fakecam::FaultType& type) {
  std::ostringstream line;
  const char* separator = "";
  for (const fakecam::FaultKey& key : type.keys) {
    line << separator << key.key << '=';
    if (std::isfinite(key.standard)) {
      line << key.standard << key.unit;
    } else {
      line << "...";
    }
    separator = ", ";
  }
  return line.str();
}

}  // namespace

void print_faults(bool json) {
  nlohmann::json all = nlohmann::json::array();
  for (const fakecam::FaultType& type : fakecam::fault_types()) {
    if (json) {
      all.push_back(to_json(type));
    } else {
      std::printf("%-18s %s [%s]\n", std::string(type.name).c_str(), std::string(type.about).c_str(),
                  line_of(type).c_str());
    }
  }
  if (json) std::puts(all.dump().c_str());
}

}  // namespace bolo::tools
