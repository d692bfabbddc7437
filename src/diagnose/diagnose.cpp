#include "bolo/diagnose/diagnose.hpp"

namespace bolo::diagnose {

Result<Report> diagnose(const std::vector<std::filesystem::path>& /*captures*/, const Options& /*options*/,
                        const Progress& /*progress*/) {
  return failed("this build reads and writes reports, but has no statistics to fill one");
}

}  // namespace bolo::diagnose
