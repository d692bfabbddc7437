// The style of the drawings. Colours are written out for each class: viewers of SVG other than browsers know neither
// variables nor the reader's preference, and show the light ones.
#include "src/report/plot.hpp"
#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

std::string hex(Rgb rgb) { return format("#%02x%02x%02x", rgb.red, rgb.green, rgb.blue); }

std::string hues(bool dark) {
  std::string out;
  for (std::size_t i = 0; i < kHues; ++i) {
    const HueColours& hue = colours_of(static_cast<Hue>(i));
    const std::string colour = hex(dark ? hue.on_dark : hue.on_light);
    out += format(".bolo-plot .s-%s{stroke:%s}.bolo-plot .f-%s{fill:%s}\n", hue.name, colour.c_str(), hue.name,
                  colour.c_str());
  }
  return out;
}

constexpr const char* kShapes = R"(
.bolo-plot{font:12px system-ui,-apple-system,"Segoe UI","DejaVu Sans",sans-serif}
.bolo-plot .paper{fill:#ffffff}.bolo-plot text{fill:#1a212d}
.bolo-plot .tick,.bolo-plot .key,.bolo-plot .caption{fill:#566072}.bolo-plot .number{fill:#566072;font-size:11px}
.bolo-plot .title{font-size:15px;font-weight:600}.bolo-plot .heading{font-size:18px;font-weight:650}
.bolo-plot .caption{font-size:13px}.bolo-plot .event{font-size:11px}
.bolo-plot .end{text-anchor:end}.bolo-plot .middle{text-anchor:middle}
.bolo-plot path{fill:none}.bolo-plot .grid{stroke:#e3e7ee}.bolo-plot .axis{stroke:#8a93a3}
.bolo-plot .line{stroke-linejoin:round;stroke-linecap:round}.bolo-plot .dashed{stroke-dasharray:6 4;stroke-linecap:butt}
.bolo-plot .mark{stroke-width:1;stroke-opacity:.6}.bolo-plot .during{fill-opacity:.14}.bolo-plot .level{stroke-width:1.2;stroke-dasharray:3 3}
.bolo-plot .lead{stroke-width:.8}.bolo-plot .plane{image-rendering:pixelated}
)";

constexpr const char* kDarkShapes =
    ".bolo-plot .paper{fill:#10141a}.bolo-plot text{fill:#e5e9f0}.bolo-plot .tick,.bolo-plot .key,.bolo-plot .caption,"
    ".bolo-plot .number{fill:#9ba6b7}.bolo-plot .grid{stroke:#262e3a}.bolo-plot .axis{stroke:#6b7585}\n";

// After the hues, which would fill it.
constexpr const char* kBand = ".bolo-plot path.band{fill-opacity:.22}.bolo-plot rect.band{fill-opacity:.35}\n";

}  // namespace

const std::string& plot_style() {
  static const std::string style =
      kShapes + hues(false) + kBand + "@media(prefers-color-scheme:dark){\n" + kDarkShapes + hues(true) + "}\n";
  return style;
}

}  // namespace bolo::plot
