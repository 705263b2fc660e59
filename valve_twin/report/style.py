# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Style sheet of the page: dark text on white, colours that also differ for the colour-blind.

Colours of the curves are those of Okabe and Ito (2008). Every meaning that a colour carries is
carried by a word or a shape as well.
"""

CSS = """
:root { --ink: #1b2026; --soft: #545d68; --rule: #d5dae0; --blue: #0072b2; --orange: #c2500a;
  --ok: #00664f; --bad: #a3201b; --unsure: #4a5361; --warn: #7a4f00; }
* { box-sizing: border-box; }
body { margin: 0; background: #f1f3f5; color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, "DejaVu Sans", sans-serif;
  font-variant-numeric: tabular-nums; -webkit-text-size-adjust: 100%; }
main { max-width: 1060px; margin: 0 auto; padding: 30px 36px 34px; background: #fff; }
h1 { font-size: 27px; line-height: 1.2; margin: 0; letter-spacing: -0.01em;
  overflow-wrap: anywhere; }
h2 { font-size: 18px; margin: 38px 0 6px; padding-top: 13px; border-top: 1px solid var(--rule); }
h3 { font-size: 15px; margin: 0 0 2px; }
p { margin: 4px 0 10px; max-width: 78ch; }
.kind { color: var(--soft); margin: 0 0 4px; font-size: 13px; font-weight: 600; }
.meta { color: var(--soft); margin: 5px 0 0; overflow-wrap: anywhere; }
.soft { color: var(--soft); }
.verdict { display: flex; gap: 18px; align-items: center; margin: 22px 0 16px; padding: 15px 20px;
  border-left: 9px solid; border-radius: 5px; background: #f6f8f9; }
.verdict svg { flex: none; width: 50px; height: 50px; }
.verdict b { display: block; font-size: 20px; line-height: 1.25; }
.verdict p { margin: 2px 0 0; }
.ok { border-color: var(--ok); } .ok b { color: var(--ok); } .ok svg { fill: var(--ok); }
.bad { border-color: var(--bad); } .bad b { color: var(--bad); } .bad svg { fill: var(--bad); }
.warn { border-color: var(--warn); } .warn b { color: var(--warn); }
.warn svg { fill: var(--warn); }
.unsure { border-color: var(--unsure); } .unsure b { color: var(--unsure); }
.unsure svg { fill: var(--unsure); }
.facts { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr));
  gap: 14px 22px;
  margin: 0; }
.facts div { border-top: 2px solid var(--rule); padding-top: 5px; }
.facts dt { color: var(--soft); font-size: 13px; }
.facts dd { margin: 0; font-size: 19px; font-weight: 600; line-height: 1.35; }
.facts small { display: block; color: var(--soft); font-weight: 400; font-size: 13px; }
figure { margin: 10px 0 0; }
.scroll { overflow-x: auto; }
svg { display: block; width: 100%; height: auto; font: inherit; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 440px), 1fr));
  gap: 26px 34px; margin-top: 14px; }
.pair figure { margin: 0; break-inside: avoid; }
.pair p { font-size: 14px; margin: 0 0 6px; }
.legend { display: flex; flex-wrap: wrap; gap: 4px 20px; margin: 8px 0 0; padding: 0;
  list-style: none;
  font-size: 13.5px; }
.legend li { display: flex; align-items: center; gap: 7px; }
.legend svg { width: 30px; height: 14px; flex: none; }
table { border-collapse: collapse; margin: 10px 0 4px; font-size: 14px; min-width: 100%; }
caption { text-align: left; color: var(--soft); padding: 0 0 4px; font-size: 13.5px; }
th, td { text-align: left; padding: 5px 14px 5px 0; border-bottom: 1px solid var(--rule);
  vertical-align: top; }
thead th { font-size: 13px; line-height: 1.3; color: var(--soft); font-weight: 600;
  vertical-align: bottom; border-bottom: 2px solid var(--rule); }
tbody th { font-weight: 600; } .figures td { white-space: nowrap; }
td small, th small, h3 small { display: block; color: var(--soft); font-weight: 400;
  font-size: 13px; }
footer { margin-top: 38px; padding-top: 12px; border-top: 1px solid var(--rule);
  color: var(--soft);
  font-size: 13px; }
footer p { max-width: none; margin: 3px 0; overflow-wrap: anywhere; }
sup { line-height: 0; font-size: 0.75em; }
.grid { stroke: #e4e8ec; stroke-width: 1; fill: none; }
.axis { stroke: #7b8591; stroke-width: 1; fill: none; }
svg text { fill: var(--ink); font-size: 12px; stroke: #fff; stroke-width: 3.5px;
  paint-order: stroke;
  stroke-linejoin: round; }
.tick { fill: var(--soft); } .end { text-anchor: end; } .mid { text-anchor: middle; }
.label { fill: var(--soft); }
.measured, .predicted, .freerun, .residual, .trend, .limits, .threshold, .wild, .refused, .service,
.segment, .estimate, .atbound { fill: none; stroke-linejoin: round; }
.measured { stroke: #1b2026; stroke-width: 2.6; }
.predicted { stroke: #56b4e9; stroke-width: 1.2; }
.freerun { stroke: var(--orange); stroke-width: 1.7; stroke-dasharray: 7 4; }
.residual { stroke: var(--blue); stroke-width: 1; }
.expected, .prediction { fill: #d4e8f5; } .mean { fill: #8fc3e4; }
.unused { fill: #eceef1; }
.estimate { stroke: #1b2026; stroke-width: 4.4; stroke-linecap: round; }
.atbound { stroke: #fff; stroke-width: 2.2; stroke-linecap: round; }
.limits { stroke: #9aa3ad; stroke-width: 1; } .wild { stroke: var(--orange); stroke-width: 1.5; }
.refused { stroke: var(--orange); stroke-width: 1.6; }
.trend { stroke: var(--blue); stroke-width: 2.2; }
.threshold { stroke: var(--bad); stroke-width: 1.6; stroke-dasharray: 9 4 2 4; }
svg .limit { fill: var(--bad); font-weight: 600; }
.service { stroke: #1b2026; stroke-width: 1.2; } .segment { stroke: #545d68; stroke-width: 1.2;
  stroke-dasharray: 2 3; }
svg .note { font-weight: 600; }
@media (max-width: 640px) { main { padding: 20px 16px 26px; }
  .scroll > svg.wide { min-width: 620px; }
  .scroll > table { min-width: 560px; } .verdict { padding: 13px 14px; gap: 13px; }
  svg.small text { font-size: 15px; } svg.wide text { font-size: 17px; } h1 { font-size: 23px; } }
@media print { .legend { break-after: avoid; } @page { size: A4; margin: 14mm 13mm; }
  body { background: #fff; font-size: 10.2pt; }
  main { max-width: none; padding: 0; } h2 { break-after: avoid; margin-top: 22px; }
  tr, figure, .verdict, .facts { break-inside: avoid; } .scroll { overflow: visible; }
  table { font-size: 9.2pt; } th, td { padding-right: 9px; }
  .pair { grid-template-columns: 1fr 1fr; gap: 14px 18px; }
  * { -webkit-print-color-adjust: exact; print-color-adjust: exact; } }
"""
