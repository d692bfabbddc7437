#include "tools/lab/detect/verb.hpp"

#include <cstdio>
#include <new>

#include "src/report/text.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/detect/figures.hpp"
#include "tools/lab/detect/options.hpp"
#include "tools/lab/detect/report.hpp"
#include "tools/lab/detect/run.hpp"
#include "tools/lab/detect/table.hpp"

namespace bolo::tools {
namespace {

using namespace detect;

Status evaluate(const Options& options) {
  const auto found = run(options);
  if (!found) return tl::unexpected(found.error());
  const Table table = table_of(*found, options);
  if (options.json) {
    std::printf("%s\n", to_json(options, table).dump(2).c_str());
  } else {
    print_text(options, table);
  }
  if (options.plot.empty()) return {};
  plot::Sheet sheet = sheet_of(table, *found, options);
  sheet.how = plot::format(
      "bolo-lab eval detect --size %dx%d --repeats %d --seed %llu: simulated camera, 200 frames/s, tau 11 ms, noise %g "
      "K.",
      options.picture.width, options.picture.height, options.repeats, static_cast<unsigned long long>(options.seed),
      options.noise_k);
  return save(sheet, options.plot);
}

}  // namespace

int eval_detect_main(int argc, char** argv) {
  auto cli = declare();
  cxxopts::ParseResult given;
  if (const auto code = parse(cli, argc, argv, given)) return *code;
  try {
    const auto options = options_of(given);
    if (!options) return report("eval detect", options.error());
    catch_interrupts();
    const Status done = evaluate(*options);
    return done ? kExitDone : report("eval detect", done.error());
  } catch (const std::bad_alloc&) {
    return report("eval detect", {ErrorKind::kFailed, "not enough memory; take a smaller --size or fewer --threads"});
  }
}

}  // namespace bolo::tools
