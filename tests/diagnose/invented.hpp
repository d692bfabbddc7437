// Reports of invented but plausible content, for tests of their output.
#pragma once

#include "src/diagnose/report.hpp"
#include "tests/test.hpp"

namespace bolo::diagnose::test {

// Row delay as the only effect, six captures with plots.
Report invented_row_delay();

// Three effects, one of them of the noise, an imperfect stimulus, an unexplained remainder, warnings.
Report invented_mixture();

// A session without any effect.
Report invented_clean();

}  // namespace bolo::diagnose::test
