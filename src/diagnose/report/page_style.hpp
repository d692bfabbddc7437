// How the parts look that only this page has; the rest is plot::page_style().
#pragma once

namespace bolo::diagnose {

inline constexpr const char* kReportStyle = R"(
.card{background:var(--card);border-radius:10px;padding:16px 18px;margin:12px 0}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,430px),1fr));gap:12px;margin-top:12px}
.cards .card{margin:0}
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
sup{font-size:.75em;line-height:0}.axisname{text-align:center;font-size:12px;color:var(--soft)}
.legend{display:flex;flex-wrap:wrap;gap:2px 14px;font-size:13px;color:var(--soft)}
.pair{display:grid;grid-template-columns:1fr 1fr;gap:26px 30px;margin-top:12px}.pair figure{margin:0}
@media(max-width:820px){.pair{grid-template-columns:1fr}}
@media(max-width:640px){.scale span:first-child{transform:translateX(-15%)}.row{grid-template-columns:1fr 92px;gap:0 10px;margin-bottom:6px}
.row .name{grid-column:1/-1;padding:2px 0 0}.row .blank{display:none}.row .axisname{grid-column:1}}
)";

}  // namespace bolo::diagnose
