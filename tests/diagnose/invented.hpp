// Reports of invented but plausible content, for the tests of what is made of a report.
#pragma once

#include "src/diagnose/report.hpp"
#include "tests/test.hpp"

namespace bolo::diagnose::test {

// Row delay as the only effect, six captures with plots.
Report invented_row_delay();

// Three effects, one of them of the noise, an imperfect stimulus, something left unexplained, warnings.
Report invented_mixture();

// A session in which nothing is wrong.
Report invented_clean();

}  // namespace bolo::diagnose::test
