// The style of the drawings and of the pages. Colours of drawings are written out for each class: viewers of SVG other
// than browsers know neither variables nor the reader's preference, and show the light ones.
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
.bolo-plot .tick,.bolo-plot .key,.bolo-plot .caption{fill:#566072}
.bolo-plot .title{font-size:15px;font-weight:600}.bolo-plot .heading{font-size:18px;font-weight:650}
.bolo-plot .caption{font-size:13px}
.bolo-plot .end{text-anchor:end}.bolo-plot .middle{text-anchor:middle}
.bolo-plot path{fill:none}.bolo-plot .grid{stroke:#e3e7ee}.bolo-plot .axis{stroke:#8a93a3}
.bolo-plot .line{stroke-linejoin:round;stroke-linecap:round}.bolo-plot .dashed{stroke-dasharray:6 4;stroke-linecap:butt}
.bolo-plot .mark{stroke-width:1;stroke-opacity:.6}.bolo-plot .level{stroke-width:1.2;stroke-dasharray:3 3}
.bolo-plot .lead{stroke-width:.8}.bolo-plot .plane{image-rendering:pixelated}
)";

constexpr const char* kDarkShapes =
    ".bolo-plot .paper{fill:#10141a}.bolo-plot text{fill:#e5e9f0}.bolo-plot .tick,.bolo-plot .key,.bolo-plot .caption"
    "{fill:#9ba6b7}.bolo-plot .grid{stroke:#262e3a}.bolo-plot .axis{stroke:#6b7585}\n";

// After the hues, which would fill it.
constexpr const char* kBand = ".bolo-plot path.band{fill-opacity:.22}.bolo-plot rect.band{fill-opacity:.35}\n";

// One column of readable width, light and dark by the reader's preference, also on a phone.
constexpr const char* kPage = R"(
:root{color-scheme:light dark;--paper:#fff;--ink:#1a212d;--soft:#566072;--line:#dfe4ec;--card:#f4f6f9;
--before:#c24a08;--after:#0068a8;--good:#0a7a5a;--good-back:#e2f4ec;--warn:#8a5a00;--warn-back:#fdf1d8;
--bad:#b3123f;--bad-back:#fde5ea;--noise:#9a4282}
@media(prefers-color-scheme:dark){:root{--paper:#10141a;--ink:#e5e9f0;--soft:#9ba6b7;--line:#2a323f;--card:#181e27;
--before:#f0903f;--after:#5db8ee;--good:#4cc79c;--good-back:#12302a;--warn:#f0d95a;--warn-back:#352a10;
--bad:#ff7a96;--bad-back:#3a1420;--noise:#dd9cc4}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,-apple-system,"Segoe UI","DejaVu Sans",sans-serif}
main{max-width:1120px;margin:0 auto;padding:28px 20px 80px}
h1{font-size:clamp(21px,3.4vw,30px);line-height:1.3;margin:10px 0 8px;max-width:32em;font-weight:650}
h2{font-size:20px;margin:48px 0 4px}h3{font-size:16px;margin:0}h4{font-size:15px;margin:0 0 2px;font-weight:600}
p{margin:4px 0 12px;max-width:46em}.soft,figcaption{color:var(--soft)}figcaption{font-size:13px;line-height:1.4;margin:0 0 8px;max-width:56em}
code{font:13px ui-monospace,monospace;color:var(--soft)}
.lead{font-size:17px}
.pill{display:inline-block;padding:2px 12px;border-radius:99px;font-size:14px;font-weight:600}
.pill.good{background:var(--good-back);color:var(--good)}.pill.warn{background:var(--warn-back);color:var(--warn)}
.pill.bad{background:var(--bad-back);color:var(--bad)}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(165px,1fr));gap:12px;margin:22px 0 0}
.fact{background:var(--card);border-radius:10px;padding:12px 16px}
.fact b{display:block;font-size:22px;font-weight:650;line-height:1.3;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
.fact span{font-size:13px;color:var(--soft)}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:14px;width:100%;margin:8px 0}
caption{text-align:left;color:var(--soft);font-size:13px;padding-bottom:4px}
td,th{padding:4px 14px 4px 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
th{font-weight:500;color:var(--soft);font-size:13px}tr:last-child td{border-bottom:0}
td.n,th.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,320px),1fr));gap:26px 30px;margin:14px 0 6px}
figure{margin:18px 0 0;min-width:0}.plots figure{margin:0}
figure .bolo-plot{display:block;max-width:100%;height:auto;min-width:min(100%,340px)}
@media(max-width:640px){main{padding:18px 14px 60px}h2{margin-top:38px}figure .bolo-plot.broad{min-width:560px}}
details{border-top:1px solid var(--line);padding:12px 0}details:last-of-type{border-bottom:1px solid var(--line)}
summary{cursor:pointer;font-weight:600}summary span{font-weight:400;color:var(--soft);margin-left:8px}
ul{padding-left:20px;margin:6px 0}li{margin:3px 0}
)";

}  // namespace

const std::string& plot_style() {
  static const std::string style =
      kShapes + hues(false) + kBand + "@media(prefers-color-scheme:dark){\n" + kDarkShapes + hues(true) + "}\n";
  return style;
}

const std::string& page_style() {
  static const std::string style = kPage + plot_style();
  return style;
}

}  // namespace bolo::plot
