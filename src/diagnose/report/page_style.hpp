// How the page looks. Colours by Okabe and Ito, which colour-blind eyes tell apart; light and dark by the reader's
// preference; one column on a phone.
#pragma once

namespace bolo::diagnose {

inline constexpr const char* kPageStyle = R"(
:root{color-scheme:light dark;--paper:#fff;--ink:#1a212d;--soft:#586273;--line:#dfe4ec;--card:#f4f6f9;
--before:#c8500a;--after:#0068a8;--good:#0a7a5a;--good-back:#e2f4ec;--warn:#8a5a00;--warn-back:#fdf1d8;
--bad:#a8320a;--bad-back:#fde8df;--noise:#7a4fa3}
@media(prefers-color-scheme:dark){:root{--paper:#10141a;--ink:#e5e9f0;--soft:#9ba6b7;--line:#2a323f;--card:#181e27;
--before:#f0903f;--after:#5db8ee;--good:#4cc79c;--good-back:#12302a;--warn:#e5b450;--warn-back:#352a10;
--bad:#f58a5c;--bad-back:#3a1d12;--noise:#b98ce0}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,-apple-system,"Segoe UI",sans-serif}
main{max-width:1120px;margin:0 auto;padding:28px 20px 80px}
h1{font-size:clamp(21px,3.4vw,30px);line-height:1.3;margin:10px 0 8px;max-width:32em;font-weight:650}
h2{font-size:20px;margin:48px 0 4px}h3{font-size:16px;margin:0}h4{font-size:14px;margin:0 0 4px;font-weight:600}
p{margin:4px 0 12px;max-width:46em}.soft,figcaption{color:var(--soft)}figcaption{font-size:13px;line-height:1.4;margin-top:4px}
code{font:13px ui-monospace,monospace;color:var(--soft)}sup{font-size:.75em;line-height:0}
.pill{display:inline-block;padding:2px 12px;border-radius:99px;font-size:14px;font-weight:600}
.pill.good{background:var(--good-back);color:var(--good)}.pill.warn{background:var(--warn-back);color:var(--warn)}
.pill.bad{background:var(--bad-back);color:var(--bad)}
.lead{font-size:17px}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(165px,1fr));gap:12px;margin:22px 0 0}
.fact{background:var(--card);border-radius:10px;padding:12px 16px}
.fact b{display:block;font-size:22px;font-weight:650;line-height:1.3;font-variant-numeric:tabular-nums;white-space:nowrap}
.fact span{font-size:13px;color:var(--soft)}
.card{background:var(--card);border-radius:10px;padding:16px 18px;margin:12px 0}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,430px),1fr));gap:12px;margin-top:12px}
.cards .card{margin:0}
table{border-collapse:collapse;font-size:14px;width:100%;margin:8px 0}
td,th{padding:4px 14px 4px 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
th{font-weight:500;color:var(--soft);font-size:13px}tr:last-child td{border-bottom:0}
td.n,th.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
.scroll{overflow-x:auto}
.row{display:grid;grid-template-columns:minmax(150px,230px) 1fr 104px;gap:0 14px;align-items:center;font-size:14px}
.row .name{padding:5px 0;line-height:1.3;overflow-wrap:anywhere}.row .value{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
.track{position:relative;height:34px;overflow:visible}
.track i{position:absolute;top:0;bottom:0;width:1px;background:var(--line)}
.track i.floor{width:2px;margin-left:-1px;background:var(--good);opacity:.75}
.track b{position:absolute;top:8px;height:18px;border-radius:3px;min-width:3px;background:var(--after)}
.track b.start{background:var(--before)}.track b.noise{background:var(--noise)}.track b.left{background:var(--soft)}
.track b.span{top:15px;height:4px;background:var(--line);border-radius:2px}
.track u{position:absolute;top:11px;width:12px;height:12px;margin-left:-6px;border-radius:6px;text-decoration:none}
.track u.nominal{border:2px solid var(--before);background:var(--paper)}
.track u.measured{background:var(--ink)}
.track u.explained{background:var(--after);border-radius:0;transform:rotate(45deg) scale(.72)}
.scale{position:relative;height:20px;font-size:12px;color:var(--soft)}
.scale span{position:absolute;transform:translateX(-50%);white-space:nowrap}
.chain{display:flex;flex-wrap:wrap;gap:6px;margin:14px 0;font-size:14px;align-items:center;padding:0;list-style:none}
.chain li{border:1px solid var(--line);border-radius:8px;padding:3px 11px;color:var(--soft)}
.chain li.found{background:var(--after);border-color:var(--after);color:var(--paper);font-weight:600}
.chain li.unknown{background:var(--bad-back);border-color:var(--bad);color:var(--bad);font-weight:600}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,320px),1fr));gap:26px 30px;margin:14px 0 6px}
.plots.small{grid-template-columns:repeat(auto-fill,minmax(min(100%,320px),1fr))}
.plots.two{grid-template-columns:1fr 1fr}
.pair{display:grid;grid-template-columns:1fr 1fr;gap:16px}.wide{grid-column:1/-1}
.pair.tall{grid-template-columns:1fr}
figure{margin:0;min-width:0}
.plot{display:grid;grid-template-columns:46px 1fr;align-content:start}
.plot h4,.plot .legend,.plot .ramp,.plot figcaption,.plot .ylabel{grid-column:1/-1}
.plot .area{grid-column:1/-1;display:grid;grid-template-columns:46px 1fr;position:relative}
.plot .area svg{width:100%;height:100%;display:block;overflow:hidden;border-left:1px solid var(--soft);border-bottom:1px solid var(--soft)}
.plot .area img{width:100%;display:block;image-rendering:pixelated;background:repeating-conic-gradient(var(--line) 0 25%,transparent 0 50%) 0/8px 8px}
.yticks{position:relative;font-size:12px;color:var(--soft)}
.yticks span{position:absolute;right:6px;transform:translateY(-50%);white-space:nowrap}
.xticks{grid-column:2;position:relative;height:19px;font-size:12px;color:var(--soft)}
.xticks span{position:absolute;top:2px;transform:translateX(-50%);white-space:nowrap}
.xlabel{grid-column:2;text-align:center;font-size:12px;color:var(--soft)}
.ylabel{font-size:12px;color:var(--soft);margin:2px 0 4px}
.legend{display:flex;flex-wrap:wrap;gap:2px 14px;font-size:13px;color:var(--soft)}
.key{display:inline-block;width:16px;height:0;border-top:3px solid;margin-right:6px;vertical-align:middle}
.key.before,.key.nominal{border-color:var(--before)}.key.after,.key.predicted{border-color:var(--after)}
.key.nominal{border-top-style:dashed}
.key.measured{width:7px;height:7px;border:0;border-radius:4px;background:var(--ink)}
svg path{fill:none;vector-effect:non-scaling-stroke}
.grid{stroke:var(--line);stroke-width:1}.zero{stroke:var(--soft);stroke-width:1}
.line{stroke-width:2;stroke-linejoin:round}.line.before,.line.nominal{stroke:var(--before)}
.line.nominal{stroke-dasharray:6 4}.line.after,.line.predicted{stroke:var(--after)}
.line.measured{stroke:var(--ink)}.line.dots{stroke-width:5;stroke-linecap:round}
.ramp{display:flex;gap:8px;align-items:center;font-size:12px;color:var(--soft);margin-bottom:2px}
.ramp i{flex:1;max-width:130px;height:10px;border-radius:3px}
details{border-top:1px solid var(--line);padding:12px 0}details:last-of-type{border-bottom:1px solid var(--line)}
summary{cursor:pointer;font-weight:600}summary span{font-weight:400;color:var(--soft);margin-left:8px}
ul{padding-left:20px;margin:6px 0}li{margin:3px 0}
@media(max-width:820px){.plots.two{grid-template-columns:1fr}}
@media(max-width:640px){.scale span:first-child{transform:translateX(-15%)}main{padding:18px 14px 60px}.row{grid-template-columns:1fr 92px;gap:0 10px;margin-bottom:6px}
.row .name{grid-column:1/-1;padding:2px 0 0}.row .blank{display:none}.row .xlabel{grid-column:1}.pair{gap:10px}.pair .plot{grid-template-columns:30px 1fr}
.pair .plot .area{grid-template-columns:30px 1fr}h2{margin-top:38px}}
)";

}  // namespace bolo::diagnose
