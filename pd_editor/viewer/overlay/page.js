// Built by .ci/client.py from client/ (5ed4f2ebbddda31c); not to be edited.
"use strict";
(() => {
  // src/guidance.css
  var guidance_default = `/* marks of guidance terms, under all that can be clicked */
#pd-overlay .pd-guide-marks {
  position: absolute;
  inset: 0;
  width: 100%;
  height: 100%;
  z-index: -1;
  overflow: hidden;
}
#pd-overlay .pd-guide { --pd-mark: var(--pd-guide); cursor: pointer; }
#pd-overlay .pd-guide-threaten, #pd-overlay .pd-guide-stop-at-line { --pd-mark: var(--pd-bad); }
#pd-overlay .pd-guide-off { --pd-mark: var(--pd-faint); opacity: 0.65; }
#pd-overlay .pd-guide-faint { opacity: 0.45; }
#pd-overlay .pd-guide-refused { --pd-mark: var(--pd-bad); }
#pd-overlay .pd-guide-drags { cursor: grab; }
#pd-overlay .pd-guide path, #pd-overlay .pd-guide ellipse { fill: none; stroke-linejoin: round; stroke-linecap: round; }
#pd-overlay .pd-guide .pd-guide-halo { stroke: var(--pd-opaque); stroke-width: 6.5; }
#pd-overlay .pd-guide .pd-guide-line { stroke: var(--pd-mark); stroke-width: 3; }
#pd-overlay .pd-guide-chosen .pd-guide-line { stroke-width: 4; }
/* A path lets the trajectory that follows it be seen. */
#pd-overlay .pd-guide:is(.pd-guide-follow-path, .pd-guide-follow-lane) .pd-guide-line { stroke-width: 2.2; stroke-dasharray: 9 5; }
#pd-overlay .pd-guide:is(.pd-guide-follow-path, .pd-guide-follow-lane) .pd-guide-halo { stroke-width: 4; stroke-opacity: 0.35; }
#pd-overlay .pd-guide-off .pd-guide-line { stroke-dasharray: 6 6; }
#pd-overlay .pd-guide-point { fill: var(--pd-opaque); stroke: var(--pd-mark); stroke-width: 2; }
#pd-overlay .pd-guide-stop-at-line .pd-guide-halo { stroke-width: 9; }
#pd-overlay .pd-guide-stop-at-line .pd-guide-line { stroke-width: 5; }
#pd-overlay .pd-guide :is(.pd-guide-hit, .pd-guide-hit-line) { stroke: none; pointer-events: auto; }
#pd-overlay .pd-guide .pd-guide-hit { fill: transparent; }
#pd-overlay .pd-guide .pd-guide-hit-line { stroke: transparent; stroke-width: 16; pointer-events: stroke; }
#pd-overlay .pd-guide .pd-guide-cloth { fill: var(--pd-mark); stroke: none; }
#pd-overlay .pd-guide .pd-guide-pole { stroke: var(--pd-mark); stroke-width: 2.4; }
#pd-overlay .pd-guide .pd-guide-foot { fill: var(--pd-mark); fill-opacity: 0.3; stroke: var(--pd-opaque); stroke-width: 1.5; }
#pd-overlay .pd-guide-chosen .pd-guide-foot { fill-opacity: 0.75; }
#pd-overlay .pd-guide-offer .pd-guide-cloth { fill: var(--pd-opaque); stroke: var(--pd-mark); stroke-width: 1.8; stroke-dasharray: 3 2.4; }
#pd-overlay .pd-guide .pd-guide-leader { stroke: var(--pd-mark); stroke-width: 1.5; stroke-dasharray: 2 5; opacity: 0.8; }
#pd-overlay .pd-guide-plate { pointer-events: auto; }
#pd-overlay .pd-guide-plate circle { fill: var(--pd-opaque); stroke: var(--pd-mark); stroke-width: 1.6; }
#pd-overlay .pd-guide-plate path { stroke: var(--pd-mark); stroke-width: 1.9; }
#pd-overlay .pd-guide-chosen .pd-guide-plate circle { stroke-width: 2.6; }
#pd-overlay .pd-guide-warning circle { fill: var(--pd-warn); stroke: var(--pd-opaque); stroke-width: 1.5; }
#pd-overlay .pd-guide-warning text { fill: var(--pd-opaque); font-size: 11px; font-weight: 700; }
#pd-overlay .pd-guide-arc .pd-guide-line { stroke-width: 1.4; opacity: 0.75; }
#pd-overlay .pd-guide-arc .pd-guide-hit-line { stroke-width: 9; }
#pd-overlay .pd-guide-over-agent .pd-guide-arc * { pointer-events: none; }
#pd-overlay .pd-guide-arc:is(:hover, .pd-guide-chosen) .pd-guide-line { stroke-width: 2.8; opacity: 1; }
body:not(.pd-arcs) .pd-legend-arc { display: none !important; }
#pd-overlay .pd-guide-drawing, #pd-overlay .pd-guide-drawing * { pointer-events: none; }
:is(body.pd-guiding, body.pd-crosshair, body.pd-drawing-region) #pd-overlay .pd-guide-marks * { pointer-events: none; }
body.pd-guiding canvas { cursor: crosshair !important; }
body.pd-guide-dragging, body.pd-guide-dragging * { cursor: grabbing !important; }
#pd-overlay .pd-guide-tip { z-index: 2; pointer-events: none; }

/* the list of terms, in viser's panel */
/* Long ids make it no wider than the panel, whose width follows its contents. */
.pd-guidance { contain: inline-size; margin: 0 0.6em 0.5em; font: 13px/1.4 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; color: var(--pd-text); }
.pd-guidance :is(button, input, select) { font: inherit; color: inherit; }
.pd-guidance button { background: none; border: 0; padding: 0; cursor: pointer; }
.pd-guidance :is(button, input, select):focus-visible { outline: 2px solid var(--pd-accent); outline-offset: 1px; }
.pd-guidance-about { min-height: 20px; margin: 0 2px 6px; color: var(--pd-faint); }
.pd-guidance-tools { display: grid; grid-template-columns: repeat(3, 1fr); gap: 4px; }
.pd-guidance .pd-guidance-tool {
  display: flex;
  align-items: center;
  gap: 6px;
  min-width: 0;
  height: 32px;
  padding: 0 7px;
  border: 1px solid var(--pd-line);
  border-radius: 5px;
  font-size: 12px;
  text-align: left;
}
.pd-guidance-tool span { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.pd-guidance-tool:hover:not([aria-disabled="true"]) { background: rgba(128, 144, 160, 0.16); }
.pd-guidance-tool[aria-disabled="true"] { opacity: 0.45; cursor: default; }
.pd-guidance-tool[aria-pressed="true"] { border-color: var(--pd-guide); color: var(--pd-guide); box-shadow: inset 0 0 0 1px var(--pd-guide); }
.pd-guide-icon { flex: none; fill: none; stroke: currentColor; stroke-width: 1.6; stroke-linecap: round; stroke-linejoin: round; }
.pd-guidance-list { margin: 8px 0 0; padding: 0; list-style: none; }
.pd-guidance-row { padding: 5px 6px 6px; border-top: 1px solid var(--pd-line); border-left: 3px solid transparent; }
.pd-guidance-row:last-child { border-bottom: 1px solid var(--pd-line); }
.pd-guidance-chosen { border-left-color: var(--pd-guide); background: rgba(128, 144, 160, 0.1); }
.pd-guidance-head { display: flex; align-items: center; gap: 6px; }
.pd-guidance .pd-guidance-title { flex: 1; min-width: 0; display: flex; align-items: center; gap: 7px; height: 26px; text-align: left; border-radius: 4px; }
.pd-guidance-title .pd-guide-icon { color: var(--pd-guide); }
.pd-guidance-words { min-width: 0; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.pd-guidance-words b { font-weight: 600; margin-right: 7px; }
.pd-guidance-words span { color: var(--pd-faint); }
.pd-guidance-off :is(.pd-guidance-words, .pd-guide-icon, .pd-guidance-inputs, .pd-guidance-strength) { opacity: 0.5; }
.pd-guidance input[role="switch"] {
  appearance: none;
  flex: none;
  position: relative;
  width: 28px;
  height: 16px;
  margin: 0;
  border-radius: 8px;
  background: var(--pd-faint);
  cursor: pointer;
}
.pd-guidance input[role="switch"]::after {
  content: "";
  position: absolute;
  left: 2px;
  top: 2px;
  width: 12px;
  height: 12px;
  border-radius: 50%;
  background: #fff;
}
.pd-guidance input[role="switch"]:checked { background: var(--pd-guide); }
.pd-guidance input[role="switch"]:checked::after { left: 14px; }
.pd-guidance .pd-guidance-remove { flex: none; width: 24px; height: 24px; border-radius: 4px; font-size: 17px; line-height: 22px; color: var(--pd-faint); }
.pd-guidance-remove:hover { background: rgba(128, 144, 160, 0.2); }
.pd-guidance-inputs { display: flex; flex-wrap: wrap; gap: 4px 12px; margin-left: 25px; }
.pd-guidance label { display: inline-flex; align-items: center; gap: 6px; font-size: 12px; color: var(--pd-faint); }
.pd-guidance label :is(input, select) { color: var(--pd-text); }
.pd-guidance :is(input[type="number"], select) {
  height: 24px;
  box-sizing: border-box;
  padding: 0 5px;
  border: 1px solid var(--pd-line);
  border-radius: 4px;
  background: rgba(128, 144, 160, 0.1);
}
.pd-guidance input[type="number"] { width: 58px; font-variant-numeric: tabular-nums; }
.pd-guidance option { color: #1f2933; background: #fff; }
.pd-guidance .pd-guidance-strength { display: flex; margin: 2px 0 0 25px; }
.pd-guidance-strength input { flex: 1; min-width: 60px; height: 20px; margin: 0; accent-color: var(--pd-guide); }
.pd-guidance-strength output { width: 40px; text-align: right; font-variant-numeric: tabular-nums; color: var(--pd-text); }
.pd-guidance-notes { margin-left: 25px; }
.pd-guidance-note { position: relative; padding-left: 18px; font-size: 12px; overflow-wrap: anywhere; }
.pd-guidance-note::before { position: absolute; left: 0; font-weight: 700; content: ""; }
.pd-tone-good { color: var(--pd-good); }
.pd-tone-good::before { content: "\\2713"; }
.pd-tone-bad { color: var(--pd-bad); }
.pd-tone-bad::before { content: "\\2715"; }
.pd-tone-warn { color: var(--pd-warn); }
.pd-tone-warn::before { content: "!"; left: 4px; }
.pd-tone-plain { color: var(--pd-faint); }
.pd-guidance-foot { margin-top: 8px; padding: 6px 8px; border: 1px solid var(--pd-line); border-radius: 5px; }
.pd-guidance-foot table { width: 100%; margin-top: 4px; border-collapse: collapse; font-size: 12px; font-variant-numeric: tabular-nums; }
.pd-guidance-foot :is(th, td) { padding: 1px 0; text-align: right; font-weight: 400; }
.pd-guidance-foot :is(th, td):first-child { text-align: left; color: var(--pd-faint); }
.pd-guidance-foot th { color: var(--pd-faint); border-bottom: 1px solid var(--pd-line); }
.pd-guidance [hidden] { display: none; }
.pd-guidance .pd-guidance-take { margin-top: 5px; padding: 4px 10px; border: 1px solid var(--pd-accent); border-radius: 4px; color: var(--pd-accent); font-weight: 600; }
.pd-guidance .pd-guidance-ask { width: 100%; height: 32px; margin-top: 8px; border: 1px solid var(--pd-line); border-radius: 5px; font-size: 12px; }
.pd-guidance-ask:hover { background: rgba(128, 144, 160, 0.16); }
.pd-guidance-ask[aria-expanded="true"] { border-color: var(--pd-bad); color: var(--pd-bad); }
.pd-guidance-ask:disabled { opacity: 0.45; cursor: default; }
.pd-possible { max-height: 60vh; margin-top: 6px; overflow-y: auto; }
.pd-guidance .pd-possible-line { display: flex; align-items: center; gap: 7px; width: 100%; min-height: 24px; padding: 2px 4px; border-radius: 4px; font-size: 12px; text-align: left; }
.pd-possible-line b { flex: none; font-weight: 600; }
.pd-possible-line span { min-width: 0; }
.pd-possible-line .pd-guide-icon { color: var(--pd-guide); }
.pd-possible-line.pd-guide-threaten .pd-guide-icon { color: var(--pd-bad); }
.pd-possible-line[aria-pressed="true"]::after { content: "\\2713"; margin-left: auto; color: var(--pd-good); }
.pd-possible-line:is(:hover, .pd-possible-pointed) { background: rgba(128, 144, 160, 0.16); }
.pd-guidance-runs { display: flex; gap: 4px; margin-top: 8px; }
.pd-guidance-runs button { height: 34px; padding: 0 12px; border-radius: 5px; }
.pd-guidance-runs button:disabled { opacity: 0.5; cursor: default; }
.pd-guidance .pd-guidance-all { border: 1px solid var(--pd-line); }
.pd-guidance .pd-guidance-run { flex: 1; min-width: 0; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; background: var(--pd-accent); color: var(--pd-opaque); font-weight: 600; }
`;

  // src/locks.css
  var locks_default = `/* padlocks beside locked agents */
#pd-overlay .pd-lock {
  position: absolute;
  z-index: -1;
  left: 0;
  top: 0;
  display: flex;
  align-items: center;
  height: 18px;
  padding: 0 2px;
  border-radius: 5px;
  background: var(--pd-surface);
  border: 1px solid var(--pd-line);
  color: var(--pd-text);
  font-size: 11px;
  font-variant-numeric: tabular-nums;
  line-height: 1;
  white-space: nowrap;
}
#pd-overlay .pd-lock svg { width: 13px; height: 13px; }
#pd-overlay .pd-lock path, #pd-overlay .pd-legend-lock path {
  stroke: currentColor;
  stroke-width: 1.6;
  stroke-linejoin: round;
  fill: none;
}
#pd-overlay .pd-lock-trajectory path { fill: currentColor; fill-rule: evenodd; }
#pd-overlay .pd-lock-beginning path { fill: currentColor; fill-opacity: 0.35; }
#pd-overlay .pd-lock-seconds:not(:empty) { padding: 0 1px 0 2px; }
#pd-overlay .pd-lock.pd-compact .pd-lock-seconds { display: none; }
#pd-overlay:has(.pd-still:not(.pd-gone)) .pd-lock { visibility: hidden; }
#pd-overlay .pd-agents .pd-badge.pd-locked {
  background: var(--pd-text);
  -webkit-mask: url("data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E%3Cpath d='M3 7h10v7H3z'/%3E%3Cpath d='M5 7V5a3 3 0 0 1 6 0v2' fill='none' stroke='%23000' stroke-width='1.8'/%3E%3C/svg%3E") center / 14px no-repeat;
  mask: url("data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E%3Cpath d='M3 7h10v7H3z'/%3E%3Cpath d='M5 7V5a3 3 0 0 1 6 0v2' fill='none' stroke='%23000' stroke-width='1.8'/%3E%3C/svg%3E") center / 14px no-repeat;
  height: 14px;
}
`;

  // src/style.css
  var style_default = `#pd-overlay, .pd-hosted {
  --pd-surface: rgba(255, 255, 255, 0.94);
  --pd-opaque: rgb(255, 255, 255);
  --pd-text: #1f2933;
  --pd-faint: #66727f;
  --pd-line: #d3d9df;
  --pd-accent: #1c6fd1;
  --pd-good: #23834a;
  --pd-warn: #b65a00;
  --pd-bad: #c62828;
  --pd-ghost: #7054be;
  --pd-guide: #a3179c;
  --pd-line-1: #1c6fd1;
  --pd-line-2: #c2560a;
  --pd-line-3: #0c7d56;
}
#pd-overlay {
  position: fixed;
  overflow: hidden;
  pointer-events: none;
  z-index: 5;
  /* Room below the lists at the left, for scale bar and timeline. */
  --pd-below: 148px;
  color: var(--pd-text);
  font: 13px/1.35 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif;
}
#pd-overlay.pd-dark, .pd-dark-page .pd-hosted {
  --pd-surface: rgba(31, 37, 45, 0.94);
  --pd-opaque: rgb(31, 37, 45);
  --pd-text: #e6eaee;
  --pd-faint: #9aa6b2;
  --pd-line: #3b4551;
  --pd-accent: #6fb0ff;
  --pd-good: #62c48a;
  --pd-warn: #f0a04b;
  --pd-bad: #ff7b72;
  --pd-ghost: #a894f0;
  --pd-guide: #f08ae8;
  --pd-line-1: #6fb0ff;
  --pd-line-2: #f2984a;
  --pd-line-3: #4fd1a0;
}
#pd-overlay .pd-element { display: contents; }
#pd-overlay .pd-solid {
  position: absolute;
  pointer-events: auto;
  background: var(--pd-surface);
  border: 1px solid var(--pd-line);
  border-radius: 6px;
  box-shadow: 0 1px 4px rgba(0, 0, 0, 0.12);
}
#pd-overlay button {
  font: inherit;
  color: inherit;
  background: none;
  border: 0;
  border-radius: 4px;
  padding: 3px 8px;
  cursor: pointer;
}
#pd-overlay button:hover:not(:disabled) { background: rgba(128, 144, 160, 0.2); }
#pd-overlay button:focus-visible { outline: 2px solid var(--pd-accent); }
#pd-overlay button:disabled { opacity: 0.4; cursor: default; }

/* viser's notices: below toolbar and banner, beside the agent list */
.mantine-Notifications-root { top: 100px !important; }
body:has(.pd-agents.pd-solid:not([hidden])) .mantine-Notifications-root { left: 324px !important; }

/* scorecard: in the place of the agent list */
#pd-overlay .pd-agents.pd-score { bottom: auto; max-height: calc(100% - 104px - var(--pd-below)); overflow-y: auto; }
#pd-overlay .pd-score-title { flex: 1; line-height: 28px; padding-left: 4px; }
#pd-overlay .pd-score-note { padding: 0 12px 6px; font-size: 11.5px; opacity: 0.75; }
#pd-overlay .pd-score-row {
  display: grid;
  grid-template-columns: 16px 1fr 68px 72px;
  width: 100%;
  padding: 2px 10px;
  border: 0;
  background: none;
  text-align: left;
  font-size: 12px;
  line-height: 18px;
}
#pd-overlay .pd-score-name { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
#pd-overlay .pd-score-head { font-size: 11px; opacity: 0.75; }
#pd-overlay .pd-score-head .pd-score-value { font-weight: 400; }
#pd-overlay .pd-score-row:disabled { opacity: 1; }
#pd-overlay .pd-score-row:not(:disabled):hover { background: rgba(128, 144, 160, 0.18); }
#pd-overlay .pd-score-value { white-space: nowrap; font-variant-numeric: tabular-nums; font-weight: 600; text-align: right; }
#pd-overlay .pd-score-usual { white-space: nowrap; font-variant-numeric: tabular-nums; font-size: 11px; opacity: 0.75; text-align: right; }
#pd-overlay .pd-score-dot.pd-good { color: #1f9d55; }
#pd-overlay .pd-score-dot.pd-warn { color: #c77700; }
#pd-overlay .pd-score-dot.pd-bad { color: #d32f2f; }
#pd-overlay .pd-score-mark {
  display: inline-block;
  width: 11px;
  height: 7px;
  margin-left: 4px;
  border-radius: 1px;
  background: var(--pd-bad);
}
#pd-overlay .pd-score-mark.pd-score-striped {
  background: repeating-linear-gradient(90deg, var(--pd-bad) 0 2.5px, transparent 2.5px 4.2px);
}
#pd-overlay .pd-score-row[aria-expanded="true"] { background: rgba(28, 111, 209, 0.16); }
#pd-overlay .pd-score-detail { margin: 2px 10px 6px 18px; border-left: 2px solid var(--pd-line); }
#pd-overlay .pd-score-finding {
  display: flex;
  gap: 6px;
  width: 100%;
  padding: 2px 6px;
  border-radius: 0;
  font-size: 12px;
  line-height: 18px;
  text-align: left;
}
#pd-overlay .pd-score-finding[aria-current="true"] { background: rgba(28, 111, 209, 0.16); }
#pd-overlay .pd-score-finding b { flex: none; max-width: 84px; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; font-weight: 600; }
#pd-overlay .pd-score-text { flex: 1; min-width: 0; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
#pd-overlay .pd-score-time { flex: none; color: var(--pd-faint); font-variant-numeric: tabular-nums; }
#pd-overlay .pd-score-cures { display: flex; flex-wrap: wrap; gap: 4px; padding: 3px 6px 5px; }
#pd-overlay .pd-score-cures button {
  padding: 1px 7px;
  border: 1px solid var(--pd-line);
  font-size: 12px;
  color: var(--pd-accent);
  text-align: left;
}
#pd-overlay .pd-score-detail .pd-score-note { padding: 0 6px; }
#pd-overlay .pd-score-draw { display: flex; align-items: center; gap: 6px; padding: 4px 10px 2px; font-size: 12px; cursor: pointer; }
#pd-overlay .pd-score-draw input { margin: 0; }
#pd-overlay .pd-charts { padding: 8px 0 4px; margin-top: 4px; border-top: 1px solid rgba(128, 144, 160, 0.3); }
#pd-overlay .pd-chart { padding: 0 12px 4px; }
#pd-overlay .pd-chart-title { display: flex; font-size: 11.5px; }
#pd-overlay .pd-chart-title > :first-child { margin-left: auto; }
#pd-overlay .pd-chart-value { min-width: 40px; font-weight: 600; font-variant-numeric: tabular-nums; text-align: right; }
#pd-overlay .pd-chart svg { display: block; width: 100%; }
#pd-overlay .pd-chart-grid { stroke: rgba(128, 144, 160, 0.35); }
#pd-overlay .pd-chart-text { font-size: 9.5px; text-anchor: end; fill: currentColor; opacity: 0.7; }
#pd-overlay .pd-chart-line { fill: none; stroke-width: 1.6; }
#pd-overlay .pd-chart-head { stroke: currentColor; stroke-width: 1; opacity: 0.7; }
#pd-overlay .pd-chart-legend { display: flex; gap: 12px; padding: 0 12px 4px; font-size: 11.5px; }
#pd-overlay .pd-chart-legend span { max-width: 84px; overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
#pd-overlay .pd-chart-legend span::before { content: "\\2014 "; color: var(--line); font-weight: 700; }

/* agent list */
#pd-overlay .pd-agents {
  left: 12px;
  top: 104px;
  bottom: var(--pd-below);
  width: 300px;
  box-sizing: border-box;
  display: flex;
  flex-direction: column;
  padding: 8px 0 6px;
}
#pd-overlay .pd-agents-head, #pd-overlay .pd-agents-filters,
#pd-overlay .pd-agents-foot { display: flex; gap: 4px; padding: 0 8px 6px; }
#pd-overlay .pd-agents input, #pd-overlay .pd-agents select {
  font: inherit;
  color: inherit;
  background: rgba(128, 144, 160, 0.12);
  border: 1px solid var(--pd-line);
  border-radius: 4px;
  min-width: 0;
}
#pd-overlay .pd-agents option { color: #1f2933; background: #fff; }
#pd-overlay .pd-agents .pd-search { flex: 1; height: 28px; padding: 0 8px; box-sizing: border-box; }
#pd-overlay .pd-agents .pd-close { width: 28px; padding: 0; font-size: 18px; line-height: 26px; }
#pd-overlay .pd-agents-filters button, #pd-overlay .pd-agents-foot button {
  border: 1px solid var(--pd-line);
}
#pd-overlay .pd-agents-filters button[aria-pressed="true"] {
  color: var(--pd-accent);
  border-color: var(--pd-accent);
}
#pd-overlay .pd-agents-filters select { flex: 1; }
#pd-overlay .pd-agents-columns, #pd-overlay .pd-agents-row {
  display: grid;
  grid-template-columns: 1fr 44px 46px 62px;
  align-items: center;
}
#pd-overlay .pd-agents-columns {
  padding: 0 14px 2px 8px;
  border-bottom: 1px solid var(--pd-line);
  color: var(--pd-faint);
  font-size: 12px;
}
#pd-overlay .pd-agents-columns button { padding: 2px 4px; text-align: right; }
#pd-overlay .pd-agents-columns button:first-child { text-align: left; }
#pd-overlay .pd-agents-columns button:last-child { text-align: left; padding-left: 8px; }
#pd-overlay .pd-agents-list {
  position: relative;
  flex: 1;
  min-height: 48px;
  overflow: hidden scroll;
  scrollbar-width: thin;
}
#pd-overlay .pd-agents-list:focus-visible { outline: 2px solid var(--pd-accent); outline-offset: -2px; }
#pd-overlay .pd-agents-space { position: relative; }
#pd-overlay .pd-agents-row {
  position: absolute;
  left: 0;
  right: 0;
  height: 24px;
  padding: 0 6px 0 8px;
  grid-template-columns: 18px 1fr 44px 46px 62px;
  cursor: pointer;
  user-select: none;
}
#pd-overlay .pd-agents-row:hover { background: rgba(128, 144, 160, 0.18); }
#pd-overlay .pd-agents-row.pd-lit { background: rgba(128, 144, 160, 0.32); }
#pd-overlay .pd-agents-row[aria-selected="true"] {
  background: rgba(255, 196, 0, 0.26);
  box-shadow: inset 3px 0 0 #ffc400;
}
#pd-overlay .pd-agents .pd-name { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
#pd-overlay .pd-agents .pd-number { text-align: right; font-variant-numeric: tabular-nums; padding-right: 4px; }
#pd-overlay .pd-agents .pd-badges { display: flex; gap: 2px; padding-left: 8px; overflow: hidden; }
#pd-overlay .pd-agents .pd-badge {
  width: 14px;
  flex: none;
  border-radius: 3px;
  text-align: center;
  font-size: 10px;
  font-weight: 700;
  line-height: 14px;
  color: #fff;
  background: #66727f;
}
#pd-overlay .pd-agents .pd-badge.pd-focal { background: #c9540a; }
#pd-overlay .pd-agents .pd-badge.pd-ego { background: #00817a; }
#pd-overlay .pd-agents .pd-badge.pd-bad { background: #c62828; }
#pd-overlay .pd-agents .pd-badge.pd-warn { background: #b65a00; }
#pd-overlay .pd-agents .pd-badge.pd-new { background: #1c6fd1; }
#pd-overlay .pd-agents .pd-glyph { width: 10px; height: 10px; border-radius: 2px; }
#pd-overlay .pd-agents .pd-glyph.pd-long { width: 14px; height: 8px; }
#pd-overlay .pd-agents .pd-glyph.pd-dot { border-radius: 50%; }
#pd-overlay .pd-agents .pd-glyph.pd-peak { clip-path: polygon(50% 0, 100% 100%, 0 100%); }
#pd-overlay .pd-agents .pd-glyph.pd-thing { clip-path: polygon(50% 0, 100% 50%, 50% 100%, 0 50%); }
#pd-overlay .pd-agents-count {
  padding: 5px 8px;
  border-top: 1px solid var(--pd-line);
  color: var(--pd-faint);
  font-size: 12px;
}
#pd-overlay .pd-agents-foot { padding-bottom: 0; }
#pd-overlay .pd-agents-foot button { flex: auto; padding: 3px 4px; }

/* Timeline */
#pd-overlay .pd-timeline-bar {
  left: 12px;
  right: 12px;
  bottom: 8px;
  height: 48px;
  box-sizing: border-box;
  padding: 0 6px;
  display: flex;
  align-items: center;
  gap: 2px;
  user-select: none;
}
#pd-overlay .pd-timeline-bar > button {
  flex: none;
  height: 30px;
  min-width: 30px;
  display: inline-flex;
  align-items: center;
  justify-content: center;
  white-space: nowrap;
}
#pd-overlay .pd-timeline-bar .pd-speed {
  width: 46px;
  padding: 0;
  font-variant-numeric: tabular-nums;
}
#pd-overlay .pd-timeline-bar [aria-label="Loop"] { color: var(--pd-faint); opacity: 0.6; }
#pd-overlay .pd-timeline-bar [aria-pressed="true"] { color: var(--pd-accent); opacity: 1; }
#pd-overlay .pd-time {
  flex: none;
  width: 50px;
  text-align: right;
  font-variant-numeric: tabular-nums;
  font-weight: 600;
}
#pd-overlay .pd-track {
  position: relative;
  flex: 1;
  min-width: 60px;
  height: 100%;
  margin: 0 14px;
  cursor: pointer;
  touch-action: none;
}
#pd-overlay .pd-lane { position: absolute; left: 0; right: 0; top: 21px; height: 6px; border-radius: 3px; background: var(--pd-line); overflow: hidden; }
#pd-overlay .pd-past, #pd-overlay .pd-future { position: absolute; top: 0; bottom: 0; }
#pd-overlay .pd-past { left: 0; background: var(--pd-faint); opacity: 0.55; }
#pd-overlay .pd-future { background: var(--pd-accent); opacity: 0.55; }
#pd-overlay .pd-second { position: absolute; top: 28px; width: 1px; height: 4px; background: var(--pd-faint); }
#pd-overlay .pd-second span { position: absolute; top: 4px; left: 0; transform: translateX(-50%); font-size: 10px; line-height: 12px; color: var(--pd-faint); font-variant-numeric: tabular-nums; }
#pd-overlay .pd-zero { top: 17px; width: 3px; height: 15px; margin-left: -1px; border-radius: 1px; background: var(--pd-text); }
#pd-overlay .pd-zero span { top: 15px; left: 1px; color: var(--pd-text); font-weight: 700; }
#pd-overlay .pd-knob { position: absolute; top: 14px; width: 2px; height: 20px; margin-left: -1px; background: var(--pd-accent); pointer-events: none; }
#pd-overlay .pd-knob::after {
  content: "";
  position: absolute;
  left: -6px;
  top: 3px;
  width: 14px;
  height: 14px;
  box-sizing: border-box;
  border-radius: 50%;
  background: var(--pd-accent);
  border: 2px solid var(--pd-surface);
  box-shadow: 0 1px 3px rgba(0, 0, 0, 0.35);
}
/* toolbar */
#pd-overlay .pd-bar { left: 12px; top: 12px; display: flex; padding: 3px; gap: 1px; }
#pd-overlay .pd-bar button {
  position: relative;
  width: 30px;
  height: 30px;
  padding: 6px;
  line-height: 0;
}
#pd-overlay .pd-bar button.pd-group { margin-left: 9px; }
#pd-overlay .pd-bar button.pd-group::before {
  content: "";
  position: absolute;
  left: -6px;
  top: 4px;
  bottom: 4px;
  border-left: 1px solid var(--pd-line);
}
#pd-overlay .pd-bar svg {
  width: 18px;
  height: 18px;
  fill: none;
  stroke: currentColor;
  stroke-width: 1.6;
  stroke-linecap: round;
  stroke-linejoin: round;
}
#pd-overlay .pd-bar button[aria-pressed="true"] {
  background: var(--pd-accent);
  color: #fff;
}
#pd-overlay.pd-dark .pd-bar button[aria-pressed="true"] { color: #10161d; }
#pd-overlay .pd-bar button[aria-disabled="true"] svg { opacity: 0.32; }
#pd-overlay .pd-bar button[aria-disabled="true"] { cursor: default; }
#pd-overlay [data-hint]:hover::after,
#pd-overlay [data-hint]:focus-visible::after {
  content: attr(data-hint);
  position: absolute;
  left: 0;
  top: calc(100% + 9px);
  z-index: 1;
  width: max-content;
  max-width: 260px;
  padding: 4px 8px;
  border: 1px solid var(--pd-line);
  border-radius: 4px;
  background: var(--pd-surface);
  color: var(--pd-text);
  line-height: 1.35;
  text-align: left;
  pointer-events: none;
}

/* view */
body.pd-can-pan canvas { cursor: grab !important; }
body:is(.pd-pans, .pd-holds-agent) canvas { cursor: grabbing !important; }


/* labels, under all that can be clicked */
#pd-overlay .pd-leaders, #pd-overlay .pd-label { z-index: -1; }
#pd-overlay .pd-leaders {
  position: absolute;
  inset: 0;
  width: 100%;
  height: 100%;
  overflow: visible;
}
#pd-overlay .pd-leaders line {
  stroke: var(--pd-text);
  stroke-width: 1.25;
  opacity: 0.75;
}
#pd-overlay .pd-label {
  position: absolute;
  left: 0;
  top: 0;
  padding: 1px 6px;
  white-space: nowrap;
  font-size: 12px;
  font-variant-numeric: tabular-nums;
  background: var(--pd-surface);
  border: 1px solid var(--pd-line);
  border-radius: 4px;
}
#pd-overlay .pd-label-note { color: var(--pd-ghost); white-space: pre; }
#pd-overlay .pd-label-note:empty { display: none; }
/* Banner */
#pd-overlay .pd-banner-bar {
  top: 60px;
  left: 12px;
  right: 12px;
  width: fit-content;
  margin: 0 auto;
  height: 34px;
  box-sizing: border-box;
  padding: 0 6px 0 12px;
  display: flex;
  align-items: center;
  gap: 10px;
  border-color: var(--pd-accent);
  box-shadow: 0 2px 8px rgba(0, 0, 0, 0.18);
}
#pd-overlay [hidden] { display: none !important; }
#pd-overlay .pd-banner-text {
  overflow: hidden;
  white-space: nowrap;
  text-overflow: ellipsis;
  padding-right: 6px;
}
#pd-overlay .pd-banner-bar button {
  flex: none;
  color: var(--pd-accent);
  font-weight: 600;
}

/* lost connection: what does nothing looks so, above all that could be open */
#pd-overlay .pd-connection-bar { z-index: 11; border-color: var(--pd-bad); color: var(--pd-bad); font-weight: 600; }
#pd-overlay .pd-connection-bar.pd-good { border-color: var(--pd-good); color: var(--pd-good); }
#pd-overlay .pd-connection-bar .pd-banner-text { padding-right: 12px; }
#pd-overlay.pd-lost .pd-element:not(.pd-connection) > * { opacity: 0.4; filter: grayscale(1); pointer-events: none !important; }
/* viser's panel before it has ours in it: connected again, it is for developers. */
body:has(.pd-lost):not(:has([role="tablist"])) .mantine-Paper-root { visibility: hidden; }

/* Placing */
body.pd-crosshair canvas { cursor: crosshair !important; }
#pd-overlay .pd-placing-ghost { position: absolute; inset: 0; width: 100%; height: 100%; }
#pd-overlay .pd-placing-ghost path { fill: none; stroke: var(--pd-placing); stroke-linejoin: round; }
#pd-overlay .pd-placing-ghost .pd-placing-base { fill: var(--pd-placing); fill-opacity: 0.4; stroke-width: 1.5; }
#pd-overlay .pd-placing-ghost .pd-placing-edges { stroke-width: 1; stroke-opacity: 0.7; }
#pd-overlay .pd-placing-ghost .pd-placing-arrow { stroke-width: 2.5; stroke-linecap: round; }
#pd-overlay .pd-gone { display: none; }
#pd-overlay .pd-still { position: absolute; inset: 0; width: 100%; height: 100%; z-index: -1; }
#pd-overlay:has(.pd-still:not(.pd-gone)) :is(.pd-label, .pd-leaders) { visibility: hidden; }

/* compass */
#pd-overlay .pd-compass {
  right: 12px;
  top: 12px;
  width: 44px;
  height: 44px;
  padding: 1px;
  border: 1px solid var(--pd-line);
  border-radius: 50%;
  background: var(--pd-surface);
}
#pd-overlay .pd-compass:hover:not(:disabled) { background: var(--pd-surface); border-color: var(--pd-faint); }
#pd-overlay .pd-compass svg { display: block; width: 40px; height: 40px; }
#pd-overlay .pd-compass .pd-north { fill: var(--pd-bad); }
#pd-overlay .pd-compass .pd-south { fill: var(--pd-faint); }
#pd-overlay .pd-compass text { fill: currentColor; font-size: 9px; font-weight: 700; }
#pd-overlay .pd-compass[data-hint]::after { left: auto; right: 0; }
#pd-overlay .pd-scalebar {
  position: absolute;
  left: 12px;
  bottom: 62px;
  padding: 2px 5px 1px;
  margin-left: -5px;
  border-radius: 4px;
  background: var(--pd-surface);
  font-size: 12px;
}
#pd-overlay .pd-scalebar-line {
  box-sizing: border-box;
  height: 6px;
  border: 2px solid var(--pd-text);
  border-top: 0;
  filter: drop-shadow(0 0 1px var(--pd-surface));
}

/* measure */
#pd-overlay .pd-measure-layer {
  position: absolute;
  inset: 0;
  z-index: -1;
  pointer-events: auto;
  cursor: crosshair;
}
#pd-overlay .pd-measure-layer svg { position: absolute; width: 100%; height: 100%; }
#pd-overlay .pd-measure-halo { stroke: var(--pd-surface); stroke-width: 5; stroke-linecap: round; }
#pd-overlay .pd-measure-line, #pd-overlay .pd-measure-open { stroke: var(--pd-accent); stroke-width: 2; }
#pd-overlay .pd-measure-open { stroke-dasharray: 6 4; }
#pd-overlay .pd-measure-layer circle { fill: var(--pd-surface); stroke: var(--pd-accent); stroke-width: 2; }
#pd-overlay .pd-measure-label {
  position: absolute;
  padding: 2px 7px;
  border: 1px solid var(--pd-line);
  border-radius: 4px;
  background: var(--pd-surface);
  white-space: nowrap;
  pointer-events: none;
  font-variant-numeric: tabular-nums;
}
#pd-overlay .pd-measure-total { margin: 10px 0 0 12px; }
#pd-overlay .pd-measure-total div:first-child { font-weight: 600; }
#pd-overlay .pd-measure-part { margin: -22px 0 0 8px; font-size: 11px; color: var(--pd-faint); }

/* region */
body.pd-drawing-region canvas { cursor: crosshair !important; }
#pd-overlay .pd-region-drawing { position: absolute; inset: 0; width: 100%; height: 100%; z-index: -1; }
#pd-overlay .pd-region-drawing path { fill: none; stroke-linejoin: round; }
#pd-overlay .pd-region-drawing .pd-region-area { fill: var(--pd-accent); fill-opacity: 0.1; }
#pd-overlay .pd-region-drawing .pd-region-halo { stroke: var(--pd-surface); stroke-width: 5; }
#pd-overlay .pd-region-drawing .pd-region-edge { stroke: var(--pd-accent); stroke-width: 2; stroke-dasharray: 8 4; }
#pd-overlay .pd-region-small .pd-region-area { fill: var(--pd-bad); }
#pd-overlay .pd-region-small .pd-region-edge { stroke: var(--pd-bad); }
#pd-overlay .pd-region-label {
  position: absolute;
  top: 0;
  left: 0;
  display: flex;
  align-items: center;
  gap: 2px;
  padding: 1px 4px 1px 8px;
  border: 1px solid var(--pd-line);
  border-radius: 4px;
  background: var(--pd-surface);
  font-size: 12px;
  white-space: nowrap;
  font-variant-numeric: tabular-nums;
}
#pd-overlay .pd-region-label.pd-gone { display: none; }
#pd-overlay .pd-region-clear { padding: 0 5px; font-size: 15px; line-height: 1.2; }

/* panel: viser's settings (its scene tree, its "Reset view") are for developers */
body:not(.pd-debug) button:has(svg.tabler-icon-adjustments) { display: none !important; }

/* viser's grey buttons look disabled, and its disabled ones like fields. */
:where([style*="--mantine-color-gray-filled"]).mantine-Button-root,
:where([data-disabled]).mantine-Button-root {
  background: none;
  border: 1px solid var(--mantine-color-default-border);
  color: var(--mantine-color-text);
}
:where([style*="--mantine-color-gray-filled"]:hover:not([data-disabled])).mantine-Button-root {
  background: rgba(128, 144, 160, 0.16);
}
:where([data-disabled]).mantine-Button-root { opacity: 0.45; }
/* viser squeezes the letters of its labels and fields. */
[style*="letter-spacing"], .mantine-Input-input { letter-spacing: 0 !important; }

/* Eight tabs fit into one row. */
[role="tablist"] > [role="tab"] { padding-inline: 5px !important; font-size: 13px !important; }

/* Its tabs stay in sight while what is under them scrolls. Parts around them that are
   "hidden" would be what they stick to. */
[data-scrollarea-viewport] :has([role="tablist"]) { overflow: clip !important; }
[data-scrollarea-viewport] [role="tablist"] {
  position: sticky;
  top: 1px;
  z-index: 5;
  background: var(--mantine-color-body);
  box-shadow: 0 -2px 0 var(--mantine-color-body);
}

/* legend */
#pd-overlay .pd-legend-box { left: 12px; bottom: 104px; font-size: 11.5px; }
#pd-overlay .pd-legend-list {
  margin: 0;
  padding: 6px 8px 2px;
  list-style: none;
  display: grid;
  grid-template-columns: auto auto;
  gap: 2px 10px;
}
#pd-overlay .pd-legend-list li { display: flex; align-items: center; gap: 6px; }
#pd-overlay .pd-legend-chip { width: 100%; text-align: left; padding: 3px 10px; }
#pd-overlay .pd-legend-chip::after {
  content: "";
  float: right;
  margin: 5px 0 0 12px;
  border: 4px solid transparent;
  border-top: 5px solid currentColor;
  border-bottom: 0;
}
#pd-overlay .pd-legend-chip[aria-expanded="false"]::after {
  border-top: 0;
  border-bottom: 5px solid currentColor;
}
#pd-overlay .pd-legend-mark { flex: none; width: 16px; height: 10px; box-sizing: border-box; }
#pd-overlay span.pd-legend-mark.pd-legend-fill { background: currentColor; border-radius: 2px; }
/* A long box, seen from above and behind. */
#pd-overlay span.pd-legend-mark.pd-legend-shaded {
  background: linear-gradient(
    currentColor 45%, color-mix(in srgb, currentColor 35%, #05070c) 45%);
  border-radius: 2px;
}
#pd-overlay .pd-legend-lock { display: flex; justify-content: center; height: 14px; }
#pd-overlay .pd-legend-lock svg { width: 14px; height: 14px; }
#pd-overlay .pd-legend-line { height: 4px; background: currentColor; border-radius: 2px; }
#pd-overlay .pd-legend-dots {
  height: 3px;
  background: repeating-linear-gradient(
    90deg, currentColor 0 4px, transparent 4px 7px);
}
#pd-overlay .pd-legend-ring {
  width: 12px;
  height: 12px;
  margin: 0 3px;
  border: 2.5px solid currentColor;
  border-radius: 50%;
}
/* Beside the agent list while that is open. */
#pd-overlay:has(.pd-agents.pd-solid:not([hidden])) .pd-legend-box { left: 324px; }
/* hints */
#pd-overlay .pd-hint {
  /* Above the status, and beside the legend also where the picture is narrow. */
  right: 12px;
  bottom: 110px;
  max-width: calc(100% - 298px);
  display: flex;
  align-items: baseline;
  gap: 6px;
  padding: 4px 4px 4px 12px;
}
#pd-overlay .pd-hint-count { color: var(--pd-faint); font-variant-numeric: tabular-nums; }
#pd-overlay .pd-hint-count, #pd-overlay .pd-hint b { flex: none; }
#pd-overlay .pd-hint button { align-self: center; margin-left: auto; line-height: 1; }
#pd-overlay.pd-lists-problems .pd-hint { visibility: hidden; }
/* Beside a list at the left there is room for the legend in wide pictures only, where it
   does not reach the focal agent in the middle, and none above the strip of samples. */
@media (max-width: 1680px) {
  #pd-overlay:has(.pd-agents.pd-solid:not([hidden])) .pd-legend-box { visibility: hidden; }
}
#pd-overlay.pd-shows-samples:has(.pd-agents.pd-solid:not([hidden])) .pd-legend-box,
#pd-overlay:has(.pd-pair:not([hidden])) .pd-legend-box { visibility: hidden; }
/* keys */
#pd-overlay .pd-veil {
  position: absolute;
  inset: 0;
  z-index: 10;
  display: flex;
  pointer-events: auto;
  background: rgba(0, 0, 0, 0.28);
}
#pd-overlay .pd-sheet {
  position: relative;
  margin: auto;
  max-width: calc(100% - 48px);
  max-height: calc(100% - 48px);
  overflow: auto;
  padding: 14px 20px 16px;
  outline: none;
  background: var(--pd-opaque);
}
#pd-overlay .pd-sheet-close { position: absolute; right: 8px; top: 8px; font-size: 16px; }
#pd-overlay .pd-sheet-columns { columns: 2 340px; column-gap: 28px; }
#pd-overlay .pd-sheet h2 { margin: 0 0 6px; font-size: 13px; font-weight: 600; }
#pd-overlay .pd-sheet dl { margin: 0 0 10px; }
#pd-overlay .pd-sheet dl > div {
  display: grid;
  grid-template-columns: 150px 1fr;
  gap: 8px;
  padding-bottom: 2px;
  break-inside: avoid;
}
#pd-overlay .pd-sheet dt { color: var(--pd-faint); }
/* A notice that stays would cover it, and the comparison of samples. */
html:has(:is(.pd-veil, .pd-pair):not([hidden])) .mantine-Notifications-root { visibility: hidden; }
#pd-overlay .pd-sheet dd { margin: 0; }
/* part of a map */
#pd-overlay .pd-map-window .pd-solid {
  inset: 16px;
  display: flex;
  flex-direction: column;
  gap: 8px;
  padding: 12px;
  background: var(--pd-opaque);
}
#pd-overlay .pd-map-window[hidden] { display: none; }
#pd-overlay .pd-map-window svg { flex: 1; min-height: 0; cursor: crosshair; touch-action: none; }
#pd-overlay .pd-map-window :is(path, rect) { fill: none; stroke: currentColor; vector-effect: non-scaling-stroke; }
#pd-overlay .pd-map-window rect { fill: var(--pd-accent); fill-opacity: 0.15; stroke: var(--pd-accent); }
#pd-overlay .pd-map-window-foot { display: flex; align-items: center; gap: 10px; }
#pd-overlay .pd-map-window-foot span { flex: 1; }
#pd-overlay .pd-map-window input { width: 74px; }
/* compare */
#pd-overlay .pd-compare {
  left: 50%;
  top: 100px;
  transform: translateX(-50%);
  padding: 4px 12px;
  color: var(--pd-ghost);
}
/* Status chip and list of problems */
#pd-overlay .pd-clipped {
  flex: 1;
  min-width: 0;
  overflow: hidden;
  text-overflow: ellipsis;
  white-space: nowrap;
}
#pd-overlay .pd-chip, #pd-overlay .pd-unsaved {
  right: 12px;
  height: 34px;
  box-sizing: border-box;
  display: flex;
  align-items: center;
  padding: 0 4px;
  overflow: hidden;
}
/* As wide as its words, but beside the strip of samples of the width left there. */
#pd-overlay .pd-chip { bottom: 64px; min-width: 280px; max-width: min(440px, calc(100% - 24px)); }
#pd-overlay.pd-shows-samples .pd-chip { max-width: 280px; }
#pd-overlay .pd-unsaved {
  bottom: 104px;
  width: 380px;
  max-width: calc(100% - 24px);
  padding-left: 10px;
  border-color: var(--pd-bad);
  color: var(--pd-bad);
  font-weight: 600;
}
#pd-overlay .pd-chip-main {
  flex: 1;
  min-width: 0;
  height: 28px;
  display: flex;
  align-items: center;
  gap: 8px;
  text-align: left;
}
#pd-overlay .pd-dot {
  flex: none;
  width: 10px;
  height: 10px;
  border-radius: 50%;
  background: var(--pd-good);
}
#pd-overlay [data-tone="warn"] .pd-dot { background: var(--pd-warn); }
#pd-overlay [data-tone="busy"] .pd-dot { background: var(--pd-accent); }
#pd-overlay [data-tone="warn"] .pd-chip-main { font-weight: 600; }
#pd-overlay .pd-caret { flex: none; color: var(--pd-faint); font-size: 10px; }
#pd-overlay .pd-strong { flex: none; color: var(--pd-accent); font-weight: 600; }
#pd-overlay .pd-unsaved .pd-strong { color: var(--pd-bad); text-decoration: underline; }
#pd-overlay .pd-quiet { color: var(--pd-faint); }
#pd-overlay .pd-progress {
  position: absolute;
  left: 0;
  bottom: 0;
  height: 3px;
  background: var(--pd-accent);
}
#pd-overlay .pd-problems {
  right: 12px;
  bottom: 106px;
  width: 380px;
  max-width: calc(100% - 24px);
  height: min(clamp(394px, 58%, 560px), calc(var(--pd-lines) * 28px + 187px));
  max-height: calc(100% - 180px);
  background: var(--pd-opaque);
  box-sizing: border-box;
  display: flex;
  flex-direction: column;
}
#pd-overlay .pd-problems:has(.pd-problem-detail[hidden]) { height: auto; }
#pd-overlay .pd-has-unsaved .pd-problems { bottom: 146px; }
#pd-overlay .pd-problem-rows { flex: 1; min-height: 0; overflow-y: auto; padding: 4px; }
#pd-overlay .pd-problem-group {
  display: block;
  width: 100%;
  text-align: left;
  color: var(--pd-faint);
  font-weight: 600;
}
#pd-overlay .pd-problem-group::before {
  content: "\\25be";
  display: inline-block;
  width: 14px;
}
#pd-overlay .pd-problem-group[aria-expanded="false"]::before { content: "\\25b8"; }
#pd-overlay .pd-problem-row {
  display: flex;
  align-items: center;
  gap: 8px;
  width: 100%;
  height: 28px;
  text-align: left;
}
#pd-overlay .pd-problem-row svg {
  flex: none;
  width: 16px;
  height: 16px;
  fill: none;
  stroke: var(--pd-bad);
  stroke-width: 1.5;
}
#pd-overlay .pd-problem-row[data-severity="notice"] svg { stroke: var(--pd-warn); }
#pd-overlay .pd-problem-row[data-severity="remark"] svg { stroke: var(--pd-faint); }
#pd-overlay .pd-problem-row[aria-current="true"] { background: rgba(28, 111, 209, 0.16); }
#pd-overlay .pd-problem-time {
  flex: none;
  color: var(--pd-faint);
  font-variant-numeric: tabular-nums;
}
#pd-overlay .pd-problem-more { padding: 4px 8px; color: var(--pd-faint); }
#pd-overlay .pd-problem-detail {
  flex: none;
  height: 178px;
  box-sizing: border-box;
  padding: 8px 12px 6px;
  border-top: 1px solid var(--pd-line);
  display: flex;
  flex-direction: column;
  gap: 4px;
}
#pd-overlay .pd-problem-sentence { flex: 1; min-height: 0; overflow-y: auto; }
#pd-overlay .pd-problem-cures {
  flex: none;
  display: flex;
  gap: 2px;
  margin: 0 -8px;
  flex-wrap: wrap;
  max-height: 112px;
  overflow-y: auto;
}
/* In a lane of their own above the track, which seeks wherever it is pressed. */
#pd-overlay .pd-mark { position: absolute; top: 1px; width: 13px; height: 13px; margin-left: -6px; padding: 0; min-width: 0; }
#pd-overlay .pd-mark::before { content: ""; display: block; margin: auto; width: 9px; height: 9px; clip-path: polygon(0 0, 100% 0, 50% 100%); background: var(--pd-bad); }
#pd-overlay .pd-mark.pd-finding::before { width: 7px; height: 7px; opacity: 0.7; }
#pd-overlay .pd-mark-hint {
  position: absolute;
  bottom: calc(100% + 4px);
  transform: translateX(-50%);
  width: max-content;
  max-width: 380px;
  padding: 4px 8px;
  white-space: pre-line;
  pointer-events: none;
}
/* Tooltip */
#pd-overlay .pd-tip {
  position: absolute;
  max-width: 320px;
  padding: 5px 9px;
  background: var(--pd-surface);
  border: 1px solid var(--pd-line);
  border-radius: 5px;
  box-shadow: 0 1px 4px rgba(0, 0, 0, 0.18);
  font-size: 12px;
  font-variant-numeric: tabular-nums;
  overflow-wrap: anywhere;
}
#pd-overlay .pd-tip div:first-child { font-weight: 600; }
#pd-overlay .pd-tip div + div { color: var(--pd-faint); }

/* Context menu */
#pd-overlay .pd-menu-list {
  z-index: 3;
  display: flex;
  flex-direction: column;
  min-width: 190px;
  padding: 4px;
  box-shadow: 0 4px 16px rgba(0, 0, 0, 0.25);
}
#pd-overlay .pd-menu-title {
  padding: 3px 8px 5px;
  margin-bottom: 3px;
  border-bottom: 1px solid var(--pd-line);
  font-size: 12px;
  color: var(--pd-faint);
}
#pd-overlay .pd-menu-list button {
  display: flex;
  justify-content: space-between;
  gap: 18px;
  padding: 4px 8px;
  text-align: left;
}
#pd-overlay .pd-menu-key { color: var(--pd-faint); font-size: 12px; }

/* samples: left of the status chip; scale bar, legend and agent list make room */
#pd-overlay .pd-samples {
  left: 12px;
  min-width: min(490px, calc(100% - 24px));
  max-width: calc(100% - 316px);
  bottom: 64px;
  height: 204px;
  box-sizing: border-box;
  display: flex;
  flex-direction: column;
  padding: 6px 8px 4px;
  gap: 6px;
  user-select: none;
}
#pd-overlay .pd-samples-head { display: flex; align-items: center; gap: 8px; height: 26px; }
#pd-overlay .pd-samples-title { white-space: nowrap; }
#pd-overlay .pd-samples-head select, #pd-overlay .pd-pair-head select {
  font: inherit;
  color: inherit;
  height: 26px;
  background: rgba(128, 144, 160, 0.12);
  border: 1px solid var(--pd-line);
  border-radius: 4px;
}
#pd-overlay .pd-samples option, #pd-overlay .pd-pair option { color: #1f2933; background: #fff; }
/* Beside the list of problems, which is wider than the chip. */
#pd-overlay.pd-lists-problems .pd-samples { max-width: calc(100% - 416px); }
#pd-overlay .pd-samples-hint {
  /* Its length does not make the strip wider. */
  flex: 1 1 0;
  width: 0;
  max-height: 26px;
  overflow: hidden;
  color: var(--pd-faint);
  font-size: 11px;
  line-height: 13px;
}
#pd-overlay .pd-samples .pd-close { width: 28px; padding: 0; font-size: 18px; line-height: 26px; }
#pd-overlay .pd-samples-list {
  flex: 1;
  display: flex;
  gap: 8px;
  overflow: auto hidden;
  scrollbar-width: thin;
}
#pd-overlay .pd-sample-box { position: relative; flex: 0 0 164px; }
#pd-overlay .pd-sample {
  box-sizing: border-box;
  width: 164px;
  padding: 3px 6px 4px;
  border: 1px solid var(--pd-line);
  border-radius: 5px;
  font-size: 12px;
  line-height: 15px;
  cursor: pointer;
}
#pd-overlay .pd-sample:hover, #pd-overlay .pd-sample:focus-visible {
  background: rgba(128, 144, 160, 0.16);
  outline: none;
  border-color: var(--pd-faint);
}
#pd-overlay .pd-sample:focus-visible { box-shadow: 0 0 0 1px var(--pd-accent); }
#pd-overlay .pd-sample[aria-selected="true"] {
  border-color: var(--pd-accent);
  box-shadow: inset 0 0 0 1px var(--pd-accent);
}
#pd-overlay .pd-sample img { display: block; width: 100%; height: 88px; border-radius: 3px; }
#pd-overlay .pd-sample-name { display: flex; justify-content: space-between; font-weight: 600; }
#pd-overlay .pd-sample-rank { color: var(--pd-faint); font-weight: 400; }
#pd-overlay .pd-sample[aria-selected="true"] .pd-sample-rank { color: var(--pd-accent); }
#pd-overlay .pd-sample-line {
  overflow: hidden;
  text-overflow: ellipsis;
  white-space: nowrap;
  font-variant-numeric: tabular-nums;
}
#pd-overlay .pd-sample-line.pd-bad { color: var(--pd-bad); }
#pd-overlay .pd-sample-keep {
  position: absolute;
  top: 4px;
  right: 4px;
  width: 24px;
  height: 24px;
  padding: 0;
  font-size: 15px;
  line-height: 22px;
  background: var(--pd-surface);
  opacity: 0;
}
#pd-overlay .pd-sample-box:hover .pd-sample-keep,
#pd-overlay .pd-sample-keep:focus-visible { opacity: 1; }
#pd-overlay.pd-shows-samples .pd-scalebar { bottom: 274px; }
#pd-overlay.pd-shows-samples .pd-legend-box { bottom: 316px; }
#pd-overlay.pd-shows-samples { --pd-below: 318px; }
#pd-overlay .pd-sample-pair { right: 32px; }
/* two samples side by side, between the banner and the strip */
#pd-overlay .pd-pair {
  left: 12px;
  right: 12px;
  top: 100px;
  bottom: 276px;
  display: flex;
  gap: 8px;
  padding: 6px 8px 8px;
  background: var(--pd-opaque);
}
#pd-overlay:has(.pd-agents.pd-solid:not([hidden])) .pd-pair { left: 324px; }
#pd-overlay .pd-pair-side { flex: 1; min-width: 0; display: flex; flex-direction: column; gap: 4px; }
#pd-overlay .pd-pair-head { display: flex; align-items: center; gap: 8px; height: 26px; }
#pd-overlay .pd-pair-head select { font-weight: 600; }
#pd-overlay .pd-pair-use { border: 1px solid var(--pd-line); padding: 1px 8px; }
#pd-overlay .pd-pair canvas {
  flex: 1;
  min-height: 0;
  width: 100%;
  border: 1px solid var(--pd-line);
  border-radius: 4px;
  cursor: grab;
  touch-action: none;
}
#pd-overlay .pd-pair > .pd-close {
  position: absolute;
  top: 5px;
  right: 6px;
  width: 28px;
  padding: 0;
  font-size: 18px;
  line-height: 26px;
}
#pd-overlay.pd-shows-samples .pd-hint { visibility: hidden; }
@media (max-height: 760px) {
  #pd-overlay .pd-samples { height: 180px; }
  #pd-overlay .pd-pair { top: 60px; bottom: 294px; }
  #pd-overlay .pd-sample img { height: 64px; object-fit: cover; }
  #pd-overlay.pd-shows-samples .pd-legend-box { visibility: hidden; }
}
/* In narrow pictures the strip lies above the status chip. */
@media (max-width: 1300px) {
  #pd-overlay .pd-samples { max-width: calc(100% - 24px) !important; bottom: 106px; }
  #pd-overlay .pd-pair { bottom: 318px; }
  /* Too narrow for a list beside it. */
  #pd-overlay:has(.pd-agents.pd-solid:not([hidden])) .pd-pair { left: 12px; z-index: 1; }
  #pd-overlay .pd-samples .pd-samples-hint { visibility: hidden; }
  #pd-overlay.pd-shows-samples .pd-legend-box { bottom: 318px; }
  #pd-overlay.pd-shows-samples .pd-scalebar { bottom: 62px; }
  #pd-overlay.pd-shows-samples { --pd-below: 318px; }
}
/* The list of problems stays beside the strip as long as a card fits there. */
@media (min-width: 1100px) and (max-width: 1300px) {
  #pd-overlay.pd-lists-problems .pd-samples {
    min-width: 0;
    max-width: calc(100% - 416px) !important;
  }
  #pd-overlay.pd-lists-problems .pd-samples-head select { flex: 1 1 60px; min-width: 0; }
  #pd-overlay.pd-lists-problems .pd-samples-hint { flex: none; }
}
`;

  // src/base.js
  (() => {
    const former = window.pdOverlay;
    if (former) former.dispose();
    const definitions = /* @__PURE__ */ new Map();
    const mounted = /* @__PURE__ */ new Map();
    const waiting = /* @__PURE__ */ new Map();
    const frameListeners = /* @__PURE__ */ new Set();
    const cleanups = [];
    let number = 0;
    let answerUuid = null;
    let isAlive = true;
    let heardAt = Date.now();
    const root = document.createElement("div");
    root.id = "pd-overlay";
    document.body.appendChild(root);
    const style = document.createElement("style");
    document.head.appendChild(style);
    const viewer = () => window.__viserMutable;
    const canvas = () => viewer()?.canvas ?? null;
    function fitToCanvas() {
      const element = canvas();
      if (!element) return;
      const box = element.getBoundingClientRect();
      for (const [name, value] of [
        ["left", box.left],
        ["top", box.top],
        ["width", box.width],
        ["height", box.height]
      ]) {
        const text = `${value}px`;
        if (root.style[name] !== text) root.style[name] = text;
      }
    }
    function project(point) {
      const { camera, nodeRefFromName } = viewer() ?? {};
      const world = nodeRefFromName?.[""];
      const element = canvas();
      if (!camera || !world || !element) return null;
      const vector = camera.position.clone().set(point[0], point[1], point[2] ?? 0);
      world.localToWorld(vector);
      const depth = vector.clone().applyMatrix4(camera.matrixWorldInverse).z;
      if (depth >= 0) return null;
      vector.project(camera);
      return [
        (0.5 + vector.x / 2) * element.clientWidth,
        (0.5 - vector.y / 2) * element.clientHeight
      ];
    }
    function ray(x, y) {
      const { camera, nodeRefFromName } = viewer() ?? {};
      const world = nodeRefFromName?.[""];
      const element = canvas();
      if (!camera || !world || !element) return null;
      const far = camera.position.clone().set(
        2 * x / element.clientWidth - 1,
        1 - 2 * y / element.clientHeight,
        0.5
      );
      far.unproject(camera);
      const start2 = camera.position.clone();
      world.worldToLocal(far);
      world.worldToLocal(start2);
      return [[start2.x, start2.y, start2.z], [far.x, far.y, far.z]];
    }
    function ground(x, y) {
      const [start2, far] = ray(x, y) ?? [];
      const fall = start2 ? start2[2] - far[2] : 0;
      if (fall <= 1e-9) return null;
      const reach = start2[2] / fall;
      return [0, 1].map((axis) => start2[axis] + reach * (far[axis] - start2[axis]));
    }
    function send(name, event) {
      if (answerUuid === null || !viewer()) return;
      number += 1;
      viewer().sendMessage({
        type: "GuiUpdateMessage",
        uuid: answerUuid,
        updates: { value: JSON.stringify({ number, element: name, event }) }
      });
    }
    const isOnPicture = (event) => event.target === canvas();
    function local(event) {
      const box = canvas().getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    }
    function take(event) {
      event.preventDefault();
      event.stopImmediatePropagation();
    }
    const isPanPress = () => document.body.classList.contains("pd-can-pan");
    function listen(target, type, listener, options) {
      target.addEventListener(type, listener, options);
      cleanups.push(() => target.removeEventListener(type, listener, options));
    }
    function followPress({ held, release, giveUp }) {
      listen(window, "pointerup", (event) => {
        if (event.pointerId !== held()?.id || event.button !== 0) return;
        take(event);
        release(event);
      }, { capture: true });
      listen(window, "pointercancel", giveUp);
      listen(window, "blur", giveUp);
      listen(window, "keydown", (event) => {
        if (event.key !== "Escape" || !held()) return;
        take(event);
        giveUp();
      }, { capture: true });
    }
    const isModePress = (event) => event.button === 0 && isOnPicture(event) && !isPanPress();
    function mount(name) {
      const box = document.createElement("div");
      box.className = `pd-element pd-${name}`;
      root.appendChild(box);
      const api = {
        box,
        root,
        canvas,
        viewer,
        project,
        ray,
        ground,
        listen,
        isOnPicture,
        local,
        take,
        isPanPress,
        isModePress,
        followPress,
        send: (event) => send(name, event),
        // Called with the camera once per drawn frame in which the view has changed.
        onView: (listener) => frameListeners.add(listener),
        onDispose: (cleanup) => cleanups.push(cleanup),
        // What the browser keeps for later visits; null where it keeps nothing.
        recall(key) {
          try {
            return JSON.parse(window.localStorage.getItem(key));
          } catch {
            return null;
          }
        },
        remember(key, value) {
          try {
            window.localStorage.setItem(key, JSON.stringify(value));
          } catch {
          }
        },
        // make("button", "pd-key", {type: "button", title: "Undo"}, "Undo")
        make(tag, className = "", attributes = {}, text = "") {
          const element = document.createElement(tag);
          if (className) element.className = className;
          for (const [key, value] of Object.entries(attributes))
            element.setAttribute(key, value);
          if (text) element.textContent = text;
          return element;
        }
      };
      const update = definitions.get(name)(api);
      box.hidden = Boolean(update);
      mounted.set(name, (state) => {
        box.hidden = false;
        update?.(state);
      });
      if (waiting.has(name)) {
        const state = waiting.get(name);
        waiting.delete(name);
        mounted.get(name)(state);
      }
    }
    let lastView = "";
    function frame() {
      if (!isAlive) return;
      const camera = viewer()?.camera;
      const element = canvas();
      if (camera && element) {
        const view = camera.matrixWorld.elements.map((v) => v.toPrecision(7)).join() + [camera.fov, element.clientWidth, element.clientHeight].join();
        if (view !== lastView) {
          lastView = view;
          fitToCanvas();
          for (const listener of frameListeners) listener(camera);
        }
      }
      requestAnimationFrame(frame);
    }
    function start() {
      if (!isAlive) return;
      if (!canvas()) {
        setTimeout(start, 50);
        return;
      }
      fitToCanvas();
      const observer = new ResizeObserver(fitToCanvas);
      observer.observe(canvas());
      cleanups.push(() => observer.disconnect());
      listen(window, "resize", fitToCanvas);
      listen(root, "keyup", (event) => {
        if (event.key === " " && event.target.tagName === "BUTTON") event.preventDefault();
      });
      for (const name of definitions.keys()) mount(name);
      requestAnimationFrame(frame);
      send("page", { kind: "ready" });
    }
    window.pdOverlay = {
      project,
      ground,
      // The picture that was there when the former connection was lost, and since when
      // nothing was heard of this one.
      lostPicture: former?.picture ?? null,
      heardAt: () => heardAt,
      define: (name, factory) => definitions.set(name, factory),
      setStyle: (text) => {
        style.textContent = text;
      },
      start(uuid) {
        answerUuid = uuid;
        start();
      },
      update(name, state) {
        heardAt = Date.now();
        const update = mounted.get(name);
        if (update) update(state);
        else waiting.set(name, state);
      },
      dispose() {
        isAlive = false;
        for (const cleanup of cleanups) cleanup();
        root.remove();
        style.remove();
      }
    };
  })();

  // src/elements/order.js
  pdOverlay.define("order", (api) => {
    const ARMING = ["bar", "banner-bar", "menu-list", "guidance-tools"].map((name) => `.pd-${name} button`).join();
    const TYPES = ["pointerdown", "pointermove", "pointerup", "pointercancel", "click"];
    let state = { keys: [], labels: [], answered: 0 };
    let asked = 0;
    let press = null;
    function ask() {
      asked += 1;
      setTimeout(() => api.send({ number: asked }));
    }
    const isAwaited = () => state.answered < asked;
    function goOn() {
      if (!press || isAwaited()) return;
      press.target ??= document.elementFromPoint(press.x, press.y) ?? api.canvas();
      for (const event of press.events.splice(0))
        press.target.dispatchEvent(new event.constructor(event.type, event));
      if (press.isOver) press = null;
    }
    function hear(event) {
      if (!event.isTrusted) return;
      if (!press) {
        if (event.type !== "pointerdown" || event.button !== 0 || !isAwaited()) return;
        if (!api.isOnPicture(event) || api.isPanPress()) return;
        press = { x: event.clientX, y: event.clientY, events: [], isOver: false };
      }
      api.take(event);
      press.events.push(event);
      if (event.type === "pointerup" || event.type === "pointercancel")
        setTimeout(() => {
          press.isOver = true;
          goOn();
        });
      goOn();
    }
    for (const type of TYPES) api.listen(window, type, hear, { capture: true });
    api.listen(window, "keydown", (event) => {
      if (event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.target?.closest?.("input, textarea, select, [contenteditable]")) return;
      if (state.keys.includes(event.key.toUpperCase())) ask();
    }, { capture: true });
    api.listen(window, "click", (event) => {
      const button = event.target?.closest?.("button");
      if (button?.matches(ARMING) || state.labels.includes(button?.textContent.trim())) ask();
    }, { capture: true });
    return (next) => {
      state = next;
      goOn();
    };
  });

  // src/elements/agents.js
  (() => {
    const ROW_PX = 24;
    const MARKS = [
      [1, "F", "focal agent", "pd-focal"],
      [2, "E", "ego", "pd-ego"],
      [64, "!", "has a problem", "pd-bad"],
      [256, "", "locked", "pd-locked"],
      [128, "~", "trajectory no longer fits", "pd-warn"],
      [4, "N", "new", "pd-new"],
      [8, "e", "edited", "pd-edited"],
      [16, "L", "comes later than t = 0", "pd-later"],
      [32, "G", "is gone by t = 0", "pd-later"]
    ];
    const NEW = 4;
    const MAIN = 3;
    const SHAPES = {
      vehicle: "box",
      bus: "long",
      pedestrian: "dot",
      cyclist: "peak",
      motorcyclist: "peak"
    };
    let number = 0;
    let rows = [];
    let kinds = [];
    let shown = [];
    let selected = /* @__PURE__ */ new Set();
    let underPointer = null;
    let redraw = () => {
    };
    let reveal = () => {
    };
    pdOverlay.define("agents", (api) => {
      const { make } = api;
      const drawer = make("div", "pd-solid pd-agents", {
        role: "region",
        "aria-label": "Agent list"
      });
      drawer.hidden = true;
      const search = make("input", "pd-search", {
        type: "search",
        placeholder: "Search by id, kind, focal, ego",
        "aria-label": "Search agents",
        spellcheck: "false",
        autocomplete: "off"
      });
      const close = make("button", "pd-close", {
        type: "button",
        "aria-label": "Close the agent list",
        title: "Close (Ctrl+F)"
      }, "×");
      const head = make("div", "pd-agents-head");
      head.append(search, close);
      const filters = make("div", "pd-agents-filters");
      const filter = { moving: false, new: false, kind: -1 };
      for (const [key, text, title] of [
        ["moving", "Moving", "Only agents that move at t = 0"],
        ["new", "New", "Only agents that the recording does not have"]
      ]) {
        const button = make(
          "button",
          "",
          { type: "button", "aria-pressed": "false", title },
          text
        );
        button.addEventListener("click", () => {
          filter[key] = !filter[key];
          button.setAttribute("aria-pressed", String(filter[key]));
          arrange();
        });
        filters.append(button);
      }
      const kindBox = make("select", "", { "aria-label": "Kind" });
      kindBox.addEventListener("change", () => {
        filter.kind = Number(kindBox.value);
        arrange();
      });
      filters.append(kindBox);
      const sort = { column: -1, isDown: false };
      const columns = make("div", "pd-agents-columns");
      const headings = [
        ["Agent", "Sort by id", 0],
        ["m/s", "Sort by speed at t = 0", 2],
        ["m", "Sort by distance to the focal agent", 3],
        ["Marks", "Sort by marks", 4]
      ].map(([text, title, column]) => {
        const button = make("button", "", { type: "button", title, "aria-label": title }, text);
        button.addEventListener("click", () => {
          if (sort.column !== column) Object.assign(sort, { column, isDown: false });
          else if (!sort.isDown) sort.isDown = true;
          else Object.assign(sort, { column: -1, isDown: false });
          for (const [other, element] of headings)
            element.textContent = element.dataset.text + (other === sort.column ? sort.isDown ? " ▾" : " ▴" : "");
          arrange();
        });
        button.dataset.text = text;
        columns.append(button);
        return [column, button];
      });
      const list = make("div", "pd-agents-list", {
        role: "listbox",
        "aria-label": "Agents",
        "aria-multiselectable": "true",
        tabindex: "0"
      });
      const space = make("div", "pd-agents-space");
      list.append(space);
      const count = make("div", "pd-agents-count", { role: "status" });
      const foot = make("div", "pd-agents-foot");
      for (const [text, title, wanted] of [
        ["All", "Select all agents of the list", () => [...shown]],
        ["None", "Select none", () => []],
        [
          "Invert",
          "Select the agents of the list that are not selected",
          () => shown.filter((row) => !selected.has(row))
        ],
        ["Same kind", "Add all agents of the kinds that are selected", () => {
          const wantedKinds = new Set([...selected].map((row) => rows[row][1]));
          return rows.map((_, row) => row).filter((row) => wantedKinds.has(rows[row][1]));
        }]
      ]) {
        const button = make("button", "", { type: "button", title }, text);
        button.addEventListener("click", () => choose(wanted()));
        foot.append(button);
      }
      const lock = make("button", "", {
        type: "button",
        title: "Lock or unlock the selected agents (K)"
      }, "Lock");
      lock.addEventListener("click", () => api.send({ kind: "lock", number }));
      foot.append(lock);
      drawer.append(head, filters, columns, list, count, foot);
      api.box.append(drawer);
      function choose(wanted) {
        api.send({ kind: "select", number, rows: wanted });
      }
      let anchor = null;
      let cursor = null;
      function pick(row, event) {
        const place = shown.indexOf(row);
        const from = anchor === null ? -1 : shown.indexOf(anchor);
        if (event.shiftKey && from >= 0) {
          const range = shown.slice(Math.min(from, place), Math.max(from, place) + 1);
          choose(event.ctrlKey || event.metaKey ? [.../* @__PURE__ */ new Set([...selected, ...range])] : range);
        } else if (event.ctrlKey || event.metaKey) {
          anchor = row;
          choose(selected.has(row) ? [...selected].filter((one) => one !== row) : [...selected, row]);
        } else {
          anchor = row;
          choose([row]);
        }
        cursor = row;
      }
      let pointed = null;
      function point(row) {
        if (row === pointed) return;
        pointed = row;
        api.send({ kind: "point", number, row });
      }
      const pool = /* @__PURE__ */ new Map();
      function rowElement(row) {
        const [id, kind, speed, distance, marks] = rows[row];
        const element = make("div", "pd-agents-row", { role: "option" });
        const glyph = make("span", `pd-glyph pd-${SHAPES[kinds[kind][0]] ?? "thing"}`, {
          title: kinds[kind][0]
        });
        const color = marks & 1 ? kinds.focal : marks & 2 ? kinds.ego : kinds[kind][1];
        glyph.style.background = color;
        const name = make("span", "pd-name", { title: `${kinds[kind][0]} ${id}` }, id);
        const numbers = [speed, distance].map((value) => make("span", "pd-number", {}, value === null ? "–" : value.toFixed(1)));
        const badges = make("span", "pd-badges");
        const words = [];
        for (const [bit, letter, word, style] of MARKS)
          if (marks & bit) {
            badges.append(make("span", `pd-badge ${style}`, { title: word }, letter));
            words.push(word);
          }
        element.setAttribute("aria-label", [`${kinds[kind][0]} ${id}`, ...words].join(", "));
        element.append(glyph, name, ...numbers, badges);
        element.addEventListener("click", (event) => pick(row, event));
        element.addEventListener("pointerenter", () => point(row));
        return element;
      }
      redraw = () => {
        if (drawer.hidden) return;
        const first = Math.max(0, Math.floor(list.scrollTop / ROW_PX) - 4);
        const last = Math.min(
          shown.length,
          Math.ceil((list.scrollTop + list.clientHeight) / ROW_PX) + 4
        );
        const wanted = new Set(shown.slice(first, last));
        for (const [row, element] of pool)
          if (!wanted.has(row)) {
            element.remove();
            pool.delete(row);
          }
        for (let place = first; place < last; place += 1) {
          const row = shown[place];
          let element = pool.get(row);
          if (!element) {
            element = rowElement(row);
            pool.set(row, element);
            space.append(element);
          }
          element.style.top = `${place * ROW_PX}px`;
          element.setAttribute("aria-selected", String(selected.has(row)));
          element.classList.toggle("pd-lit", rows[row][0] === underPointer);
          element.setAttribute("aria-posinset", String(place + 1));
          element.setAttribute("aria-setsize", String(shown.length));
        }
        count.textContent = `${shown.length} of ${rows.length} listed, ${selected.size} selected`;
      };
      function arrange() {
        const words = search.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
        shown = [];
        rows.forEach(([id, kind, , , marks, isMoving], row) => {
          const main = MARKS.filter(([bit]) => marks & bit & MAIN).map(([, , word]) => word);
          const text = [kinds[kind][0], id, ...main].join(" ").toLowerCase();
          if (words.every((word) => text.includes(word)) && (!filter.moving || isMoving) && (!filter.new || marks & NEW) && (filter.kind < 0 || filter.kind === kind))
            shown.push(row);
        });
        if (sort.column >= 0) {
          const sign = sort.isDown ? -1 : 1;
          const compare = sort.column === 0 ? (a, b) => a[0].localeCompare(b[0], void 0, { numeric: true }) : sort.column === 4 ? (a, b) => b[4] - a[4] : (a, b) => (a[sort.column] ?? Infinity) - (b[sort.column] ?? Infinity);
          shown.sort((a, b) => sign * compare(rows[a], rows[b]) || a - b);
        }
        for (const element of pool.values()) element.remove();
        pool.clear();
        space.style.height = `${shown.length * ROW_PX}px`;
        redraw();
      }
      reveal = () => {
        bringIntoSight([...selected]);
      };
      function bringIntoSight(wanted) {
        const places = wanted.map((row) => shown.indexOf(row)).filter((p) => p >= 0);
        const top = list.scrollTop;
        const bottom = top + list.clientHeight - ROW_PX;
        if (!places.length || places.some((p) => p * ROW_PX >= top && p * ROW_PX <= bottom))
          return;
        list.scrollTop = places[0] * ROW_PX - list.clientHeight / 2;
      }
      api.listen(window, "pd-agent-under-pointer", (event) => {
        underPointer = event.detail;
        if (drawer.hidden) return;
        const row = rows.findIndex(([id]) => id === underPointer);
        if (row >= 0) bringIntoSight([row]);
        redraw();
      });
      list.addEventListener("scroll", redraw);
      list.addEventListener("pointerleave", () => point(null));
      list.addEventListener("keydown", (event) => {
        const pageful = Math.max(1, Math.floor(list.clientHeight / ROW_PX) - 1);
        const by = {
          ArrowDown: 1,
          ArrowUp: -1,
          PageDown: pageful,
          PageUp: -pageful,
          Home: -Infinity,
          End: Infinity
        }[event.key];
        if (!by || !shown.length) return;
        event.preventDefault();
        event.stopPropagation();
        const place = cursor === null ? -1 : shown.indexOf(cursor);
        const next = shown[Math.min(Math.max(place + by, 0), shown.length - 1)];
        pick(next, event);
        const y = shown.indexOf(next) * ROW_PX;
        if (y < list.scrollTop) list.scrollTop = y;
        if (y + ROW_PX > list.scrollTop + list.clientHeight)
          list.scrollTop = y + ROW_PX - list.clientHeight;
      });
      search.addEventListener("input", arrange);
      search.addEventListener("keydown", (event) => {
        event.stopPropagation();
        if (event.key === "ArrowDown") list.focus();
        if (event.key === "Enter" && shown.length) choose([...shown]);
        if (event.key === "Escape") {
          if (search.value) {
            search.value = "";
            arrange();
          } else api.send({ kind: "close" });
        }
      });
      close.addEventListener("click", () => api.send({ kind: "close" }));
      api.listen(document, "keydown", (event) => {
        if ((event.ctrlKey || event.metaKey) && !event.shiftKey && !event.altKey && event.key.toLowerCase() === "f") {
          event.preventDefault();
          if (/^(INPUT|TEXTAREA)$/.test(event.target?.tagName ?? ""))
            api.send({ kind: event.target === search ? "close" : "open" });
        }
      }, true);
      return (state) => {
        const wasHidden = drawer.hidden;
        drawer.hidden = !state.isOpen;
        if (!state.isOpen) {
          if (!wasHidden && drawer.contains(document.activeElement))
            document.activeElement.blur();
          return;
        }
        number = state.number;
        rows = state.rows;
        kinds = Object.assign(state.kinds, { focal: state.focal, ego: state.ego });
        kindBox.replaceChildren(
          make("option", "", { value: "-1" }, "All kinds"),
          ...kinds.map(([name], kind) => make("option", "", { value: String(kind) }, name))
        );
        if (filter.kind >= kinds.length) filter.kind = -1;
        kindBox.value = String(filter.kind);
        selected = new Set([...selected].filter((row) => row < rows.length));
        arrange();
        if (wasHidden) {
          search.focus();
          reveal();
        }
      };
    });
    pdOverlay.define("agent-selection", () => (state) => {
      selected = new Set(state.rows);
      redraw();
      reveal();
    });
  })();

  // src/elements/banner.js
  pdOverlay.define("banner", (api) => {
    const bar = api.make("div", "pd-solid pd-banner-bar", {
      role: "status",
      "aria-live": "polite",
      "aria-label": "Mode"
    });
    const words = api.make("span", "pd-banner-text");
    const button = api.make("button", "", { type: "button" });
    bar.append(words, button);
    api.box.append(bar);
    bar.hidden = true;
    let owner = null;
    button.addEventListener("click", () => api.send({ kind: "press", owner }));
    return (state) => {
      owner = state.owner;
      bar.hidden = owner === null;
      words.textContent = state.text;
      button.hidden = state.button === null;
      button.textContent = state.button ?? "";
    };
  });

  // src/elements/compare.js
  pdOverlay.define("compare", (api) => {
    const plate = api.make("div", "pd-solid pd-compare", { role: "status" });
    plate.hidden = true;
    api.box.append(plate);
    let isHeld = false;
    function hold(isDown) {
      if (isHeld === isDown) return;
      isHeld = isDown;
      api.send({ kind: isDown ? "hold" : "release" });
    }
    const isTyping = (target) => target?.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(target?.tagName ?? "");
    api.listen(document, "keydown", (event) => {
      if (event.code !== "KeyO" || event.repeat || isTyping(event.target)) return;
      if (event.ctrlKey || event.metaKey || event.altKey || event.shiftKey) return;
      hold(true);
    });
    api.listen(document, "keyup", (event) => {
      if (event.code === "KeyO") hold(false);
    });
    api.listen(window, "blur", () => hold(false));
    return ({ text }) => {
      plate.hidden = !text;
      plate.textContent = text;
    };
  });

  // src/elements/compass.js
  pdOverlay.define("compass", (api) => {
    const LONGEST_PX = 120;
    const STEEP_ENOUGH = 0.2;
    const compass = api.make("button", "pd-solid pd-compass", { type: "button" });
    const dial = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    dial.setAttribute("viewBox", "0 0 40 40");
    dial.setAttribute("aria-hidden", "true");
    const shape = (tag, attributes, text = "") => {
      const part = document.createElementNS(dial.namespaceURI, tag);
      for (const [name, value] of Object.entries(attributes))
        part.setAttribute(name, value);
      part.textContent = text;
      dial.append(part);
    };
    shape("path", { d: "M20 12.5 24.2 23 20 20.8 15.8 23z", class: "pd-north" });
    shape("path", { d: "M20 35 24.2 24.6 20 22.6 15.8 24.6z", class: "pd-south" });
    shape("text", { x: 20, y: 10.5, "text-anchor": "middle" }, "N");
    compass.append(dial);
    const scale = api.make("div", "pd-scalebar", { role: "img" });
    const bar = api.make("div", "pd-scalebar-line");
    const words = api.make("div");
    scale.append(bar, words);
    api.box.append(compass, scale);
    compass.addEventListener("click", () => api.send({ kind: "turn" }));
    let state = { isTop: false, isHeadingUp: false };
    function roundLength(most) {
      const power = 10 ** Math.floor(Math.log10(most));
      return [5, 2, 1].find((digit) => digit * power <= most) * power;
    }
    function draw() {
      const canvas = api.canvas();
      if (!canvas) return;
      const x = canvas.clientWidth / 2;
      const y = canvas.clientHeight / 2;
      const left = api.ground(x - 20, y);
      const right = api.ground(x + 20, y);
      const middle = api.ground(x, y);
      const isSeen = left && right && middle;
      compass.classList.toggle("pd-gone", !isSeen);
      scale.classList.toggle("pd-gone", !isSeen || elevation(middle) < STEEP_ENOUGH);
      if (!isSeen) return;
      const across = [right[0] - left[0], right[1] - left[1]];
      dial.style.transform = `rotate(${Math.atan2(across[1], across[0])}rad)`;
      const metresPerPixel = Math.hypot(...across) / 40;
      const length = roundLength(LONGEST_PX * metresPerPixel);
      bar.style.width = `${length / metresPerPixel}px`;
      const text = length >= 1e3 ? `${length / 1e3} km` : `${length} m`;
      words.textContent = state.isTop ? text : `${text} at the centre`;
      scale.setAttribute("aria-label", `Scale: ${words.textContent}`);
    }
    function elevation(middle) {
      const node = api.viewer().nodeRefFromName[""];
      const eye = node.worldToLocal(api.viewer().camera.position.clone());
      return eye.z / Math.hypot(eye.x - middle[0], eye.y - middle[1], eye.z);
    }
    api.onView(draw);
    return (next) => {
      state = next;
      const hint = !state.isTop ? "Compass: turn the view north" : state.isHeadingUp ? "Compass: focal agent's heading is up. Click for north up" : "Compass: north is up. Click for the focal agent's heading up";
      compass.setAttribute("aria-label", hint);
      compass.dataset.hint = hint;
      draw();
    };
  });

  // src/elements/connection.js
  pdOverlay.define("connection", (api) => {
    const TOLD_MS = 6e3;
    const ASKS_MS = 2e3;
    const FORBIDDEN = 403;
    const bar = api.make("div", "pd-solid pd-banner-bar pd-connection-bar", { role: "alert" });
    const words = api.make("span", "pd-banner-text");
    bar.append(words);
    bar.hidden = true;
    api.box.append(bar);
    const { sendMessage } = api.viewer() ?? {};
    async function ask(saved) {
      const request = new AbortController();
      api.onDispose(() => request.abort());
      const answer = await fetch(location.href, { cache: "no-store", signal: request.signal }).catch(() => null);
      request.abort();
      if (answer?.status === FORBIDDEN) {
        words.textContent = `The editor was started anew, with another address: open the one that it printed. ${saved}`;
      } else setTimeout(() => {
        if (pdOverlay.picture) ask(saved);
      }, ASKS_MS);
    }
    function lose() {
      const time = new Date(pdOverlay.heardAt()).toLocaleTimeString();
      const isUnsaved = api.root.querySelector(".pd-unsaved:not([hidden])");
      const saved = isUnsaved ? "The newest edits are not saved." : `Edits up to ${time} are saved.`;
      words.textContent = `Connection lost. ${saved} Reconnecting …`;
      bar.classList.remove("pd-good");
      bar.hidden = false;
      api.root.classList.add("pd-lost");
      const picture = api.make("canvas", "pd-still");
      const { width, height } = api.canvas();
      Object.assign(picture, { width, height }).getContext("2d").drawImage(api.canvas(), 0, 0);
      picture.style.cssText = `width:${api.canvas().clientWidth}px;height:${api.canvas().clientHeight}px`;
      api.box.prepend(picture);
      pdOverlay.picture = picture;
      ask(saved);
    }
    const watch = setInterval(() => {
      if (api.viewer()?.sendMessage !== sendMessage && !pdOverlay.picture) lose();
    }, 250);
    api.onDispose(() => clearInterval(watch));
    return ({ isNew }) => {
      if (!pdOverlay.lostPicture) return;
      words.textContent = isNew ? "Connected to a server that was started anew. Your edits are under “Unfinished work”." : "Connected again. All edits are here.";
      bar.classList.add("pd-good");
      bar.hidden = false;
      setTimeout(() => {
        bar.hidden = bar.classList.contains("pd-good");
      }, TOLD_MS);
    };
  });

  // src/elements/curtain.js
  pdOverlay.define("curtain", (api) => {
    const LONGEST_MS = 2e3;
    const REST = { ms: 120, frames: 3 };
    const NOTHING = { ms: 300, frames: 4 };
    const still = api.make("canvas", "pd-still pd-gone");
    api.box.append(still);
    let number = 0;
    function meshOf(name) {
      let found = "";
      api.viewer()?.nodeRefFromName?.[name]?.traverse?.((part) => {
        if (!found && part.isMesh) found = part.uuid;
      });
      return found;
    }
    if (pdOverlay.lostPicture) raise(pdOverlay.lostPicture);
    function raise(canvas) {
      if (!still.classList.contains("pd-gone")) return;
      still.width = canvas.width;
      still.height = canvas.height;
      still.getContext("2d").drawImage(canvas, 0, 0);
      still.classList.remove("pd-gone");
    }
    return ({ nodes }) => {
      number += 1;
      const canvas = number > 1 ? api.canvas() : pdOverlay.lostPicture;
      if (!canvas || document.hidden) {
        still.classList.add("pd-gone");
        return;
      }
      const mine = number;
      const start = performance.now();
      const former = nodes.map(meshOf);
      const changed = /* @__PURE__ */ new Set();
      let quietSince = start;
      let quietFrames = 0;
      raise(canvas);
      function look() {
        if (mine !== number) return;
        const now = performance.now();
        quietFrames += 1;
        nodes.forEach((name, index) => {
          const mesh = meshOf(name);
          if (changed.has(name) || !mesh || mesh === former[index]) return;
          changed.add(name);
          quietSince = now;
          quietFrames = 0;
        });
        const patience = changed.size > 0 ? REST : NOTHING;
        const isQuiet = now - quietSince > patience.ms && quietFrames > patience.frames && !api.viewer()?.messageQueue?.length;
        const isThere = changed.size === nodes.length || isQuiet;
        if (!isThere && now - start < LONGEST_MS) {
          requestAnimationFrame(look);
          return;
        }
        api.viewer()?.requestRender?.();
        requestAnimationFrame(() => requestAnimationFrame(() => {
          if (mine === number) still.classList.add("pd-gone");
        }));
      }
      requestAnimationFrame(look);
    };
  });

  // src/elements/fan.js
  pdOverlay.define("fan", (api) => {
    const PAUSE_MS = 80;
    let isShown = false;
    let at = null;
    let timer = null;
    function tell() {
      timer = null;
      if (isShown) api.send({ point: at && api.ground(...at) });
    }
    api.listen(window, "pointermove", (event) => {
      if (!isShown || event.buttons !== 0) return;
      at = api.isOnPicture(event) ? api.local(event) : null;
      timer ??= setTimeout(tell, PAUSE_MS);
    }, { capture: true, passive: true });
    return (state) => {
      isShown = state.isShown;
    };
  });

  // src/elements/guidance_marks.js
  pdOverlay.define("guidance_marks", (api) => {
    const { shape, plate, flag, along, head, bow } = pdOverlay.guidance;
    const STILL_PX = 4;
    const SEND_MS = 50;
    const SETTLE_MS = 700;
    const HELD_BACK_PX = 16;
    const COVERED_PX = { left: -20, right: 37, top: -48, bottom: 2 };
    const DRAGGED = ["flag", "line"];
    const layer = shape("svg", "pd-guide-marks");
    const tip = api.make("div", "pd-tip pd-guide-tip", { role: "tooltip" });
    tip.hidden = true;
    api.box.append(layer, tip);
    let state = { marks: [], agents: [], refusal: "" };
    let press = null;
    let settling = null;
    let sentAt = 0;
    let late = null;
    let pointed = null;
    const isMode = () => ["pd-crosshair", "pd-drawing-region", "pd-guiding"].some((name) => document.body.classList.contains(name));
    const held = () => press ?? settling;
    const taken = [];
    pdOverlay.taken = taken;
    const take = (left, top, right, bottom) => taken.push({ left, top, width: right - left, height: bottom - top });
    function isHeldBack(mark) {
      const hold = held();
      return Boolean(hold?.point) && (mark.index === hold.mark.index || !hold.known.has(mark.index)) && mark.shape !== "badges";
    }
    function group(mark) {
      const classes = ["pd-guide", `pd-guide-${mark.kind}`];
      if (!mark.isOn) classes.push("pd-guide-off");
      if (mark.isFaint) classes.push("pd-guide-faint");
      if (mark.isChosen) classes.push("pd-guide-chosen");
      if (mark.isOffer) classes.push("pd-guide-offer");
      if (DRAGGED.includes(mark.shape)) classes.push("pd-guide-drags");
      return shape("g", classes.join(" "), { "data-guide": mark.index });
    }
    function put(parent, picture, [x, y]) {
      picture.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      parent.append(picture);
    }
    function warn(parent, x, y) {
      const badge = shape("g", "pd-guide-warning");
      const text = shape("text", "", { "text-anchor": "middle", y: 4 });
      text.textContent = "!";
      badge.append(shape("circle", "", { r: 7 }), text);
      put(parent, badge, [x, y]);
    }
    const ground = (point) => api.project([point[0], point[1], 0]);
    function isCovered(x, y) {
      const { left, right, top, bottom } = COVERED_PX;
      return left < x && x < right && top < y && y < bottom;
    }
    function drawFlag(mark, parent) {
      const foot = ground(mark.point);
      if (!foot) return;
      const from = mark.from && api.project(mark.from);
      if (mark.isOffer && from && isCovered(from[0] - foot[0], from[1] - foot[1])) return;
      if (from && !mark.isFaint && !mark.isOffer)
        parent.append(shape("path", "pd-guide-leader", { d: along([from, foot]) }));
      put(parent, flag(mark.isOffer), foot);
      take(foot[0] - 9, foot[1] - 34, foot[0] + 24, foot[1] + 8);
      if (mark.isBad) warn(parent, foot[0] + 20, foot[1] - 31);
    }
    function halfWay(pixels) {
      const steps = pixels.slice(1).map((point, index2) => Math.hypot(point[0] - pixels[index2][0], point[1] - pixels[index2][1]));
      let rest = steps.reduce((sum, step) => sum + step, 0) / 2;
      const index = steps.findIndex((step) => (rest -= step) <= 0);
      if (index < 0) return pixels[0];
      const share = 1 + rest / (steps[index] || 1);
      return [0, 1].map((axis) => pixels[index][axis] + share * (pixels[index + 1][axis] - pixels[index][axis]));
    }
    function drawPath(mark, parent) {
      const pixels = mark.points.map(ground);
      const line = along(pixels);
      if (!line) return;
      for (const name of ["pd-guide-halo", "pd-guide-line"])
        parent.append(shape("path", name, { d: line }));
      parent.append(
        shape("path", "pd-guide-halo", { d: head(pixels) }),
        shape("path", "pd-guide-line", { d: head(pixels) })
      );
      const middle = halfWay(pixels.filter((point) => point));
      put(parent, plate(mark.kind), middle);
      if (mark.isBad) warn(parent, middle[0] + 10, middle[1] - 10);
    }
    function drawLine(mark, parent) {
      const pixels = mark.points.map(ground);
      if (pixels.some((point) => !point)) return;
      for (const name of ["pd-guide-hit-line", "pd-guide-halo", "pd-guide-line"])
        parent.append(shape("path", name, { d: along(pixels) }));
      const [xs, ys] = [0, 1].map((axis) => pixels.map((point) => point[axis]));
      take(Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys));
      const [first, last] = pixels;
      const length = Math.hypot(last[0] - first[0], last[1] - first[1]) || 1;
      const end2 = [0, 1].map((axis) => first[axis] - (last[axis] - first[axis]) / length * 15);
      put(parent, plate(mark.kind), end2);
      if (mark.isBad) warn(parent, end2[0] + 10, end2[1] - 10);
    }
    function drawArrow(mark, parent) {
      const [from, to] = [api.project(mark.from), api.project(mark.to)];
      if (!from || !to) return;
      const { points, middle } = bow(from, to);
      const far = (point, other) => Math.hypot(point[0] - other[0], point[1] - other[1]) > HELD_BACK_PX;
      const shown = points.filter((point) => far(point, from) && far(point, to));
      if (shown.length > 1) {
        for (const name of ["pd-guide-halo", "pd-guide-line"])
          parent.append(shape("path", name, { d: along(shown) }));
        parent.append(shape("path", "pd-guide-line pd-guide-head", { d: head(shown) }));
      }
      put(parent, plate(mark.kind), middle);
      if (mark.isBad) warn(parent, middle[0] + 10, middle[1] - 10);
    }
    function drawArc(mark, parent) {
      const [from, to] = [api.project(mark.from), api.project(mark.to)];
      if (!from || !to) return;
      parent.classList.add("pd-guide-arc");
      const { points } = bow(from, to);
      for (const name of ["pd-guide-hit-line", "pd-guide-line"])
        parent.append(shape("path", name, { d: along(points) }));
      parent.append(shape("path", "pd-guide-line", { d: head(points, 7) }));
      if (!mark.points) return;
      const way = mark.points.map(ground);
      for (const name of ["pd-guide-halo", "pd-guide-line"])
        parent.append(shape("path", name, { d: along(way) + head(way) }));
    }
    function drawBadges(mark) {
      const at = api.project(mark.at);
      if (!at) return;
      mark.badges.forEach((badge, place) => {
        const parent = group(badge);
        const x = at[0] + (place - (mark.badges.length - 1) / 2) * 23;
        put(parent, plate(badge.kind, 10), [x, at[1] + 30]);
        if (badge.isBad) warn(parent, x + 9, at[1] + 22);
        layer.append(parent);
      });
    }
    const drawings = { flag: drawFlag, path: drawPath, line: drawLine, arrow: drawArrow, arc: drawArc };
    function drawMark(mark) {
      if (mark.shape === "badges") {
        drawBadges(mark);
        return;
      }
      const parent = group(mark);
      drawings[mark.shape](mark, parent);
      layer.append(parent);
    }
    function draw() {
      layer.replaceChildren();
      taken.length = 0;
      for (const mark2 of state.marks) if (!isHeldBack(mark2)) drawMark(mark2);
      const hold = held();
      if (!hold?.point) return;
      const isRefused = state.refusal !== "";
      const mark = { ...hold.mark, isOffer: false, isFaint: false, isChosen: true };
      mark.isBad = isRefused;
      if (mark.shape === "flag") drawMark({ ...mark, point: hold.point });
      else drawMark(state.marks.find((one) => one.index === mark.index) ?? mark);
      if (isRefused) layer.lastElementChild.classList.add("pd-guide-refused");
    }
    function isOverAgent(at) {
      return state.agents.some(([x, y, z, radius]) => {
        const [middle, ...edges] = [[0, 0], [radius, 0], [0, radius]].map(([dx, dy]) => api.project([x + dx, y + dy, z]));
        const away = (edge, from) => edge ? Math.hypot(edge[0] - from[0], edge[1] - from[1]) : 0;
        return middle && away(middle, at) <= Math.max(HELD_BACK_PX, ...edges.map((edge) => away(edge, middle)));
      });
    }
    function markOf(target) {
      const found = target?.closest?.("[data-guide]");
      if (!found || !layer.contains(found)) return null;
      const index = Number(found.dataset.guide);
      return state.marks.flatMap((mark) => mark.badges ?? [mark]).find(
        (mark) => mark.index === index
      ) ?? null;
    }
    function tell(lines, at) {
      tip.hidden = !lines?.length;
      if (tip.hidden) return;
      tip.replaceChildren(...lines.map((line) => api.make("div", "", {}, line)));
      const { clientWidth } = api.canvas();
      const left = Math.min(at[0] + 14, clientWidth - tip.offsetWidth - 8);
      tip.style.left = `${Math.max(left, 8)}px`;
      tip.style.top = `${at[1] + 14}px`;
    }
    function send(kind, point) {
      clearTimeout(late);
      sentAt = performance.now();
      api.send({ kind, index: press.mark.index, point });
    }
    function sendDrag() {
      clearTimeout(late);
      const wait = sentAt + SEND_MS - performance.now();
      if (wait > 0) late = setTimeout(sendDrag, wait);
      else if (press?.point) send("drag", press.point);
    }
    function end() {
      clearTimeout(late);
      settling = press?.point ? press : null;
      press = null;
      document.body.classList.remove("pd-guide-dragging");
      const mine = settling;
      setTimeout(() => {
        if (settling !== mine) return;
        settling = null;
        draw();
      }, SETTLE_MS);
    }
    api.listen(window, "pointerdown", (event) => {
      tip.hidden = true;
      if (event.button !== 0 || isMode() || api.isPanPress()) return;
      const mark = markOf(event.target);
      if (!mark) return;
      api.take(event);
      const at = api.local(event);
      const foot = mark.shape === "flag" ? ground(mark.point) : at;
      press = {
        id: event.pointerId,
        mark,
        at,
        point: null,
        offset: [foot[0] - at[0], foot[1] - at[1]],
        known: new Set(state.marks.map((one) => one.index))
      };
      settling = null;
      send("grab");
    }, { capture: true });
    api.listen(window, "pointermove", (event) => {
      if (press && event.pointerId === press.id) {
        api.take(event);
        const at = api.local(event);
        const isStill = Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) <= STILL_PX;
        if (!press.point && (isStill || !DRAGGED.includes(press.mark.shape))) return;
        const point = api.ground(at[0] + press.offset[0], at[1] + press.offset[1]);
        if (!point) return;
        document.body.classList.add("pd-guide-dragging");
        press.point = point;
        press.pointer = at;
        sendDrag();
        draw();
        tell(state.refusal ? [state.refusal] : [], at);
        return;
      }
      if (event.buttons !== 0 || isMode()) {
        tip.hidden = true;
        return;
      }
      const isOver = isOverAgent(api.local(event));
      layer.classList.toggle("pd-guide-over-agent", isOver);
      const found = markOf(event.target);
      const mark = isOver && found?.shape === "arc" ? null : found;
      tell(mark?.lines, api.local(event));
      const index = mark?.shape === "arc" ? mark.index : null;
      if (index !== pointed) api.send({ kind: "point", index });
      pointed = index;
    }, { capture: true });
    function release() {
      send("drop", press.point ?? void 0);
      tip.hidden = true;
      end();
      draw();
    }
    function giveUp() {
      if (!press) return;
      send("cancel");
      press.point = null;
      tip.hidden = true;
      end();
      draw();
    }
    api.followPress({ held: () => press, release, giveUp });
    api.onView(draw);
    api.onDispose(() => document.body.classList.remove("pd-guide-dragging"));
    return (next) => {
      const wasRefused = state.refusal;
      state = next;
      if (!press) settling = null;
      document.body.classList.toggle(
        "pd-arcs",
        state.marks.some((mark) => mark.shape === "arc")
      );
      draw();
      if (press?.pointer && state.refusal !== wasRefused)
        tell(state.refusal ? [state.refusal] : [], press.pointer);
    };
  });

  // src/elements/guidance_panel.js
  pdOverlay.define("guidance_panel", (api) => {
    const { icon } = pdOverlay.guidance;
    const HOST = "[data-pd-host='guidance']";
    const box = api.make("div", "pd-hosted pd-guidance");
    const tools = api.make("div", "pd-guidance-tools", {
      role: "toolbar",
      "aria-label": "Add guidance"
    });
    const about = api.make("div", "pd-guidance-about");
    const ask = api.make("button", "pd-guidance-ask", { type: "button" });
    ask.addEventListener("click", () => send({ kind: "look" }));
    const possible = api.make("div", "pd-possible");
    possible.addEventListener("pointerleave", () => point(null));
    const list = api.make("ul", "pd-guidance-list", { "aria-label": "Guidance terms" });
    const foot = api.make("div", "pd-guidance-foot", { role: "status" });
    const run = api.make("button", "pd-guidance-run", { type: "button" });
    const runAll = api.make("button", "pd-guidance-all", {
      type: "button",
      title: "Regenerate the trajectories of all agents"
    });
    run.addEventListener("click", () => send({ kind: "run", isAll: false }));
    runAll.addEventListener("click", () => send({ kind: "run", isAll: true }));
    const runs = api.make("div", "pd-guidance-runs");
    runs.append(run, runAll);
    box.append(about, tools, ask, possible, runs, foot, list);
    let state = {
      tools: [],
      encounters: { items: [] },
      rows: [],
      weights: [],
      report: [],
      figures: [],
      answered: 0
    };
    let version = null;
    let count = 0;
    const rows = /* @__PURE__ */ new Map();
    function attach() {
      const host = document.querySelector(HOST);
      if (host && box.parentElement !== host) host.replaceChildren(box);
    }
    const observer = new MutationObserver(attach);
    observer.observe(document.body, { subtree: true, childList: true });
    api.onDispose(() => {
      observer.disconnect();
      box.remove();
    });
    function send(event) {
      count += 1;
      api.send({ ...event, version, count });
      return count;
    }
    function point(number2) {
      if (state.encounters.items.findIndex((one) => one.isPointed) !== (number2 ?? -1))
        send({ kind: "point", number: number2 });
    }
    api.listen(window, "click", ({ target }) => {
      const tab = target.closest?.("[role=tab]");
      if (tab && tab.textContent.trim() !== "Guide" && state.encounters.isOpen)
        send({ kind: "leave" });
    });
    function showPossible() {
      const { label, isEnabled, isOpen, about: told, items } = state.encounters;
      ask.textContent = label;
      ask.disabled = !isEnabled;
      ask.setAttribute("aria-expanded", String(isOpen));
      possible.hidden = !told;
      const make = JSON.stringify([told, items.map(({ agent, text }) => [agent, text])]);
      if (make !== possible.dataset.make) {
        possible.dataset.make = make;
        possible.replaceChildren(
          api.make("div", "pd-guidance-about", { role: "status" }, told)
        );
        possible.append(...items.map((item, number2) => {
          const line = api.make("button", `pd-possible-line pd-guide-${item.kind}`, {
            type: "button"
          });
          line.append(
            icon(item.kind, 15),
            api.make("b", "", {}, item.agent),
            api.make("span", "", {}, item.text)
          );
          for (const name of ["pointerenter", "focus"])
            line.addEventListener(name, () => point(number2));
          line.addEventListener("click", () => send({ kind: "make", number: number2 }));
          return line;
        }));
      }
      for (const [number2, item] of items.entries()) {
        const line = possible.children[number2 + 1];
        line.setAttribute("aria-pressed", String(item.isMade));
        line.classList.toggle("pd-possible-pointed", item.isPointed);
      }
    }
    function control(field, row, show, give) {
      let shown = row;
      let awaited = 0;
      const follow = (next) => {
        shown = next;
        if (awaited <= state.answered) show(next);
      };
      field.addEventListener("input", () => {
        awaited = Infinity;
      });
      field.addEventListener("change", () => {
        awaited = give();
      });
      field.addEventListener("blur", () => {
        if (awaited < Infinity) return;
        awaited = 0;
        show(shown);
      });
      show(row);
      return follow;
    }
    function setText(field, text) {
      if (field.value !== text || field.validity.badInput) field.value = text;
    }
    function showTools() {
      tools.replaceChildren(...state.tools.map((tool) => {
        const button = api.make("button", "pd-guidance-tool", {
          type: "button",
          title: tool.hint,
          "aria-label": tool.title,
          "aria-pressed": String(tool.isActive),
          "aria-disabled": String(!tool.isEnabled)
        });
        button.append(icon(tool.kind), api.make("span", "", {}, tool.title));
        button.addEventListener("click", () => send({ kind: "tool", tool: tool.kind }));
        return button;
      }));
    }
    function number(row, place) {
      const input = row.inputs[place];
      const field = api.make("input", "", {
        type: "number",
        min: input.least,
        max: input.most,
        step: input.step,
        "aria-label": `${input.label} of ${row.name}`,
        placeholder: input.empty
      });
      return [field, control(
        field,
        row,
        (next) => setText(field, String(next.inputs[place].value ?? "")),
        () => {
          const value = field.value === "" ? null : Number(field.value);
          return send({ kind: "input", index: row.index, name: input.name, value });
        }
      )];
    }
    function choice(row, place) {
      const input = row.inputs[place];
      const field = api.make("select", "", { "aria-label": `${input.label} of ${row.name}` });
      for (const option of input.options)
        field.append(api.make("option", "", { value: option }, option));
      return [field, control(
        field,
        row,
        (next) => {
          const { value, notes } = next.inputs[place];
          for (const option of field.options) {
            const [few, sentence] = notes[option.value] ?? ["", ""];
            option.textContent = few ? `${option.value} – ${few}` : option.value;
            option.title = sentence;
          }
          field.value = value;
        },
        () => send({
          kind: "input",
          index: row.index,
          name: input.name,
          value: field.value
        })
      )];
    }
    function inputs(row, controls) {
      const line = api.make("div", "pd-guidance-inputs");
      for (const [place, input] of row.inputs.entries()) {
        const label = api.make("label", "", {}, input.label);
        const [field, follow] = (input.options.length ? choice : number)(row, place);
        controls.push(follow);
        label.append(field);
        if (input.unit) label.append(api.make("span", "", {}, input.unit));
        line.append(label);
      }
      return line;
    }
    function strength(row, controls) {
      const label = api.make("label", "pd-guidance-strength", {}, "Strength");
      const slider = api.make("input", "", {
        type: "range",
        min: 0,
        max: state.weights.length - 1,
        step: 1,
        "aria-label": `Strength of ${row.name}`
      });
      const told = api.make("output", "");
      const tell = () => {
        told.textContent = `×${state.weights[slider.value]}`;
      };
      const weigh = (isEnd) => send({ kind: "weight", index: row.index, stop: Number(slider.value), isEnd });
      slider.addEventListener("input", () => {
        tell();
        weigh(false);
      });
      controls.push(control(
        slider,
        row,
        (next) => {
          slider.value = next.stop;
          tell();
        },
        () => weigh(true)
      ));
      label.append(slider, told);
      return label;
    }
    function build(row) {
      const controls = [];
      const item = api.make("li", "pd-guidance-row", { "aria-label": row.name });
      const head = api.make("div", "pd-guidance-head");
      const choose = api.make("button", "pd-guidance-title", {
        type: "button",
        title: `Select ${row.agents}`
      });
      const words = api.make("span", "pd-guidance-words");
      words.append(
        api.make("b", "", {}, row.title),
        api.make("span", "", {}, row.agents)
      );
      choose.append(icon(row.kind), words);
      choose.addEventListener("click", () => send({ kind: "choose", index: row.index }));
      const isOn = api.make("input", "", {
        type: "checkbox",
        role: "switch",
        title: "On or off",
        "aria-label": `${row.name} is on`
      });
      controls.push(control(
        isOn,
        row,
        (next) => {
          isOn.checked = next.isOn;
        },
        () => send({ kind: "switch", index: row.index, isOn: isOn.checked })
      ));
      const remove = api.make("button", "pd-guidance-remove", {
        type: "button",
        title: "Delete",
        "aria-label": `Delete ${row.name}`
      }, "×");
      remove.addEventListener("click", () => send({ kind: "remove", index: row.index }));
      head.append(choose, isOn, remove);
      item.append(
        head,
        inputs(row, controls),
        strength(row, controls),
        api.make("div", "pd-guidance-notes")
      );
      return { item, controls };
    }
    function showNotes(item, row) {
      const notes = item.querySelector(".pd-guidance-notes");
      notes.replaceChildren(...row.notes.map(({ tone, text }) => api.make("div", `pd-guidance-note pd-tone-${tone}`, {}, text)));
    }
    function makeOf(row) {
      const { notes, isChosen, isOn, stop, ...made } = row;
      const inputs2 = row.inputs.map(({ value, notes: notes2, ...input }) => input);
      return JSON.stringify({ ...made, inputs: inputs2 });
    }
    function showRows() {
      const former = new Map(rows);
      rows.clear();
      const items = state.rows.map((row) => {
        const make = makeOf(row);
        const known = former.get(row.index);
        const { item, controls } = known?.make === make ? known : build(row);
        rows.set(row.index, { make, item, controls });
        for (const follow of controls) follow(row);
        item.classList.toggle("pd-guidance-off", !row.isOn);
        item.classList.toggle("pd-guidance-chosen", row.isChosen);
        showNotes(item, row);
        return item;
      });
      if (items.length !== list.children.length || items.some((item, place) => list.children[place] !== item)) {
        const focus = document.activeElement?.getAttribute?.("aria-label");
        list.replaceChildren(...items);
        if (focus && !list.contains(document.activeElement))
          [...list.querySelectorAll("[aria-label]")].find(
            (one) => one.getAttribute("aria-label") === focus
          )?.focus();
      }
    }
    function figures() {
      const table = api.make("table", "", { "aria-label": "Realism of the last run" });
      for (const [place, [name, guided, unguided, title]] of state.figures.entries()) {
        const line = api.make("tr", "", { title });
        for (const cell of [name, guided, unguided])
          line.append(api.make(place ? "td" : "th", "", {}, cell));
        table.append(line);
      }
      return table;
    }
    function showFoot() {
      foot.replaceChildren(...state.report.map(({ tone, text }) => api.make("div", `pd-guidance-note pd-tone-${tone}`, {}, text)));
      if (state.figures.length) foot.append(figures());
      foot.hidden = !state.report.length && !state.action;
      if (!state.action) return;
      const button = api.make("button", "pd-guidance-take", { type: "button" }, state.action);
      button.addEventListener("click", () => send({ kind: "take" }));
      foot.append(button);
    }
    return (next) => {
      state = next;
      version = next.version;
      attach();
      about.textContent = state.about;
      run.textContent = state.run.label;
      run.title = state.run.label;
      runAll.textContent = state.run.all;
      runAll.hidden = !state.run.all;
      run.disabled = runAll.disabled = !state.run.isEnabled;
      showTools();
      showPossible();
      showRows();
      showFoot();
      list.querySelector(".pd-guidance-chosen")?.scrollIntoView?.({ block: "nearest" });
    };
  });

  // src/elements/guidance_shapes.js
  pdOverlay.guidance = /* @__PURE__ */ (() => {
    const NAMESPACE = "http://www.w3.org/2000/svg";
    function shape(tag, name, attributes = {}) {
      const element = document.createElementNS(NAMESPACE, tag);
      if (name) element.setAttribute("class", name);
      for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
      return element;
    }
    function icon(kind, size = 18) {
      const svg = shape("svg", "pd-guide-icon", {
        viewBox: "0 0 20 20",
        width: size,
        height: size,
        "aria-hidden": "true"
      });
      svg.append(shape("path", "", { d: pdOverlay.guidanceIcons[kind] }));
      return svg;
    }
    function plate(kind, radius = 11) {
      const group = shape("g", "pd-guide-plate");
      const inner = shape("g", "", { transform: `translate(-8 -8) scale(0.8)` });
      inner.append(shape("path", "", { d: pdOverlay.guidanceIcons[kind] }));
      group.append(shape("circle", "", { r: radius }), inner);
      return group;
    }
    function flag(isOffer = false) {
      const group = shape("g", "pd-guide-flag");
      const cloth = "M0 -29H19L14 -22.5L19 -16H0z";
      group.append(
        shape("path", "pd-guide-hit", {
          d: isOffer ? "M-6 -34H23V-12H8V6H-8V-12H-6z" : "M-9 -34H24V8H-9z"
        }),
        shape("ellipse", "pd-guide-foot", { rx: 6, ry: 3.4 }),
        shape("path", "pd-guide-halo", { d: `M0 0V-29${cloth}` }),
        shape("path", "pd-guide-cloth", { d: cloth }),
        shape("path", "pd-guide-pole", { d: "M0 0V-30" })
      );
      return group;
    }
    const isSeen = (point) => point !== null;
    const at = (point) => point.map((value) => value.toFixed(1)).join(" ");
    function along(pixels) {
      let path = "";
      pixels.forEach((point, index) => {
        if (!isSeen(point)) return;
        path += `${index && isSeen(pixels[index - 1]) ? "L" : "M"}${at(point)}`;
      });
      return path;
    }
    function head(pixels, size = 9) {
      const seen = pixels.filter(isSeen);
      const tip = seen.at(-1);
      const before = seen.findLast(
        (point) => Math.hypot(tip[0] - point[0], tip[1] - point[1]) > 3
      );
      if (!before) return "";
      const angle = Math.atan2(tip[1] - before[1], tip[0] - before[0]);
      const side = (turn) => [
        tip[0] - size * Math.cos(angle + turn),
        tip[1] - size * Math.sin(angle + turn)
      ];
      return `M${at(side(0.5))}L${at(tip)}L${at(side(-0.5))}`;
    }
    function bow(from, to) {
      const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
      const rise = Math.min(0.22 * Math.hypot(dx, dy), 60);
      const length = Math.hypot(dx, dy) || 1;
      const lift = [-dy / length * rise, dx / length * rise];
      const sign = lift[1] > 0 ? -1 : 1;
      const knee = [0, 1].map((axis) => (from[axis] + to[axis]) / 2 + sign * lift[axis]);
      const points = Array.from({ length: 21 }, (_, step) => {
        const t = step / 20;
        return [0, 1].map((axis) => (1 - t) ** 2 * from[axis] + 2 * t * (1 - t) * knee[axis] + t * t * to[axis]);
      });
      return { points, middle: points[10] };
    }
    return { shape, icon, plate, flag, along, head, bow };
  })();

  // src/elements/guiding.js
  pdOverlay.define("guiding", (api) => {
    const { shape, flag, along, head, bow } = pdOverlay.guidance;
    const ASK_MS = 60;
    const APART_PX = 2;
    const SAME_PX = 8;
    const MAX_POINTS = 1500;
    const layer = shape("svg", "pd-guide-marks pd-guide-drawing");
    const tip = api.make("div", "pd-tip pd-guide-tip", { role: "tooltip" });
    tip.hidden = true;
    api.box.append(layer, tip);
    let state = { isActive: false };
    let at = null;
    let press = null;
    let line = [];
    let askedAt = 0;
    let late = null;
    const ground = (point) => api.project([point[0], point[1], 0]);
    function stroke(parent, pixels, isArrow) {
      const line2 = along(pixels);
      for (const name of ["pd-guide-halo", "pd-guide-line"])
        parent.append(shape("path", name, { d: line2 }));
      if (isArrow) parent.append(shape("path", "pd-guide-line", { d: head(pixels) }));
    }
    function draw() {
      layer.replaceChildren();
      const ghost = state.ghost ?? {};
      tip.hidden = !state.isActive || !at || Boolean(press) || !ghost.text;
      if (!state.isActive) return;
      const parent = shape(
        "g",
        `pd-guide pd-guide-${state.kind} pd-guide-chosen ${ghost.isBad ? "pd-guide-refused" : ""}`
      );
      layer.append(parent);
      if (state.gesture === "draw") {
        const rest = press?.points ?? [line.length && at && api.ground(...at)];
        const points = [...line, ...rest].filter(Boolean).map(ground);
        if (points.length > 1) stroke(parent, points, true);
        for (const [x, y] of line.map(ground).filter(Boolean))
          parent.append(shape("circle", "pd-guide-point", { cx: x, cy: y, r: 4 }));
      } else if (state.gesture === "pick") {
        const from = api.project(state.from);
        const to = ghost.to ? api.project(ghost.to) : at;
        if (from && to) stroke(parent, bow(from, to).points, true);
      } else if (ghost.points) {
        stroke(parent, ghost.points.map(ground), state.kind !== "stop-at-line");
      } else if (state.kind === "goal-point" && at) {
        const picture = flag();
        picture.setAttribute("transform", `translate(${at[0]} ${at[1]})`);
        parent.append(picture);
      }
      if (tip.hidden) return;
      tip.textContent = ghost.text;
      tip.style.left = `${Math.min(at[0] + 18, api.canvas().clientWidth - 200)}px`;
      tip.style.top = `${at[1] + 18}px`;
    }
    function event(kind, more) {
      api.send({ kind, tool: state.kind, ...more });
    }
    function ask() {
      clearTimeout(late);
      const wait = askedAt + ASK_MS - performance.now();
      if (wait > 0) {
        late = setTimeout(ask, wait);
        return;
      }
      if (!state.isActive || press || !at || state.gesture === "draw") return;
      const ray = api.ray(...at);
      if (!ray) return;
      askedAt = performance.now();
      event("point", { at, ray });
    }
    api.listen(window, "pointerdown", (down) => {
      if (!state.isActive || !api.isModePress(down)) return;
      api.take(down);
      at = api.local(down);
      press = { id: down.pointerId, at };
      const point = api.ground(...at);
      if (state.gesture === "draw") press.points = point ? [point] : [];
      draw();
    }, { capture: true });
    api.listen(window, "pointermove", (move) => {
      if (!state.isActive) return;
      if (press && move.pointerId !== press.id) return;
      at = press || api.isOnPicture(move) ? api.local(move) : null;
      if (press?.points) {
        const far = Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) >= APART_PX;
        const point = far && api.ground(...at);
        if (point && press.points.length < MAX_POINTS) {
          press.points.push(point);
          press.at = at;
        }
      } else if (at && move.buttons === 0) ask();
      draw();
    }, { capture: true });
    function giveUp() {
      press = null;
      draw();
    }
    function finish() {
      const points = line.map((point) => point.map((v) => Math.round(v * 100) / 100));
      line = [];
      event("drawn", { points });
    }
    const isNear = (one, other) => Boolean(one && other) && Math.hypot(one[0] - other[0], one[1] - other[1]) <= SAME_PX;
    function addToLine(points) {
      const isClick = points.length && points.every(
        (point) => isNear(ground(point), ground(points[0]))
      );
      if (isClick && line.length > 1 && isNear(ground(points[0]), ground(line.at(-1)))) {
        finish();
        return;
      }
      const isWhole = !isClick && !line.length;
      if (isClick && !line.length) line.push(state.from.slice(0, 2));
      line.push(...isClick ? [points[0]] : points);
      if (isWhole) finish();
    }
    api.listen(window, "keydown", (key) => {
      if (!state.isActive || !line.length || press) return;
      if (key.key !== "Enter" && key.key !== "Backspace") return;
      api.take(key);
      if (key.key === "Enter") finish();
      else if (line.pop() && line.length === 1) line = [];
      draw();
    }, { capture: true });
    function release(up) {
      const { points } = press;
      const pixel = api.local(up);
      if (points) addToLine(points);
      else {
        const ray = api.ray(...pixel);
        if (ray) event("click", { at: pixel, ray });
      }
      giveUp();
    }
    api.followPress({ held: () => press, release, giveUp });
    api.onView(draw);
    api.onDispose(() => document.body.classList.remove("pd-guiding"));
    return (next) => {
      if (!next.isActive || next.kind !== state.kind) [press, line] = [null, []];
      state = next;
      document.body.classList.toggle("pd-guiding", state.isActive);
      draw();
    };
  });

  // src/elements/hints.js
  pdOverlay.define("hints", (api) => {
    const KEPT = "pd-hints-done";
    const STEPS = [
      ["select", "Click a car", "to select it; Ctrl+drag selects several."],
      ["drag", "Drag it", "to move it; Shift+drag turns it."],
      ["bend", "Bend the road", "with a slider of the Road tab."],
      ["regenerate", "Regenerate", "trajectories with the key R, or in the Drive tab."]
    ];
    const FILL = ["Fill the road", "with 'As many as fit' in the Drive tab."];
    const kept = api.recall(KEPT);
    const done = new Set(Array.isArray(kept) ? kept : []);
    const card = api.make("div", "pd-solid pd-hint", {
      role: "status",
      "aria-label": "Hint"
    });
    const count = api.make("span", "pd-hint-count");
    const what = api.make("b");
    const how = api.make("span");
    const close = api.make("button", "", {
      type: "button",
      "aria-label": "Close the hints",
      title: "Close the hints"
    }, "×");
    card.append(count, what, how, close);
    card.hidden = true;
    let isEmpty = false;
    api.box.append(card);
    function show() {
      const index = STEPS.findIndex(([name]) => !done.has(name));
      card.hidden = index < 0;
      if (index < 0) return;
      count.textContent = isEmpty ? "" : `${index + 1} / ${STEPS.length}`;
      [what.textContent, how.textContent] = isEmpty ? FILL : STEPS[index].slice(1);
    }
    close.addEventListener("click", () => {
      STEPS.forEach(([name]) => done.add(name));
      api.remember(KEPT, [...done]);
      show();
    });
    return (state) => {
      isEmpty = state.isEmpty;
      for (const [name, isDone] of Object.entries(state.done)) if (isDone) done.add(name);
      api.remember(KEPT, [...done]);
      show();
    };
  });

  // src/elements/hover_outline.js
  pdOverlay.define("hover_outline", (api) => {
    const WIDTH_PX = 2.5;
    let lookedAt = 0;
    function thin() {
      const { nodeRefFromName } = api.viewer() ?? {};
      const canvas = api.canvas();
      if (!nodeRefFromName || !canvas) return;
      for (const [name, node] of Object.entries(nodeRefFromName)) {
        if (!name.startsWith("/agents/")) continue;
        node?.traverse((part) => {
          const material = part.material;
          if (material?.uniforms?.screenspace === void 0) return;
          material.uniforms.thickness.value = WIDTH_PX;
          material.uniforms.size.value.set(canvas.width, canvas.height);
        });
      }
    }
    function hideBox() {
      const isDrag = window.__viserPointer?.cameraLockReasons?.().includes("node-drag");
      document.body.classList.toggle("pd-holds-agent", Boolean(isDrag));
      const box = api.viewer()?.canvas2d;
      if (box) box.style.visibility = isDrag ? "hidden" : "";
    }
    for (const type of ["pointermove", "pointerup"])
      api.listen(window, type, () => requestAnimationFrame(hideBox), { passive: true });
    api.listen(window, "pointermove", () => {
      const now = performance.now();
      if (now - lookedAt < 200) return;
      lookedAt = now;
      thin();
    }, { passive: true });
  });

  // src/elements/keys.js
  pdOverlay.define("keys", (api) => {
    const veil = api.make("div", "pd-veil");
    const sheet = api.make("div", "pd-solid pd-sheet", {
      role: "dialog",
      "aria-modal": "true",
      "aria-label": "Keys and mouse",
      tabindex: "-1"
    });
    const columns = api.make("div", "pd-sheet-columns");
    const close = api.make("button", "pd-sheet-close", {
      type: "button",
      "aria-label": "Close"
    }, "×");
    sheet.append(close, columns);
    veil.append(sheet);
    veil.hidden = true;
    api.box.append(veil);
    let numOpened = 0;
    let before = null;
    function show(isOpen) {
      if (veil.hidden !== isOpen) return;
      veil.hidden = !isOpen;
      if (isOpen) {
        before = document.activeElement;
        sheet.focus();
      } else {
        before?.focus?.();
      }
    }
    const isTyping = (target) => target?.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(target?.tagName ?? "");
    api.listen(window, "keydown", (event) => {
      const asks = event.key === "F1" || event.key === "?" && !isTyping(event.target);
      if (asks && !event.ctrlKey && !event.metaKey && !event.altKey) {
        event.preventDefault();
        show(veil.hidden);
      } else if (veil.hidden) {
        return;
      } else if (event.key === "Escape") {
        show(false);
      }
      if (!event.ctrlKey && !event.metaKey) event.stopPropagation();
    }, true);
    veil.addEventListener("pointerdown", (event) => {
      if (event.target === veil) show(false);
    });
    close.addEventListener("click", () => show(false));
    return (state) => {
      columns.replaceChildren(...state.groups.map(({ title, rows }) => {
        const group = api.make("section");
        const list = api.make("dl");
        for (const { keys, does } of rows) {
          const row = api.make("div");
          row.append(api.make("dt", "", {}, keys), api.make("dd", "", {}, does));
          list.append(row);
        }
        group.append(api.make("h2", "", {}, title), list);
        return group;
      }));
      if (state.numOpened > numOpened) show(true);
      numOpened = state.numOpened;
    };
  });

  // src/elements/labels.js
  pdOverlay.define("labels", (api) => {
    const GAP_PX = 18;
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("class", "pd-leaders");
    svg.setAttribute("aria-hidden", "true");
    api.box.appendChild(svg);
    const plates = [];
    let labels = [];
    function plate(index) {
      while (plates.length <= index) {
        const box = api.make("div", "pd-label", { role: "note" });
        const text = api.make("div");
        const note = api.make("div", "pd-label-note");
        box.append(text, note);
        api.box.appendChild(box);
        const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
        svg.appendChild(line);
        plates.push({ box, text, note, line });
      }
      return plates[index];
    }
    function hide({ box, line }) {
      box.style.display = "none";
      line.style.display = "none";
    }
    function choose(x, y, radius, width, height, placed) {
      const reach = radius * Math.SQRT1_2 + GAP_PX * Math.SQRT1_2;
      let best = null;
      for (const [side, rise] of [[1, -1], [-1, -1], [1, 1], [-1, 1]]) {
        const left = side > 0 ? x + reach : x - reach - width;
        const top = rise < 0 ? y - reach - height : y + reach;
        const outside = Math.max(0, -left) + Math.max(0, left + width - api.root.clientWidth) + Math.max(0, -top) + Math.max(0, top + height - api.root.clientHeight);
        const hits = placed.filter((other) => left < other.left + other.width && other.left < left + width && top < other.top + other.height && other.top < top + height).length;
        const cost = outside + 1e3 * hits;
        if (best === null || cost < best.cost)
          best = { left, top, width, height, side, rise, cost };
      }
      return best;
    }
    function place() {
      const placed = [...pdOverlay.taken ?? []];
      labels.forEach(({ point, radius }, index) => {
        const shown = plate(index);
        const at = api.project(point);
        const beside = api.project([point[0], point[1] + radius, point[2]]);
        const along = api.project([point[0] + radius, point[1], point[2]]);
        if (!at || !beside || !along) {
          hide(shown);
          return;
        }
        shown.box.style.display = "";
        const radiusPx = Math.max(
          Math.hypot(beside[0] - at[0], beside[1] - at[1]),
          Math.hypot(along[0] - at[0], along[1] - at[1])
        );
        const spot = choose(
          at[0],
          at[1],
          radiusPx,
          shown.box.offsetWidth,
          shown.box.offsetHeight,
          placed
        );
        placed.push(spot);
        shown.box.style.transform = `translate(${Math.round(spot.left)}px, ${Math.round(spot.top)}px)`;
        const start = radiusPx * Math.SQRT1_2;
        const corner = [
          spot.side > 0 ? spot.left : spot.left + spot.width,
          spot.rise < 0 ? spot.top + spot.height : spot.top
        ];
        shown.line.style.display = "";
        shown.line.setAttribute("x1", at[0] + spot.side * start);
        shown.line.setAttribute("y1", at[1] + spot.rise * start);
        shown.line.setAttribute("x2", corner[0]);
        shown.line.setAttribute("y2", corner[1]);
      });
      plates.slice(labels.length).forEach(hide);
    }
    api.onView(place);
    return (state) => {
      labels = state.labels;
      labels.forEach(({ text, note }, index) => {
        const shown = plate(index);
        if (shown.text.textContent !== text) shown.text.textContent = text;
        if (shown.note.textContent !== note) shown.note.textContent = note;
      });
      place();
    };
  });

  // src/elements/legend.js
  pdOverlay.define("legend", (api) => {
    const KEPT = "pd-legend-folded";
    const ARCS = [["Could threaten it", "var(--pd-bad)"], ["Could yield", "var(--pd-guide)"]].map(([text, color]) => ({ text, glyph: "line", color, isArc: true }));
    const box = api.make("div", "pd-solid pd-legend-box");
    const list = api.make("ul", "pd-legend-list", { id: "pd-legend-list" });
    const chip = api.make("button", "pd-legend-chip", {
      type: "button",
      "aria-controls": "pd-legend-list"
    }, "Legend");
    box.append(list, chip);
    api.box.append(box);
    function fold(isFolded2) {
      list.hidden = isFolded2;
      chip.setAttribute("aria-expanded", String(!isFolded2));
    }
    let isFolded = api.recall(KEPT) === true;
    fold(isFolded);
    chip.addEventListener("click", () => {
      isFolded = !isFolded;
      api.remember(KEPT, isFolded);
      fold(isFolded);
    });
    return ({ entries }) => {
      list.replaceChildren(...[...entries, ...ARCS].map(({ text, glyph, color, keeps, isArc }) => {
        const item = api.make("li", isArc ? "pd-legend-arc" : "");
        const mark = api.make("span", `pd-legend-mark pd-legend-${glyph}`);
        mark.style.color = color;
        if (keeps) {
          mark.classList.add(`pd-lock-${keeps}`);
          mark.append(pdOverlay.padlock());
        }
        item.append(mark, api.make("span", "", {}, text));
        return item;
      }));
    };
  });

  // src/elements/locks.js
  pdOverlay.padlock = () => {
    const NAMESPACE = "http://www.w3.org/2000/svg";
    const svg = document.createElementNS(NAMESPACE, "svg");
    svg.setAttribute("viewBox", "0 0 16 16");
    svg.setAttribute("aria-hidden", "true");
    const path = document.createElementNS(NAMESPACE, "path");
    path.setAttribute("d", "M3 7h10v7H3z M5 7V5a3 3 0 0 1 6 0v2");
    svg.append(path);
    return svg;
  };
  pdOverlay.define("locks", (api) => {
    const SIZE_PX = 18;
    const COMPACT_PX = 9;
    const plates = [];
    let locks = [];
    function plate(index) {
      while (plates.length <= index) {
        const box = api.make("div", "pd-lock", { role: "img" });
        const text = api.make("span", "pd-lock-seconds");
        box.append(pdOverlay.padlock(), text);
        api.box.appendChild(box);
        plates.push({ box, text });
      }
      return plates[index];
    }
    function place() {
      const taken = [];
      locks.forEach(({ point, radius }, index) => {
        const { box } = plate(index);
        const at = api.project(point);
        const beside = api.project([point[0] + radius, point[1], point[2]]);
        const along = api.project([point[0], point[1] + radius, point[2]]);
        if (!at || !beside || !along) {
          box.style.display = "none";
          return;
        }
        const reach = Math.max(
          Math.hypot(beside[0] - at[0], beside[1] - at[1]),
          Math.hypot(along[0] - at[0], along[1] - at[1])
        );
        box.classList.toggle("pd-compact", reach < COMPACT_PX);
        box.style.display = "";
        const width = box.offsetWidth;
        const right = at[0] - reach * Math.SQRT1_2 + 3;
        const top = at[1] + reach * Math.SQRT1_2 - 3;
        const left = right - width;
        const isFree = taken.every((other) => left >= other.right || right <= other.left || Math.abs(top - other.top) >= SIZE_PX);
        if (!isFree) {
          box.style.display = "none";
          return;
        }
        taken.push({ left, right, top });
        box.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
      });
      plates.slice(locks.length).forEach(({ box }) => {
        box.style.display = "none";
      });
    }
    api.onView(place);
    return (state) => {
      locks = state.locks;
      locks.forEach(({ keeps, seconds, label }, index) => {
        const { box, text } = plate(index);
        box.className = `pd-lock pd-lock-${keeps}`;
        box.setAttribute("aria-label", label);
        if (text.textContent !== seconds) text.textContent = seconds;
      });
      place();
    };
  });

  // src/elements/map_window.js
  pdOverlay.define("mapWindow", (api) => {
    const SVG = "http://www.w3.org/2000/svg";
    const LEAST_M = 10;
    let square = null;
    let press = null;
    const veil = api.make("div", "pd-veil pd-map-window");
    const card = api.make("div", "pd-solid", {
      role: "dialog",
      "aria-label": "Choose a part of the map",
      "aria-modal": "true"
    });
    const title = api.make("b");
    const [svg, road, rect] = ["svg", "path", "rect"].map(
      (name) => document.createElementNS(SVG, name)
    );
    svg.append(road, rect);
    const size = api.make("input", "", { type: "number", min: LEAST_M, step: 10 });
    const label = api.make("label", "", {}, "Half side (m) ");
    const told = api.make("span");
    const [cancel, open] = ["Cancel", "Open this part"].map(
      (text) => api.make("button", "", { type: "button" }, text)
    );
    const foot = api.make("div", "pd-map-window-foot");
    label.append(size);
    foot.append(label, told, cancel, open);
    card.append(title, svg, foot);
    veil.append(card);
    veil.hidden = true;
    api.box.append(veil);
    function draw() {
      const [x, y, half] = square;
      const box = { x: x - half, y: -y - half, width: 2 * half, height: 2 * half };
      for (const [name, value] of Object.entries(box)) rect.setAttribute(name, value);
      told.textContent = `${Math.round(2 * half)} × ${Math.round(2 * half)} m`;
      if (document.activeElement !== size) size.value = half.toFixed(0);
    }
    function metres(event) {
      const at = new DOMPoint(event.clientX, event.clientY);
      const { x, y } = at.matrixTransform(svg.getScreenCTM().inverse());
      return [x, -y];
    }
    svg.addEventListener("pointerdown", (event) => {
      size.blur();
      press = metres(event);
      svg.setPointerCapture(event.pointerId);
      square = [...press, square[2]];
      draw();
    });
    svg.addEventListener("pointermove", (event) => {
      const [dx, dy] = metres(event).map((value, axis) => value - (press?.[axis] ?? value));
      const half = Math.max(Math.abs(dx), Math.abs(dy)) / 2;
      if (half < LEAST_M) return;
      square = [press[0] + (dx < 0 ? -half : half), press[1] + (dy < 0 ? -half : half), half];
      draw();
    });
    svg.addEventListener("pointerup", () => press = null);
    size.addEventListener("input", () => {
      square[2] = Math.max(Number(size.value), LEAST_M);
      draw();
    });
    open.addEventListener("click", () => api.send({ kind: "open", square }));
    cancel.addEventListener("click", () => api.send({ kind: "cancel" }));
    api.listen(window, "keydown", (event) => {
      if (veil.hidden) return;
      event.stopPropagation();
      if (event.key === "Escape") cancel.click();
    }, { capture: true });
    return (state) => {
      veil.hidden = !state.road;
      if (veil.hidden) return;
      square = [...state.square];
      title.textContent = state.title;
      road.setAttribute("d", state.road);
      svg.setAttribute("viewBox", state.view);
      draw();
    };
  });

  // src/elements/measure.js
  pdOverlay.define("measure", (api) => {
    const SAME_PX = 4;
    const LEAST_TOLD_M = 0.05;
    const SVG = "http://www.w3.org/2000/svg";
    const layer = api.make("div", "pd-picture pd-measure-layer pd-gone");
    const drawing = document.createElementNS(SVG, "svg");
    const labels = api.make("div");
    layer.append(drawing, labels);
    api.box.append(layer);
    let state = { isActive: false, speed: null, agent: "" };
    let points = [];
    let isComplete = false;
    let pointer = null;
    const length = (a, b) => Math.hypot(b[0] - a[0], b[1] - a[1]);
    const metres = (value) => `${value.toFixed(value < 100 ? 1 : 0)} m`;
    function line(from, to, name) {
      for (const part of ["pd-measure-halo", name]) {
        const element = document.createElementNS(SVG, "line");
        for (const [key, value] of [["x1", from[0]], ["y1", from[1]], ["x2", to[0]], ["y2", to[1]]])
          element.setAttribute(key, value);
        element.setAttribute("class", part);
        drawing.append(element);
      }
    }
    function label(at, lines, name = "") {
      const element = api.make("div", `pd-measure-label ${name}`);
      for (const text of lines) element.append(api.make("div", "", {}, text));
      element.style.transform = `translate(${at[0]}px, ${at[1]}px)`;
      labels.append(element);
    }
    function draw() {
      drawing.replaceChildren();
      labels.replaceChildren();
      if (!state.isActive) return;
      const preview = !isComplete && points.length && pointer ? api.ground(...pointer) : null;
      const way = preview ? [...points, preview] : points;
      const pixels = way.map((point) => api.project([point[0], point[1], 0]));
      let total = 0;
      for (let i = 1; i < way.length; i += 1) {
        const [from, to] = [pixels[i - 1], pixels[i]];
        total += length(way[i - 1], way[i]);
        if (!from || !to) continue;
        line(from, to, preview && i === way.length - 1 ? "pd-measure-open" : "pd-measure-line");
        if (way.length > 2 && length(way[i - 1], way[i]) >= LEAST_TOLD_M)
          label(
            [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2],
            [metres(length(way[i - 1], way[i]))],
            "pd-measure-part"
          );
      }
      for (const pixel of pixels.slice(0, points.length)) {
        if (!pixel) continue;
        const dot = document.createElementNS(SVG, "circle");
        dot.setAttribute("cx", pixel[0]);
        dot.setAttribute("cy", pixel[1]);
        dot.setAttribute("r", 4);
        drawing.append(dot);
      }
      const end = pixels.at(-1);
      if (way.length < 2 || !end) return;
      const lines = [way.length > 2 ? `${metres(total)} in all` : metres(total)];
      if (state.speed !== null)
        lines.push(`${(total / state.speed).toFixed(1)} s at ${state.speed.toFixed(1)} m/s (${state.agent})`);
      label(end, lines, "pd-measure-total");
    }
    layer.addEventListener("click", (event) => {
      if (event.button !== 0) return;
      if (event.detail === 2) {
        isComplete = points.length > 1;
        draw();
        return;
      }
      const point = api.ground(...api.local(event));
      if (!point) return;
      if (isComplete) points = [];
      isComplete = false;
      const last = points.length ? api.project([...points.at(-1), 0]) : null;
      const [x, y] = api.local(event);
      if (last && Math.hypot(x - last[0], y - last[1]) < SAME_PX) return;
      points.push(point);
      draw();
    });
    layer.addEventListener("pointermove", (event) => {
      pointer = api.local(event);
      draw();
    });
    layer.addEventListener("pointerleave", () => {
      pointer = null;
      draw();
    });
    api.listen(window, "keydown", (event) => {
      if (!state.isActive || event.ctrlKey || event.metaKey || event.altKey) return;
      if (/^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "")) return;
      if (event.key === "Enter" && event.target?.tagName !== "BUTTON")
        isComplete = points.length > 1;
      else if (event.key === "Backspace" || event.key === "Delete") {
        points.pop();
        isComplete = false;
      } else return;
      event.preventDefault();
      event.stopPropagation();
      draw();
    }, { capture: true });
    api.onView(draw);
    return (next) => {
      if (next.isActive !== state.isActive) {
        points = next.start ? [next.start] : [];
        isComplete = false;
        pointer = null;
      }
      state = next;
      layer.classList.toggle("pd-gone", !state.isActive);
      draw();
    };
  });

  // src/elements/menu.js
  pdOverlay.define("menu", (api) => {
    const STILL_PX = 4;
    const list = api.make("div", "pd-solid pd-menu-list", { role: "menu" });
    list.hidden = true;
    api.box.appendChild(list);
    let press = null;
    function close() {
      list.hidden = true;
    }
    const entries = () => [...list.querySelectorAll("button:not(:disabled)")];
    function focusBy(steps) {
      const all = entries();
      const index = all.indexOf(document.activeElement);
      all[(index + steps + all.length) % all.length]?.focus();
    }
    api.listen(window, "pointerdown", (event) => {
      if (!list.contains(event.target)) close();
      const isRight = event.button === 2 && api.isOnPicture(event);
      press = isRight ? { id: event.pointerId, x: event.clientX, y: event.clientY } : null;
    }, { capture: true, passive: true });
    const strays = (event) => Math.hypot(event.clientX - press.x, event.clientY - press.y) > STILL_PX;
    api.listen(window, "pointermove", (event) => {
      if (press && event.pointerId === press.id && strays(event)) press = null;
    }, { capture: true, passive: true });
    api.listen(window, "pointerup", (event) => {
      if (!press || event.pointerId !== press.id || event.button !== 2) return;
      const isClick = !strays(event);
      press = null;
      const at = api.local(event);
      const ray = isClick && api.ray(...at);
      if (ray) api.send({ kind: "open", at, ray });
    }, { capture: true, passive: true });
    api.listen(window, "contextmenu", (event) => {
      if (api.isOnPicture(event) || list.contains(event.target))
        event.preventDefault();
    }, { capture: true });
    api.listen(window, "wheel", close, { capture: true, passive: true });
    api.listen(window, "blur", close);
    api.onView(close);
    api.listen(window, "keydown", (event) => {
      if (list.hidden) return;
      const steps = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (event.key === "Escape") close();
      else if (steps) focusBy(steps);
      else return;
      api.take(event);
    }, { capture: true });
    return ({ number, at, title, items }) => {
      close();
      if (!items.length) return;
      const head = api.make("div", "pd-menu-title", {}, title);
      const buttons = items.map((item, index) => {
        const button = api.make("button", "", { type: "button", role: "menuitem" });
        button.append(api.make("span", "", {}, item.label));
        if (item.key) button.append(api.make("span", "pd-menu-key", {}, item.key));
        button.disabled = !item.isEnabled;
        button.addEventListener("click", () => {
          close();
          api.send({ kind: "choose", index, menu: number });
        });
        return button;
      });
      list.setAttribute("aria-label", title);
      list.replaceChildren(head, ...buttons);
      list.hidden = false;
      const { clientWidth, clientHeight } = api.canvas();
      const fit = (place, size, room) => Math.max(8, Math.min(place, room - size - 8));
      list.style.left = `${fit(at[0] + 2, list.offsetWidth, clientWidth)}px`;
      list.style.top = `${fit(at[1] + 2, list.offsetHeight, clientHeight)}px`;
    };
  });

  // src/elements/page.js
  pdOverlay.define("page", (api) => {
    api.listen(document, "keydown", (event) => {
      const isTyping = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "");
      if (isTyping) return;
      if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "a")
        event.preventDefault();
    });
    api.listen(window, "keydown", (event) => {
      const { target, ctrlKey, metaKey } = event;
      const isAsked = (ctrlKey || metaKey) && !event.shiftKey && !event.altKey && event.key.toLowerCase() === "k";
      if (!isAsked || !event.isTrusted || !/^(INPUT|TEXTAREA|SELECT)$/.test(target?.tagName ?? ""))
        return;
      if (target.closest("[role=dialog]")) return;
      api.take(event);
      target.blur();
      document.body.dispatchEvent(new KeyboardEvent("keydown", {
        key: "k",
        code: "KeyK",
        ctrlKey,
        metaKey,
        bubbles: true,
        cancelable: true
      }));
    }, true);
    api.listen(document, "pointerdown", (event) => {
      if (api.isOnPicture(event)) event.preventDefault = () => {
      };
    }, { capture: true });
    return ({ title, isDark }) => {
      document.title = title;
      api.root.classList.toggle("pd-dark", isDark);
      document.documentElement.classList.toggle("pd-dark-page", isDark);
    };
  });
  pdOverlay.define("theme", (api) => {
    const KEPT = "pd-editor-dark";
    const browsers = window.matchMedia("(prefers-color-scheme: dark)");
    const tell = () => api.send({ isDark: api.recall(KEPT) ?? browsers.matches });
    api.listen(browsers, "change", tell);
    tell();
    return ({ isDark }) => api.remember(KEPT, isDark);
  });

  // src/elements/panel.js
  pdOverlay.define("panel", (api) => {
    const PATIENCE_MS = 8e3;
    const RETRY_MS = 250;
    let wanted = null;
    let told = null;
    let startedAt = 0;
    let triedAt = -Infinity;
    const tabs = () => [...document.querySelectorAll("[role=tab]")].filter(
      (tab) => !api.root.contains(tab)
    );
    const isOpen = (tab) => tab.getAttribute("aria-selected") === "true";
    const title = (tab) => tab.textContent.trim();
    function restore() {
      if (wanted === null) return;
      const now = performance.now();
      const tab = tabs().find((one) => title(one) === wanted);
      if (tab && isOpen(tab) || now - startedAt > PATIENCE_MS) wanted = null;
      else if (tab && now - triedAt > RETRY_MS) {
        triedAt = now;
        tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
        if (!isOpen(tab)) tab.click();
      }
    }
    function tell() {
      restore();
      if (wanted !== null) return;
      const open = tabs().find(isOpen);
      if (!open || title(open) === told) return;
      told = title(open);
      const box = scrolled();
      if (box) box.scrollTop = places.get(told) ?? 0;
      api.send({ kind: "tab", title: told });
    }
    const places = /* @__PURE__ */ new Map();
    const scrolled = () => tabs().find(isOpen)?.closest("[data-scrollarea-viewport]");
    api.listen(document, "scroll", (event) => {
      const box = event.target;
      if (told !== null && box !== document && box === scrolled())
        places.set(told, box.scrollTop);
    }, { capture: true });
    let isHeld = false;
    function release() {
      if (!isHeld) return;
      isHeld = false;
      api.send({ kind: "release" });
    }
    api.listen(window, "pointerdown", (event) => {
      release();
      if (event.button !== 0 || api.root.contains(event.target)) return;
      if (!event.target?.closest?.("[class*=Slider-root]")) return;
      isHeld = true;
      api.send({ kind: "hold" });
    }, { capture: true });
    for (const type of ["pointerup", "pointercancel"])
      api.listen(window, type, release, { capture: true });
    api.listen(window, "blur", release);
    const isField = (target) => target?.matches?.("input:not([type=checkbox]):not([type=range])") && target.closest(
      ".mantine-NumberInput-root, .mantine-TextInput-root, .pd-guidance-inputs"
    ) && !target.closest("[role=dialog]");
    api.listen(window, "keydown", (event) => {
      if (event.key === "Enter" && !event.isComposing && isField(event.target))
        event.target.blur();
    });
    const numbers = /* @__PURE__ */ new WeakMap();
    const isNumber = (text) => text.trim() !== "" && Number.isFinite(Number(text));
    const numberField = (event) => event.target?.closest?.("input.mantine-NumberInput-input");
    api.listen(document, "beforeinput", (event) => {
      const field = numberField(event);
      if (field && isNumber(field.value)) numbers.set(field, field.value);
    }, { capture: true });
    api.listen(document, "focusout", (event) => {
      const field = numberField(event);
      if (field) setTimeout(() => restoreNumber(field));
    }, { capture: true });
    function restoreNumber(field) {
      if (isNumber(field.value) || !numbers.has(field)) return;
      const { set } = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
      set.call(field, numbers.get(field));
      field.dispatchEvent(new Event("input", { bubbles: true }));
    }
    function leaveDialog() {
      const dialog = [...document.querySelectorAll(".mantine-Modal-content")].at(-1);
      const buttons = dialog?.querySelectorAll("button") ?? [];
      buttons[buttons.length - 1]?.click();
      return buttons.length > 0;
    }
    api.listen(window, "keydown", (event) => {
      if (event.key === "Escape" && leaveDialog()) event.stopImmediatePropagation();
    }, { capture: true });
    api.listen(window, "click", ({ target }) => {
      if (target?.matches?.(".mantine-Modal-inner, .mantine-Modal-overlay")) leaveDialog();
    }, { capture: true });
    const observer = new MutationObserver(tell);
    api.onDispose(() => {
      observer.disconnect();
      document.body.classList.remove("pd-debug");
    });
    return (state) => {
      document.body.classList.toggle("pd-debug", state.isDebug);
      const open = tabs().find(isOpen);
      if (state.instead && open && title(open) !== state.instead) return;
      wanted = state.tab;
      told = state.instead ?? state.tab;
      startedAt = performance.now();
      observer.observe(document.body, {
        subtree: true,
        childList: true,
        attributes: true,
        attributeFilter: ["aria-selected"]
      });
      tell();
    };
  });

  // src/elements/placing.js
  pdOverlay.define("placing", (api) => {
    const SVG = "http://www.w3.org/2000/svg";
    const TURN_PX = 8;
    const ASK_MS = 60;
    let mode = { isActive: false };
    let at = null;
    let press = null;
    let askedAt = 0;
    let late = null;
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("class", "pd-placing-ghost");
    svg.setAttribute("aria-hidden", "true");
    const shapes = ["pd-placing-base", "pd-placing-edges", "pd-placing-arrow"].map((name) => {
      const path = document.createElementNS(SVG, "path");
      path.setAttribute("class", name);
      svg.appendChild(path);
      return path;
    });
    api.box.appendChild(svg);
    function draw() {
      const place = press ? press.point : at && api.ground(...at);
      svg.style.display = mode.isActive && place ? "" : "none";
      if (!mode.isActive || !place) return;
      const heading = press?.heading ?? mode.headingRad;
      const [length, width, height] = mode.sizeM;
      const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
      const project = (forward, left, up) => api.project([
        place[0] + forward * cos - left * sin,
        place[1] + forward * sin + left * cos,
        up
      ]);
      const ring = (up) => [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(
        ([f, l]) => project(f * length / 2, l * width / 2, up)
      );
      const [base, top] = [ring(0), ring(height)];
      const reach = length / 2 + Math.max(2.2, length * 0.4);
      const arrow = [
        project(length / 2 + 0.3, 0, 0),
        project(reach, 0, 0),
        project(reach - 0.9, 0.6, 0),
        project(reach - 0.9, -0.6, 0)
      ];
      if ([...base, ...top, ...arrow].some((point) => !point)) {
        svg.style.display = "none";
        return;
      }
      const line = (points) => `M${points.map((p) => p.map((v) => v.toFixed(1))).join("L")}`;
      shapes[0].setAttribute("d", `${line(base)}Z`);
      shapes[1].setAttribute("d", `${line(top)}Z` + base.map((point, index) => line([point, top[index]])).join(""));
      shapes[2].setAttribute(
        "d",
        line([arrow[0], arrow[1]]) + line([arrow[2], arrow[1], arrow[3]])
      );
      svg.style.setProperty("--pd-placing", mode.color);
    }
    function ask() {
      clearTimeout(late);
      const wait = askedAt + ASK_MS - performance.now();
      if (wait > 0) {
        late = setTimeout(ask, wait);
        return;
      }
      const point = mode.isActive && !press && at && api.ground(...at);
      if (!point) return;
      askedAt = performance.now();
      api.send({ kind: "point", point });
    }
    api.listen(window, "pointerdown", (event) => {
      if (!mode.isActive || !api.isModePress(event)) return;
      api.take(event);
      at = api.local(event);
      const point = api.ground(...at);
      if (point) press = { id: event.pointerId, at, point, heading: null };
      draw();
    }, { capture: true });
    api.listen(window, "pointermove", (event) => {
      if (!mode.isActive) return;
      if (press) {
        if (event.pointerId !== press.id) return;
        at = api.local(event);
        const far = Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) > TURN_PX;
        const point = far ? api.ground(...at) : null;
        if (point)
          press.heading = Math.atan2(point[1] - press.point[1], point[0] - press.point[0]);
        else if (!far) press.heading = null;
      } else {
        at = api.isOnPicture(event) ? api.local(event) : null;
        if (at && event.buttons === 0) ask();
      }
      draw();
    }, { capture: true });
    function giveUp() {
      press = null;
      draw();
    }
    function release() {
      api.send({ kind: "place", point: press.point, headingRad: press.heading });
      giveUp();
    }
    api.followPress({ held: () => press, release, giveUp });
    api.listen(window, "keydown", (event) => {
      if (!mode.isActive || event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.target?.closest?.("input, textarea, select, [contenteditable]")) return;
      const number = Number(event.key);
      if (Number.isInteger(number) && number >= 1 && number <= mode.numKinds) {
        api.take(event);
        api.send({ kind: "kind", number });
      }
    }, { capture: true });
    api.onView(draw);
    api.onDispose(() => document.body.classList.remove("pd-crosshair"));
    return (state) => {
      if (!state.isActive) press = null;
      mode = state;
      document.body.classList.toggle("pd-crosshair", state.isActive);
      draw();
    };
  });

  // src/elements/region.js
  pdOverlay.define("region", (api) => {
    const SVG = "http://www.w3.org/2000/svg";
    const PARTS = 16;
    let state = { isActive: false, leastM: 10, square: null };
    let press = null;
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("class", "pd-region-drawing");
    svg.setAttribute("aria-hidden", "true");
    const [area, halo, edge] = ["pd-region-area", "pd-region-halo", "pd-region-edge"].map(
      (name) => {
        const path = document.createElementNS(SVG, "path");
        path.setAttribute("class", name);
        svg.appendChild(path);
        return path;
      }
    );
    const label = api.make("div", "pd-region-label pd-gone", { role: "group", "aria-label": "Region" });
    const text = api.make("span");
    const close = api.make(
      "button",
      "pd-region-clear",
      { type: "button", title: "Clear the region", "aria-label": "Clear the region" },
      "×"
    );
    label.append(text, close);
    api.box.append(svg, label);
    close.addEventListener("click", () => api.send({ kind: "clear" }));
    function spanned() {
      const [dx, dy] = [press.to[0] - press.from[0], press.to[1] - press.from[1]];
      const half = Math.max(Math.abs(dx), Math.abs(dy)) / 2;
      return [
        press.from[0] + (dx < 0 ? -half : half),
        press.from[1] + (dy < 0 ? -half : half),
        half
      ];
    }
    function draw() {
      const square = press ? spanned() : state.square;
      const isShown = square && square[2] > 0;
      svg.style.display = isShown ? "" : "none";
      label.classList.toggle("pd-gone", !isShown);
      if (!isShown) return;
      const [x, y, half] = square;
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(
        ([a, b]) => [x + a * half, y + b * half]
      );
      const ring = corners.flatMap((from, index) => {
        const to = corners[(index + 1) % 4];
        return Array.from({ length: PARTS }, (_, part) => [0, 1].map(
          (axis) => from[axis] + part / PARTS * (to[axis] - from[axis])
        ));
      });
      const seen = ring.map((point) => api.project([...point, 0])).filter(Boolean);
      if (seen.length < 3) {
        svg.style.display = "none";
        label.classList.add("pd-gone");
        return;
      }
      const outline = `M${seen.map((p) => p.map((v) => v.toFixed(1))).join("L")}Z`;
      for (const path of [area, halo, edge]) path.setAttribute("d", outline);
      const isSmall = press && 2 * half < state.leastM;
      svg.classList.toggle("pd-region-small", Boolean(isSmall));
      const side = (2 * half).toFixed(2 * half < 100 ? 1 : 0);
      text.textContent = isSmall ? `${side} m: at least ${state.leastM} m` : `Region ${side} × ${side} m`;
      close.hidden = Boolean(press);
      label.classList.toggle("pd-solid", !press);
      const top = seen.reduce((one, other) => other[1] < one[1] ? other : one);
      const canvas = api.canvas();
      const at = [
        Math.min(Math.max(top[0], 90), canvas.clientWidth - 90),
        Math.min(Math.max(top[1], 96), canvas.clientHeight - 72)
      ];
      label.style.transform = `translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px) translate(-50%, -130%)`;
    }
    api.listen(window, "pointerdown", (event) => {
      if (!state.isActive || !api.isModePress(event)) return;
      api.take(event);
      const point = api.ground(...api.local(event));
      if (point) press = { id: event.pointerId, from: point, to: point };
      draw();
    }, { capture: true });
    api.listen(window, "pointermove", (event) => {
      if (!press || event.pointerId !== press.id) return;
      press.to = api.ground(...api.local(event)) ?? press.to;
      draw();
    }, { capture: true });
    function giveUp() {
      press = null;
      draw();
    }
    function release() {
      const { from, to } = press;
      if (from[0] !== to[0] || from[1] !== to[1]) api.send({ kind: "drawn", from, to });
      giveUp();
    }
    api.followPress({ held: () => press, release, giveUp });
    api.onView(draw);
    api.onDispose(() => document.body.classList.remove("pd-drawing-region"));
    return (next) => {
      if (!next.isActive) press = null;
      state = next;
      document.body.classList.toggle("pd-drawing-region", state.isActive);
      draw();
    };
  });

  // src/elements/sample_pair.js
  pdOverlay.define("sample-pair", (api) => {
    const { make } = api;
    const panel = make("section", "pd-solid pd-pair", {
      role: "dialog",
      "aria-label": "Two samples side by side"
    });
    const sides = ["left", "right"].map((name, place) => {
      const box = make("div", "pd-pair-side");
      const title = make("select", "", {
        "aria-label": `Sample on the ${name}`,
        title: "Another sample here"
      });
      title.addEventListener("change", () => api.send({ kind: "choose", side: place, value: Number(title.value) }));
      const use = make("button", "pd-pair-use", { type: "button" });
      const head = make("div", "pd-pair-head");
      const canvas = make("canvas", "", { "aria-label": `Top view, ${name}` });
      head.append(title, use);
      box.append(head, canvas);
      panel.append(box);
      const side = { title, use, canvas, sample: null };
      use.addEventListener("click", () => api.send({ kind: "use", value: side.sample.index }));
      return side;
    });
    const close = make("button", "pd-close", {
      type: "button",
      "aria-label": "Close the comparison",
      title: "Close (Esc)"
    }, "×");
    close.addEventListener("click", () => api.send({ kind: "close" }));
    panel.append(close);
    panel.hidden = true;
    api.box.append(panel);
    const COLORS = ["#3d7fe6", "#e06a1b", "#17a08f", "#d6337f"];
    let state = { isOpen: false };
    let ground = null;
    let view = { x: 0, y: 0, scale: 4 };
    function drawSide({ canvas, sample }, step) {
      const ratio = window.devicePixelRatio || 1;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight];
      if (!width || !sample) return;
      if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
      if (canvas.height !== Math.round(height * ratio))
        canvas.height = Math.round(height * ratio);
      const pen = canvas.getContext("2d");
      pen.setTransform(1, 0, 0, 1, 0, 0);
      pen.clearRect(0, 0, canvas.width, canvas.height);
      const scale = view.scale * ratio;
      pen.setTransform(
        scale,
        0,
        0,
        scale,
        canvas.width / 2 - view.x * scale,
        canvas.height / 2 + view.y * scale
      );
      pen.fillStyle = "rgba(139, 152, 165, 0.4)";
      if (ground) pen.fill(ground, "evenodd");
      for (const { length, width: across, color, path } of sample.agents) {
        const last = path.length / 3 - 1;
        const at = Math.min(Math.max(step, 0), last);
        const first = Math.floor(at);
        const next = Math.min(first + 1, last);
        pen.strokeStyle = pen.fillStyle = COLORS[color];
        pen.globalAlpha = 0.45;
        pen.lineWidth = Math.max(0.4, 1.2 / view.scale);
        pen.beginPath();
        for (let index = first; index <= last; index += 1)
          pen.lineTo(path[3 * index] / 10, -path[3 * index + 1] / 10);
        pen.stroke();
        pen.globalAlpha = 1;
        const share = at - first;
        const mixed = (part) => path[3 * first + part] + share * (path[3 * next + part] - path[3 * first + part]);
        pen.save();
        pen.translate(mixed(0) / 10, -mixed(1) / 10);
        pen.rotate(-path[3 * first + 2] / 100);
        const long = Math.max(length, 4 / view.scale);
        const wide = Math.max(across, 3 / view.scale);
        pen.fillRect(-long / 2, -wide / 2, long, wide);
        pen.restore();
      }
    }
    let isAlive = true;
    api.onDispose(() => {
      isAlive = false;
    });
    function run() {
      if (!isAlive || !state.isOpen) return;
      const step = pdOverlay.playhead?.() ?? 0;
      for (const side of sides) drawSide(side, step);
      requestAnimationFrame(run);
    }
    for (const { canvas } of sides) {
      canvas.addEventListener("wheel", (event) => {
        event.preventDefault();
        const box = canvas.getBoundingClientRect();
        const [dx, dy] = [
          event.clientX - box.left - box.width / 2,
          event.clientY - box.top - box.height / 2
        ];
        const scale = Math.min(Math.max(view.scale * Math.exp(-event.deltaY / 500), 0.5), 40);
        view = {
          x: view.x + dx / view.scale - dx / scale,
          y: view.y - dy / view.scale + dy / scale,
          scale
        };
      }, { passive: false });
      canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
      canvas.addEventListener("pointermove", (event) => {
        if (!canvas.hasPointerCapture(event.pointerId)) return;
        view = {
          ...view,
          x: view.x - event.movementX / view.scale,
          y: view.y + event.movementY / view.scale
        };
      });
    }
    panel.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      api.send({ kind: "close" });
    });
    return (next) => {
      const wasOpen = state.isOpen;
      state = next;
      panel.hidden = !state.isOpen;
      if (!state.isOpen) return;
      ground = new Path2D(state.ground);
      sides.forEach((side, place) => {
        side.sample = state.samples[place];
        side.title.replaceChildren(...state.offered.map(({ index, isAdopted }) => make(
          "option",
          "",
          { value: String(index) },
          `Sample ${index + 1}${isAdopted ? ", in use" : ""}`
        )));
        side.title.value = String(side.sample.index);
        side.use.textContent = side.sample.isAdopted ? "In use" : "Use this sample";
        side.use.disabled = side.sample.isAdopted;
      });
      if (!wasOpen) {
        view = { x: 0, y: 0, scale: sides[0].canvas.clientWidth / (2 * state.halfWidth) || 4 };
        requestAnimationFrame(run);
        close.focus({ preventScroll: true });
      }
    };
  });

  // src/elements/samples.js
  (() => {
    let pictures = [];
    let redraw = () => {
    };
    pdOverlay.define("samples", (api) => {
      const { make } = api;
      const strip = make("section", "pd-solid pd-samples", { "aria-label": "Samples" });
      const head = make("div", "pd-samples-head");
      const title = make("strong", "pd-samples-title");
      const chooser = (label, kind) => {
        const select = make("select", "", { "aria-label": label, title: label });
        select.addEventListener("change", () => {
          const value = kind === "pick" ? Number(select.value) : select.value;
          api.send({ kind, value });
        });
        return select;
      };
      const ranking = chooser("Order of the samples", "rank");
      const pick = chooser("Samples shown", "pick");
      const hint = make(
        "span",
        "pd-samples-hint",
        {},
        "Point to preview, click to use, C compares"
      );
      const close = make("button", "pd-close", {
        type: "button",
        "aria-label": "Close the samples",
        title: "Close (Esc)"
      }, "×");
      close.addEventListener("click", () => api.send({ kind: "close" }));
      head.append(title, ranking, pick, hint, close);
      const list = make("div", "pd-samples-list", {
        role: "listbox",
        "aria-label": "Samples of the last run",
        "aria-orientation": "horizontal"
      });
      strip.append(head, list);
      strip.hidden = true;
      api.box.append(strip);
      let state = { cards: [] };
      let cursor = null;
      let pointed = null;
      let shownInUse = null;
      function point(index) {
        if (pointed === index) return;
        pointed = index;
        api.send(index === null ? { kind: "leave" } : { kind: "point", value: index });
      }
      const cards = () => [...list.querySelectorAll(".pd-sample")];
      function moveTo(place) {
        const all = cards();
        if (!all.length) return;
        const card = all[Math.min(Math.max(place, 0), all.length - 1)];
        cursor = Number(card.dataset.index);
        for (const one of all) one.tabIndex = one === card ? 0 : -1;
        card.focus({ preventScroll: true });
        card.scrollIntoView({ block: "nearest", inline: "nearest" });
        point(cursor);
      }
      strip.addEventListener("pointerleave", () => point(null));
      strip.addEventListener("keydown", (event) => {
        const place = cards().findIndex((one) => Number(one.dataset.index) === cursor);
        const target = {
          ArrowLeft: place - 1,
          ArrowRight: place + 1,
          Home: 0,
          End: Infinity
        }[event.key];
        if (event.key === "Escape") api.send({ kind: "close" });
        else if (event.target.tagName === "SELECT") return;
        else if (target !== void 0) moveTo(target);
        else if (event.key === "Enter" && event.target.classList.contains("pd-sample"))
          api.send({ kind: "adopt", value: Number(event.target.dataset.index) });
        else return;
        event.preventDefault();
        event.stopPropagation();
      });
      strip.addEventListener("focusout", (event) => {
        if (!strip.contains(event.relatedTarget) && !strip.matches(":hover")) point(null);
      });
      function fill(select, options, value) {
        const text = JSON.stringify(options);
        if (select.dataset.options !== text) {
          select.dataset.options = text;
          select.replaceChildren(...options.map((one) => make("option", "", { value: String(one.value) }, one.text)));
        }
        select.value = String(value);
      }
      function cardOf({ index, rank, isAdopted, lines, hint: hint2 }) {
        const box = make("div", "pd-sample-box");
        const card = make("div", "pd-sample", {
          role: "option",
          tabindex: "-1",
          "aria-selected": String(isAdopted),
          "aria-label": `Sample ${index + 1}`,
          title: hint2
        });
        card.dataset.index = String(index);
        const picture = make("img", "", { alt: "", draggable: "false" });
        if (pictures[index]) picture.src = pictures[index];
        const name = make("div", "pd-sample-name");
        name.append(
          make("span", "", {}, `Sample ${index + 1}`),
          make(
            "span",
            "pd-sample-rank",
            {},
            isAdopted ? `in use · ${rank}.` : `${rank}.`
          )
        );
        card.append(picture, name, ...lines.map(({ text, tone }) => make("div", tone ? `pd-sample-line pd-${tone}` : "pd-sample-line", {}, text)));
        card.addEventListener("pointerenter", () => point(index));
        card.addEventListener("click", () => {
          cursor = index;
          api.send({ kind: "adopt", value: index });
        });
        const keep = make("button", "pd-sample-keep", {
          type: "button",
          tabindex: "-1",
          "aria-label": `Use sample ${index + 1} and put it into the basket`,
          title: "Use it and put it into the basket"
        }, "☆");
        keep.addEventListener("click", () => api.send({ kind: "keep", value: index }));
        box.append(card, keep);
        if (!isAdopted) {
          const pair = make("button", "pd-sample-keep pd-sample-pair", {
            type: "button",
            tabindex: "-1",
            "aria-label": `Compare sample ${index + 1} with the one in use`,
            title: "Side by side with the sample in use"
          }, "◫");
          pair.addEventListener("click", () => api.send({ kind: "pair", value: index }));
          box.append(pair);
        }
        return box;
      }
      redraw = () => {
        strip.hidden = !state.isOpen;
        api.root.classList.toggle("pd-shows-samples", Boolean(state.isOpen));
        if (!state.isOpen) {
          pointed = cursor = shownInUse = null;
          return;
        }
        const hadFocus = list.contains(document.activeElement);
        title.textContent = `${pictures.length} samples`;
        fill(ranking, state.rankings, state.ranking);
        fill(pick, state.picks, state.pick);
        list.replaceChildren(...state.cards.map(cardOf));
        const all = cards();
        const current = all.find((one) => Number(one.dataset.index) === cursor) ?? all.find((one) => one.getAttribute("aria-selected") === "true") ?? all[0];
        if (!current) return;
        current.tabIndex = 0;
        const inUse = state.cards.find((one) => one.isAdopted)?.index ?? null;
        if (inUse !== shownInUse) {
          shownInUse = inUse;
          all.find((one) => Number(one.dataset.index) === inUse)?.scrollIntoView(
            { block: "nearest", inline: "nearest" }
          );
        }
        if (state.takesFocus || hadFocus) moveTo(all.indexOf(current));
      };
      return (next) => {
        state = next;
        redraw();
      };
    });
    pdOverlay.define("sample-pictures", () => (state) => {
      pictures = state.pictures;
      redraw();
    });
  })();

  // src/elements/scorecard.js
  (() => {
    const SVG = "http://www.w3.org/2000/svg";
    const WIDTH = 276;
    const HEIGHT = 66;
    const TOP = 8;
    const LEFT = 30;
    const SHAPES = { usual: "●", unusual: "▲", extreme: "■" };
    const COLORS = ["var(--pd-line-1)", "var(--pd-line-2)", "var(--pd-line-3)"];
    let showTime = () => {
    };
    let setCharts = () => {
    };
    pdOverlay.define("scorecard", (api) => {
      const { make } = api;
      const drawer = make("div", "pd-solid pd-agents pd-score", {
        role: "region",
        "aria-label": "Scorecard"
      });
      drawer.hidden = true;
      const head = make("div", "pd-agents-head");
      head.append(make("b", "pd-score-title", {}, "Scorecard"));
      const close = make("button", "pd-close", {
        type: "button",
        "aria-label": "Close the scorecard",
        title: "Close (I)"
      }, "×");
      const send = (event) => api.send({
        ...event,
        covered: (drawer.offsetLeft + drawer.offsetWidth) / Math.max(api.box.parentElement.offsetWidth, 1)
      });
      close.addEventListener("click", () => send({ kind: "close" }));
      head.append(close);
      const columns = make("div", "pd-score-row pd-score-head");
      for (const [name, text] of [
        ["dot", ""],
        ["name", "Motor vehicles"],
        ["value", "scene"],
        ["usual", "usual"]
      ])
        columns.append(make("span", `pd-score-${name}`, {}, text));
      columns.title = "Usual: 5 to 95 % of recorded scenes";
      const list = make("div", "pd-score-rows", { role: "list" });
      const charts = make("div", "pd-charts");
      const foot = make("label", "pd-score-draw");
      const draws = make("input", "", { type: "checkbox" });
      draws.addEventListener("change", () => send({ kind: "draw", value: draws.checked }));
      foot.append(draws, make("span", "", {}, "Draw findings in the scene"));
      drawer.append(head, columns, list, foot, charts);
      api.box.append(drawer);
      function shape(name, attributes) {
        const element = document.createElementNS(SVG, name);
        for (const [key, value] of Object.entries(attributes))
          element.setAttribute(key, String(value));
        return element;
      }
      function chart(title, lines, time, ids) {
        const known = lines.flat().filter((value) => value !== null);
        if (!known.length) return null;
        const low = Math.min(0, ...known);
        const high = Math.max(low + 1, ...known);
        const x = (t) => LEFT + (t - time[0]) / (time.at(-1) - time[0] || 1) * (WIDTH - LEFT - 4);
        const y = (v) => TOP + (1 - (v - low) / (high - low)) * (HEIGHT - TOP - 4);
        const svg = shape("svg", {
          viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
          role: "img",
          "aria-label": `${title} of ${ids.join(", ")}`
        });
        for (const value of low < 0 ? [low, 0, high] : [low, high]) {
          svg.append(shape("line", {
            x1: LEFT,
            x2: WIDTH - 4,
            y1: y(value),
            y2: y(value),
            class: "pd-chart-grid"
          }));
          if (value === 0 && low < 0 && Math.min(y(low) - y(0), y(0) - y(high)) < 11) continue;
          const text = shape("text", { x: LEFT - 4, y: y(value) + 3.5, class: "pd-chart-text" });
          const shown = Math.abs(value) >= 100 ? value.toFixed(0) : value.toFixed(1);
          text.textContent = value === 0 ? "0" : shown.replace("-", "−");
          svg.append(text);
        }
        lines.forEach((line, index) => {
          let path = "";
          let isDrawing = false;
          line.forEach((value, step2) => {
            if (value === null) isDrawing = false;
            else {
              path += `${isDrawing ? "L" : "M"}${x(time[step2]).toFixed(1)} ${y(value).toFixed(1)}`;
              isDrawing = true;
            }
          });
          const drawn = shape("path", { d: path, class: "pd-chart-line" });
          drawn.style.stroke = COLORS[index];
          svg.append(drawn);
        });
        const playhead = shape("line", { y1: TOP - 4, y2: HEIGHT - 2, class: "pd-chart-head" });
        svg.append(playhead);
        const box = make("div", "pd-chart");
        const values = lines.map((_, index) => {
          const value = make("span", "pd-chart-value");
          value.style.color = COLORS[index];
          return value;
        });
        const heading = make("div", "pd-chart-title", {}, title);
        heading.append(...values);
        box.append(heading, svg);
        const step = (time.at(-1) - time[0]) / Math.max(time.length - 1, 1) || 1;
        return { box, move: (t) => {
          playhead.setAttribute("x1", x(t));
          playhead.setAttribute("x2", x(t));
          const at = Math.min(Math.max(Math.round((t - time[0]) / step), 0), time.length - 1);
          lines.forEach((line, index) => {
            const value = line[at];
            const text = value === null ? "–" : value.toFixed(1).replace("-", "−");
            if (values[index].textContent !== text) values[index].textContent = text;
          });
        } };
      }
      let moves = [];
      let now = 0;
      showTime = (t) => {
        now = t;
        if (!drawer.hidden) for (const move of moves) move(t);
      };
      setCharts = (state) => {
        const made = state.charts.map(({ title, lines }) => chart(title, lines, state.time, state.ids)).filter((one) => one !== null);
        moves = made.map((one) => one.move);
        const legend = make("div", "pd-chart-legend");
        state.ids.forEach((id, index) => {
          const name = make("span", "", { title: id }, id);
          name.style.setProperty("--line", COLORS[index]);
          legend.append(name);
        });
        const empty = make(
          "div",
          "pd-score-note",
          {},
          "Select up to three agents to see speed, acceleration and gap."
        );
        charts.replaceChildren(...made.length ? [legend, ...made.map((one) => one.box)] : [empty]);
        showTime(now);
      };
      api.listen(window, "pd-playhead", (event) => showTime(event.detail));
      function rowOf(row) {
        const item = make("button", "pd-score-row", {
          type: "button",
          title: row.where ? `${row.meaning} The worst: ${row.where}` : `${row.meaning} No agent stands out`,
          "aria-label": `${row.title}: ${row.value}, ${row.level}; usual ${row.usual}`,
          "aria-expanded": String(Boolean(row.findings))
        });
        item.disabled = !row.where;
        const name = make("span", "pd-score-name", {}, row.title);
        if (row.mark) name.append(make("i", `pd-score-mark pd-score-${row.mark}`, {}));
        item.append(
          make(
            "span",
            `pd-score-dot pd-${row.tone}`,
            { "aria-hidden": "true" },
            SHAPES[row.level]
          ),
          name,
          make("span", "pd-score-value", {}, row.value),
          make("span", "pd-score-usual", {}, row.usual)
        );
        item.addEventListener("click", () => send({ kind: "row", name: row.name }));
        return item;
      }
      function detail(row, state) {
        const box = make("div", "pd-score-detail", {
          role: "group",
          "aria-label": `Findings: ${row.title}`
        });
        for (const { id, agent, text, time, isChosen } of row.findings) {
          const item = make("button", "pd-score-finding", {
            type: "button",
            title: `${agent} ${text}, ${time}`,
            "aria-current": String(isChosen)
          });
          item.append(
            make("b", "", {}, agent),
            make("span", "pd-score-text", {}, text),
            make("span", "pd-score-time", {}, time)
          );
          item.addEventListener("click", () => send({ kind: "finding", id }));
          box.append(item);
          if (isChosen && (state.isSearching || state.cures.length)) {
            const cures = make("div", "pd-score-cures");
            if (state.isSearching) cures.append(make("span", "pd-score-note", {}, "Looking for repairs ..."));
            for (const label of state.cures) {
              const cure = make("button", "", { type: "button" }, label);
              cure.addEventListener("click", () => send({ kind: "cure", name: label }));
              cures.append(cure);
            }
            box.append(cures);
          }
        }
        if (row.more) box.append(make("div", "pd-score-note", {}, `and ${row.more} more`));
        return box;
      }
      return (state) => {
        drawer.hidden = !state.isOpen;
        if (!state.isOpen) return;
        draws.checked = state.draws;
        list.replaceChildren(...state.rows.flatMap((row) => row.findings ? [rowOf(row), detail(row, state)] : [rowOf(row)]));
      };
    });
    pdOverlay.define("charts", () => (state) => setCharts(state));
  })();

  // src/elements/status.js
  pdOverlay.define("status", (api) => {
    const { make } = api;
    const SVG = "http://www.w3.org/2000/svg";
    const ICONS = {
      collision: "M2 6h6v5H2zM9 4l6-1 1 5-6 1zM11.5 11.5l1 2M14 11l2 1M9 12.5l-1 2",
      road: "M6 2 3 16M12 2l3 14M9 3v3M9 8v3M9 13v3",
      speed: "M3 13a7 7 0 1 1 12 0M9 12l4-5",
      against: "M6 15V3M3 6l3-3 3 3M12 3v12M9 12l3 3 3-3",
      goal: "M5 16V3h8l-2 3 2 3H5",
      beyond: "M5 2 3 16M11 2l2 14M8 3v2M8 7v1M5 11h6M15 5l2 3-2 3",
      past: "M9 4v5l3 2M3 9a6 6 0 1 0 2-4.5M3 3v3h3",
      bend: "M4 16c0-7 10-4 10-13M8 16c0-5 10-3 10-13"
    };
    const isFolded = { new: false, notices: true, ignored: true, recorded: true };
    let isOpen = false;
    let state = { groups: [], active: null };
    const button = (parent, className, label, action) => {
      const element = make("button", className, { type: "button" }, label);
      element.addEventListener("click", action);
      parent.appendChild(element);
      return element;
    };
    const unsaved = make("div", "pd-solid pd-unsaved", { role: "alert" });
    const unsavedText = make("span", "pd-clipped");
    unsaved.appendChild(unsavedText);
    button(unsaved, "pd-strong", "Download", () => api.send({ kind: "download" }));
    const list = make("div", "pd-solid pd-problems", {
      role: "dialog",
      "aria-label": "Problems"
    });
    const rows = make("div", "pd-problem-rows");
    const detail = make("div", "pd-problem-detail");
    const sentence = make("div", "pd-problem-sentence", { role: "status" });
    const cures = make("div", "pd-problem-cures");
    detail.append(sentence, cures);
    list.append(rows, detail);
    const chip = make("div", "pd-solid pd-chip");
    const main = button(chip, "pd-chip-main", "", () => {
      toggle(!isOpen);
    });
    const dot = make("span", "pd-dot");
    const text = make("span", "pd-clipped", { role: "status", "aria-label": "Status" });
    const caret = make("span", "pd-caret", {}, "▴");
    main.append(dot, text, caret);
    const use = button(chip, "pd-strong", "", () => api.send({ kind: "use" }));
    const cancel = button(chip, "pd-strong", "Cancel", () => api.send({ kind: "cancel" }));
    const bar = make("div", "pd-progress", {
      role: "progressbar",
      "aria-label": "Progress",
      "aria-valuemin": "0",
      "aria-valuemax": "100"
    });
    chip.appendChild(bar);
    api.box.append(list, unsaved, chip);
    const free = () => {
      const whole = api.root.getBoundingClientRect();
      if (!isOpen || !whole.width) return 1;
      const share = (list.getBoundingClientRect().left - whole.left) / whole.width;
      return Math.min(Math.max(share, 0), 1);
    };
    const choose = (id) => api.send({ kind: "choose", value: id, free: free() });
    let mostLines = 0;
    function fit() {
      mostLines = Math.max(mostLines, rows.childElementCount);
      list.style.setProperty("--pd-lines", mostLines);
    }
    function toggle(wanted) {
      const wasOpen = isOpen;
      isOpen = wanted;
      list.hidden = !isOpen;
      if (!wasOpen) mostLines = 0;
      fit();
      if (isOpen !== wasOpen) api.send({ kind: "list", isOpen, free: free() });
      api.root.classList.toggle("pd-lists-problems", isOpen);
      main.setAttribute("aria-expanded", String(isOpen));
      caret.textContent = isOpen ? "▾" : "▴";
    }
    function icon(name) {
      const svg = document.createElementNS(SVG, "svg");
      svg.setAttribute("viewBox", "0 0 18 18");
      svg.setAttribute("aria-hidden", "true");
      const path = document.createElementNS(SVG, "path");
      path.setAttribute("d", ICONS[name] ?? ICONS.collision);
      svg.appendChild(path);
      return svg;
    }
    let drawn = "";
    function drawRows() {
      const wanted = JSON.stringify([state.groups, isFolded]);
      if (wanted !== drawn) {
        drawn = wanted;
        const top = rows.scrollTop;
        const focused = document.activeElement?.dataset?.problem;
        const parts = [];
        for (const group of state.groups) {
          if (group.name !== "new" && !group.rows.length) continue;
          const head = make("button", "pd-problem-group", {
            type: "button",
            "aria-expanded": String(!isFolded[group.name])
          }, group.title);
          head.addEventListener("click", () => {
            isFolded[group.name] = !isFolded[group.name];
            drawRows();
          });
          parts.push(head);
          if (isFolded[group.name]) continue;
          for (const row of group.rows) {
            const item = make("button", "pd-problem-row", { type: "button", title: row.hint });
            item.dataset.problem = row.id;
            item.dataset.severity = row.severity;
            item.append(
              icon(row.icon),
              make("span", "pd-clipped", {}, row.text),
              make("span", "pd-problem-time", {}, row.time)
            );
            item.addEventListener("click", () => choose(row.id));
            parts.push(item);
          }
          if (group.more)
            parts.push(make("div", "pd-problem-more", {}, `... and ${group.more} more`));
        }
        rows.replaceChildren(...parts);
        detail.hidden = !rows.querySelector("[data-problem]");
        if (isOpen) fit();
        rows.scrollTop = top;
        if (focused)
          [...rows.querySelectorAll(".pd-problem-row")].find((item) => item.dataset.problem === focused)?.focus({ preventScroll: true });
      }
      for (const item of rows.querySelectorAll(".pd-problem-row"))
        item.setAttribute(
          "aria-current",
          String(item.dataset.problem === state.active?.id)
        );
    }
    api.listen(api.box, "keydown", (event) => {
      if (event.key !== "Escape" || !isOpen) return;
      toggle(false);
      main.focus();
      event.stopPropagation();
    });
    const pageful = () => Math.max(1, Math.floor(rows.clientHeight / 28) - 1);
    api.listen(api.box, "keydown", (event) => {
      if (!isOpen || event.ctrlKey || event.metaKey || event.altKey) return;
      const step = {
        ArrowDown: 1,
        ArrowUp: -1,
        PageDown: pageful(),
        PageUp: -pageful(),
        Home: -Infinity,
        End: Infinity
      }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      const all = [...rows.querySelectorAll(".pd-problem-row")];
      if (!all.length) return;
      const at = all.findIndex((item) => item === document.activeElement);
      const begin = at < 0 ? all.findIndex((item) => item.dataset.problem === state.active?.id) : at;
      const next = all[Math.min(Math.max(begin + step, 0), all.length - 1)];
      next.focus();
      next.scrollIntoView({ block: "nearest" });
      choose(next.dataset.problem);
    });
    toggle(false);
    let drawnCures = "";
    let numClosed = 0;
    return (next) => {
      if (next.numClosed > numClosed) toggle(false);
      numClosed = next.numClosed;
      const isCuring = cures.contains(document.activeElement);
      const place = [...rows.querySelectorAll(".pd-problem-row")].findIndex(
        (item) => item.dataset.problem === state.active?.id
      );
      state = next;
      chip.dataset.tone = next.tone;
      if (text.textContent !== next.text) text.textContent = next.text;
      text.title = next.text;
      cancel.hidden = next.fraction === null;
      use.hidden = !next.action;
      use.textContent = next.action;
      caret.hidden = !cancel.hidden || !use.hidden;
      bar.hidden = next.fraction === null;
      bar.style.width = `${100 * (next.fraction ?? 0)}%`;
      bar.setAttribute("aria-valuenow", String(Math.round(100 * (next.fraction ?? 0))));
      unsaved.hidden = !next.unsaved;
      unsavedText.textContent = next.unsaved;
      unsavedText.title = next.unsaved;
      api.box.classList.toggle("pd-has-unsaved", Boolean(next.unsaved));
      drawRows();
      const active = next.active;
      const wanted = JSON.stringify(active);
      if (wanted !== drawnCures) {
        drawnCures = wanted;
        sentence.textContent = active ? [active.message, active.note].filter(Boolean).join(" ") : "Choose a row to see it and what helps.";
        cures.replaceChildren();
        for (const label of active?.cures ?? [])
          button(cures, "pd-strong", label, () => api.send({ kind: "cure", value: label }));
        if (active?.ignore)
          button(cures, "pd-quiet", active.ignore, () => api.send({ kind: "ignore" }));
        const all = [...rows.querySelectorAll(".pd-problem-row")];
        if (isCuring && isOpen)
          (all.find((item) => item.dataset.problem === active?.id) ?? all[Math.min(Math.max(place, 0), all.length - 1)] ?? main).focus({ preventScroll: true });
      }
    };
  });

  // src/elements/timeline.js
  (() => {
    const SVG = "http://www.w3.org/2000/svg";
    const SCRUB_PAUSE_MS = 40;
    const KEYS = { ArrowLeft: -1, ArrowRight: 1 };
    let axis = { firstStep: -50, lastStep: 59, beginStep: -50, endStep: 59, stepS: 0.1 };
    let head = { step: 0, isPlaying: false, speed: 1, loops: true };
    let since = performance.now();
    let isScrubbing = false;
    let drawAxis = () => {
    };
    let drawHead = () => {
    };
    const seconds = (step) => step * axis.stepS;
    const clamped = (step) => Math.min(Math.max(step, axis.firstStep), axis.lastStep);
    const inWords = (step) => `${step < -0.05 ? "−" : ""}${Math.abs(seconds(step)).toFixed(1)} s`;
    function stepAt(time) {
      if (!head.isPlaying) return head.step;
      const run = (time - since) / 1e3 / axis.stepS * head.speed;
      const step = head.step + run;
      if (step <= axis.endStep) return step;
      const length = axis.endStep - axis.beginStep;
      if (!head.loops || length <= 0) return axis.endStep;
      return axis.beginStep + (step - axis.endStep) % length;
    }
    pdOverlay.playhead = () => stepAt(performance.now());
    function icon(...shapes) {
      const svg = document.createElementNS(SVG, "svg");
      svg.setAttribute("viewBox", "0 0 16 16");
      svg.setAttribute("width", "16");
      svg.setAttribute("height", "16");
      for (const [path, isLine] of shapes) {
        const shape = document.createElementNS(SVG, "path");
        shape.setAttribute("d", path);
        shape.setAttribute("fill", isLine ? "none" : "currentColor");
        if (isLine) {
          shape.setAttribute("stroke", "currentColor");
          shape.setAttribute("stroke-width", "1.6");
        }
        svg.appendChild(shape);
      }
      return svg;
    }
    pdOverlay.define("timeline", (api) => {
      const { make } = api;
      const bar = make("div", "pd-solid pd-timeline-bar", {
        role: "group",
        "aria-label": "Timeline"
      });
      const button = (name, title, event) => {
        const element = make("button", "", { type: "button", "aria-label": name, title });
        element.addEventListener("click", () => api.send(event));
        bar.appendChild(element);
        return element;
      };
      const play = button("Play", "Play or pause (Space)", { kind: "play" });
      const playIcon = icon(["M4 2.5v11l9.5-5.5z"]);
      const pauseIcon = icon(["M3.5 2.5h3v11h-3z"], ["M9.5 2.5h3v11h-3z"]);
      const current = button("t = 0", "Go to t = 0, where edits act", { kind: "current" });
      current.textContent = "t = 0";
      const shown = make("output", "pd-time", { "aria-label": "Time shown" });
      bar.appendChild(shown);
      const track = make("div", "pd-track", {
        role: "slider",
        "aria-label": "Time",
        "aria-orientation": "horizontal"
      });
      const lane = make("div", "pd-lane");
      const past = make("div", "pd-past");
      const future = make("div", "pd-future");
      lane.append(past, future);
      const scale = make("div", "pd-scale");
      const knob = make("div", "pd-knob");
      const problems = make("div", "pd-marks");
      const hint = make("div", "pd-solid pd-mark-hint", { role: "tooltip" });
      hint.hidden = true;
      track.append(lane, scale, knob, problems, hint);
      bar.appendChild(track);
      const speed = button("Speed", "Speed of playback", { kind: "speed" });
      speed.classList.add("pd-speed");
      const loop = button("Loop", "Begin again at the end", { kind: "loop" });
      loop.appendChild(icon(
        ["M4.5 5h6.2a2.8 2.8 0 0 1 0 6H4.8a2.8 2.8 0 0 1-2.6-3.8", true],
        ["M6.5 1.8v6.4L2.8 5z"]
      ));
      api.box.appendChild(bar);
      const share = (step) => 100 * (clamped(step) - axis.firstStep) / Math.max(axis.lastStep - axis.firstStep, 1);
      drawAxis = () => {
        const zero = share(0);
        past.style.width = `${zero}%`;
        future.style.left = `${zero}%`;
        future.style.width = `${share(axis.endStep) - zero}%`;
        const perSecond = 1 / axis.stepS;
        const first = Math.ceil(seconds(axis.firstStep) - 1e-6);
        const last = Math.floor(seconds(axis.lastStep) + 1e-6);
        const every = Math.max(1, Math.ceil((last - first) / 24));
        const marks = [];
        for (let second = first; second <= last; second += 1) {
          if (second % every !== 0) continue;
          const mark = make("div", second === 0 ? "pd-second pd-zero" : "pd-second");
          mark.style.left = `${share(second * perSecond)}%`;
          mark.appendChild(make("span", "", {}, String(second).replace("-", "−")));
          marks.push(mark);
        }
        scale.replaceChildren(...marks);
        track.setAttribute("aria-valuemin", seconds(axis.firstStep).toFixed(1));
        track.setAttribute("aria-valuemax", seconds(axis.lastStep).toFixed(1));
      };
      function drawMarks(marks) {
        hint.hidden = true;
        problems.replaceChildren(...marks.map(({ kind, step, text }) => {
          const what = kind === "finding" ? "Finding" : "Problem";
          const mark = make("button", `pd-mark pd-${kind}`, {
            type: "button",
            "aria-label": `${what} at ${inWords(step)}`
          });
          mark.style.left = `${share(step)}%`;
          mark.addEventListener("pointerdown", (event) => event.stopPropagation());
          mark.addEventListener("click", () => api.send({ kind, value: step }));
          mark.addEventListener("pointerenter", () => {
            hint.textContent = text;
            hint.hidden = false;
            const part = share(step) / 100;
            const half = hint.offsetWidth / 2;
            const at = Math.min(
              Math.max(part * track.offsetWidth, half - 90),
              track.offsetWidth - half + 90
            );
            hint.style.left = `${at}px`;
          });
          mark.addEventListener("pointerleave", () => {
            hint.hidden = true;
          });
          return mark;
        }));
      }
      let wasPlaying = null;
      let drawnMarks = "";
      drawHead = (step) => {
        window.dispatchEvent(new CustomEvent("pd-playhead", { detail: seconds(step) }));
        knob.style.left = `${share(step)}%`;
        const words = inWords(step);
        if (shown.textContent !== words) {
          shown.textContent = words;
          track.setAttribute("aria-valuenow", seconds(step).toFixed(1));
          track.setAttribute("aria-valuetext", words);
        }
        if (wasPlaying !== head.isPlaying) {
          wasPlaying = head.isPlaying;
          play.setAttribute("aria-label", head.isPlaying ? "Pause" : "Play");
          play.replaceChildren(head.isPlaying ? pauseIcon : playIcon);
        }
        speed.textContent = `${head.speed}×`;
        loop.setAttribute("aria-pressed", String(head.loops));
      };
      let sent = null;
      let sentAt = 0;
      let late = null;
      function tell(step) {
        clearTimeout(late);
        const wait = sentAt + SCRUB_PAUSE_MS - performance.now();
        if (step === sent) return;
        if (wait > 0) {
          late = setTimeout(() => tell(step), wait);
          return;
        }
        sent = step;
        sentAt = performance.now();
        api.send({ kind: "seek", value: step });
      }
      function scrub(event) {
        const box = track.getBoundingClientRect();
        const part = (event.clientX - box.left) / Math.max(box.width, 1);
        const step = clamped(
          Math.round(axis.firstStep + part * (axis.lastStep - axis.firstStep))
        );
        head = { ...head, step, isPlaying: false };
        drawHead(step);
        tell(step);
      }
      track.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        isScrubbing = true;
        sent = null;
        track.setPointerCapture(event.pointerId);
        scrub(event);
      });
      track.addEventListener("pointermove", (event) => {
        if (isScrubbing) scrub(event);
      });
      for (const type of ["pointerup", "pointercancel"])
        track.addEventListener(type, () => {
          isScrubbing = false;
        });
      api.listen(window, "keydown", (event) => {
        const steps = KEYS[event.key];
        if (!steps || event.ctrlKey || event.metaKey || event.altKey) return;
        const at = event.target;
        if (at?.closest?.("input, textarea, select, [contenteditable], [role=slider], [role=tab], [role=option], [role=dialog]")) return;
        event.preventDefault();
        event.stopPropagation();
        api.send({ kind: "step", value: steps * (event.shiftKey ? 10 : 1) });
      }, { capture: true });
      let isAlive = true;
      api.onDispose(() => {
        isAlive = false;
      });
      (function run() {
        if (!isAlive) return;
        if (head.isPlaying && !isScrubbing) drawHead(stepAt(performance.now()));
        requestAnimationFrame(run);
      })();
      drawAxis();
      drawHead(head.step);
      return (state) => {
        axis = state;
        drawAxis();
        const marks = JSON.stringify(state);
        if (marks !== drawnMarks) {
          drawnMarks = marks;
          drawMarks(state.marks);
        }
        drawHead(stepAt(performance.now()));
      };
    });
    pdOverlay.define("playhead", () => (state) => {
      if (isScrubbing) return;
      const now = performance.now();
      const gap = state.step - stepAt(now);
      const isRun = state.isPlaying && head.isPlaying && state.speed === head.speed;
      const step = isRun && Math.abs(gap) < 3 ? state.step - 0.7 * gap : state.step;
      head = { ...state, step };
      since = now;
      drawHead(step);
    });
  })();

  // src/elements/toolbar.js
  pdOverlay.define("toolbar", (api) => {
    const PATHS = {
      undo: "M7 4 3 8l4 4M3.5 8H12a4.5 4.5 0 0 1 0 9H8",
      redo: "M13 4l4 4-4 4M16.5 8H8a4.5 4.5 0 0 0 0 9h4",
      "3d": "M10 2.5 17 6v8l-7 3.5L3 14V6zM3 6l7 3.5L17 6M10 9.5v8",
      top: "M2.5 5 7.5 3l5 2 5-2v12l-5 2-5-2-5 2zM7.5 3v12M12.5 5v12",
      fit: "M3 9.5 10 3.5l7 6M5 8v8.5h10V8M8.2 16.5v-5h3.6v5",
      frame: "M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4M7.5 8.5h5v3h-5z",
      measure: "M2.5 13.5l11-11 4 4-11 11zM5.5 10.5l1.6 1.6M8 8l2.3 2.3M10.5 5.5l1.6 1.6",
      place: "M10 3.5v13M3.5 10h13",
      agents: "M3 5h2M8 5h9M3 10h2M8 10h9M3 15h2M8 15h9",
      scorecard: "M3 16.5V10h3.5v6.5M8.2 16.5V4h3.5v12.5M13.5 16.5V7.5H17v9",
      compare: "M10 3v14M8 5.5H3.5v9H8M12 5.5h4.5v9H12",
      live: "M2 10h3.5l2-5.5 4 11 2.5-7.5 1.2 2H18",
      help: "M7.2 7.4a2.8 2.8 0 1 1 4.4 2.3c-1 .7-1.6 1.2-1.6 2.5M10 15.2v.4"
    };
    const bar = api.make("div", "pd-solid pd-bar", {
      role: "toolbar",
      "aria-label": "Tools"
    });
    api.box.append(bar);
    const buttons = /* @__PURE__ */ new Map();
    function draw(icon) {
      const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      svg.setAttribute("viewBox", "0 0 20 20");
      svg.setAttribute("aria-hidden", "true");
      const path = document.createElementNS(svg.namespaceURI, "path");
      path.setAttribute("d", PATHS[icon]);
      svg.append(path);
      return svg;
    }
    function add(tool) {
      const button = api.make("button", tool.startsGroup ? "pd-group" : "", {
        type: "button"
      });
      button.append(draw(tool.icon));
      if (tool.isHeld) {
        const release = () => api.send({ kind: "release", icon: tool.icon });
        button.addEventListener("pointerdown", (event) => {
          button.setPointerCapture(event.pointerId);
          api.send({ kind: "press", icon: tool.icon });
        });
        button.addEventListener("lostpointercapture", release);
        button.addEventListener("keydown", (event) => {
          if (event.key === "Enter" && !event.repeat)
            api.send({ kind: "press", icon: tool.icon });
        });
        button.addEventListener("keyup", (event) => {
          if (event.key === "Enter") release();
        });
      } else {
        button.addEventListener("click", () => api.send({ kind: "press", icon: tool.icon }));
      }
      bar.append(button);
      buttons.set(tool.icon, button);
    }
    return ({ tools }) => {
      for (const tool of tools) {
        if (!buttons.has(tool.icon)) add(tool);
        const button = buttons.get(tool.icon);
        button.setAttribute("aria-label", tool.hint);
        button.dataset.hint = tool.hint;
        button.setAttribute("aria-pressed", String(tool.isActive));
        button.setAttribute("aria-disabled", String(!tool.isEnabled));
      }
    };
  });

  // src/elements/tooltip.js
  pdOverlay.define("tooltip", (api) => {
    const REST_MS = 400;
    const STILL_PX = 3;
    const GAP_PX = 14;
    const tip = api.make("div", "pd-tip", { role: "tooltip" });
    tip.hidden = true;
    api.box.appendChild(tip);
    let at = null;
    let timer = null;
    let asks = 0;
    let agent = null;
    function tell(next) {
      if (next === agent) return;
      agent = next;
      window.dispatchEvent(new CustomEvent("pd-agent-under-pointer", { detail: agent }));
    }
    function hide() {
      clearTimeout(timer);
      tip.hidden = true;
      tell(null);
      asks += 1;
    }
    function ask() {
      const ray = at && api.ray(...at);
      if (!ray) return;
      asks += 1;
      api.send({ kind: "rest", at, ray, ask: asks });
    }
    api.listen(window, "pointermove", (event) => {
      const isOver = api.isOnPicture(event) && event.buttons === 0;
      const now = isOver ? api.local(event) : null;
      if (now && at && Math.hypot(now[0] - at[0], now[1] - at[1]) <= STILL_PX) return;
      hide();
      at = now;
      if (now) timer = setTimeout(ask, REST_MS);
    }, { capture: true, passive: true });
    for (const type of ["pointerdown", "wheel", "keydown", "blur"])
      api.listen(window, type, hide, { capture: true, passive: true });
    api.onView(hide);
    return ({ at: point, lines, agent: under, asked }) => {
      if (asked !== asks || !lines.length) return;
      tip.replaceChildren(...lines.map((line) => api.make("div", "", {}, line)));
      tip.hidden = false;
      tell(under);
      const { clientWidth, clientHeight } = api.canvas();
      const left = Math.min(point[0] + GAP_PX, clientWidth - tip.offsetWidth - 8);
      const below = point[1] + GAP_PX;
      const fits = below + tip.offsetHeight + 64 < clientHeight;
      tip.style.left = `${Math.max(left, 8)}px`;
      tip.style.top = `${fits ? below : point[1] - tip.offsetHeight - GAP_PX}px`;
    };
  });

  // src/elements/view.js
  pdOverlay.define("view", (api) => {
    const PAN_KEY = "KeyH";
    const MAX_POLAR = 85 * Math.PI / 180;
    const LIMITS = { top: [80, 9900], space: [4, 1500] };
    const MAX_REACH = 8;
    const CAMERA_KEYS = /^(Key[WASDQE]|Arrow(Up|Down|Left|Right))$/;
    let isTop = null;
    let known = null;
    let isPanKeyHeld = false;
    let pan = null;
    let hasPanned = false;
    const world = () => api.viewer()?.nodeRefFromName?.[""] ?? null;
    function controls() {
      const found = api.viewer()?.cameraControl ?? null;
      if (!found || !world()) return null;
      const isCapable = ["getPosition", "getTarget", "setLookAt"].every(
        (name) => typeof found[name] === "function"
      );
      return isCapable ? found : null;
    }
    function configure() {
      const found = controls();
      if (!found || isTop === null) return;
      known = found;
      window.__viserTestpoints?.devSettings?.set?.({ enableOrbitCrosshair: false });
      const none = found.constructor?.ACTION?.NONE ?? 0;
      const rotate = found.constructor?.ACTION?.ROTATE ?? 1;
      found.azimuthRotateSpeed = isTop ? 0 : 1;
      found.polarRotateSpeed = isTop ? 0 : 1;
      found.maxPolarAngle = isTop ? Math.PI : MAX_POLAR;
      if (found.mouseButtons) {
        found.mouseButtons.left = isTop ? none : rotate;
        found.mouseButtons.right = none;
        found.mouseButtons.middle = none;
      }
    }
    function pose(found, atEnd) {
      const node = world();
      const position = api.viewer().camera.position.clone();
      const target = position.clone();
      found.getPosition(position, atEnd);
      found.getTarget(target, atEnd);
      node.worldToLocal(position);
      node.worldToLocal(target);
      return { position, target };
    }
    function look(found, { position, target }, isSmooth) {
      const node = world();
      const from = node.localToWorld(position.clone());
      const to = node.localToWorld(target.clone());
      found.setLookAt(from.x, from.y, from.z, to.x, to.y, to.z, isSmooth);
    }
    const isOnLayer = (event) => event.target?.closest?.(".pd-picture") ?? false;
    const isOnView = (event) => api.isOnPicture(event) || isOnLayer(event);
    function zoom(event) {
      const found = controls();
      if (!found || !isOnView(event)) return;
      event.preventDefault();
      event.stopPropagation();
      if (!found.enabled) return;
      const lines = event.deltaMode === 1 ? 16 : 1;
      const rate = event.ctrlKey ? 0.01 : 18e-4;
      let factor = Math.exp(Math.max(-0.6, Math.min(0.6, event.deltaY * lines * rate)));
      const now = pose(found, true);
      const offset = now.position.clone().sub(now.target);
      const distance = offset.length();
      const [nearest, farthest] = isTop ? LIMITS.top : LIMITS.space;
      const wanted = Math.max(nearest, Math.min(farthest, distance * factor));
      factor = wanted / distance;
      const center = now.target.clone();
      const point = api.ground(...api.local(event));
      if (point) {
        const across = center.clone().set(point[0], point[1], 0).sub(now.target);
        if (!isTop && across.length() > 3 * distance) across.setLength(3 * distance);
        center.add(across);
      }
      for (const vector of [now.position, now.target])
        vector.sub(center).multiplyScalar(factor).add(center);
      look(found, now, true);
    }
    function reach(event, camera) {
      const point = api.ground(...api.local(event));
      if (!point) return null;
      const across = [point[0] - camera.x, point[1] - camera.y];
      const length = Math.hypot(...across);
      const longest = MAX_REACH * Math.max(camera.z, 1);
      if (length <= longest) return across;
      return across.map((value) => value * longest / length);
    }
    function startPan(event) {
      if (pan) return;
      hasPanned = false;
      if (!isOnView(event)) return;
      const isKeyed = event.button === 0 && (isPanKeyHeld || isOnLayer(event));
      if (event.button !== 1 && event.button !== 2 && !isKeyed) return;
      const found = controls();
      if (!found || !found.enabled) return;
      if (event.button !== 2) {
        event.preventDefault();
        event.stopPropagation();
      }
      const start = pose(found, false);
      pan = {
        start,
        found,
        pointer: event.pointerId,
        at: api.local(event),
        grabbed: reach(event, start.position),
        hasMoved: false
      };
      if (event.button !== 2 && !isOnLayer(event)) setCursor();
    }
    function movePan(event) {
      if (!pan || event.pointerId !== pan.pointer) return;
      const [x, y] = api.local(event);
      if (!pan.hasMoved && Math.hypot(x - pan.at[0], y - pan.at[1]) < 4) return;
      if (!pan.hasMoved) {
        pan.hasMoved = true;
        setCursor();
      }
      const now = reach(event, pose(pan.found, false).position);
      if (!now || !pan.grabbed) return;
      const moved = {
        position: pan.start.position.clone(),
        target: pan.start.target.clone()
      };
      for (const vector of [moved.position, moved.target]) {
        vector.x += pan.grabbed[0] - now[0];
        vector.y += pan.grabbed[1] - now[1];
      }
      look(pan.found, moved, false);
    }
    function endPan(event) {
      if (!pan || event.pointerId !== pan.pointer) return;
      hasPanned = pan.hasMoved;
      pan = null;
      setCursor();
    }
    function setCursor() {
      document.body.classList.toggle("pd-can-pan", isPanKeyHeld && !pan);
      document.body.classList.toggle("pd-pans", pan !== null);
    }
    function isTyping(event) {
      return /^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "");
    }
    function keyDown(event) {
      if (isTyping(event)) return;
      if (event.code === PAN_KEY && !event.ctrlKey && !event.metaKey && !event.altKey) {
        isPanKeyHeld = true;
        setCursor();
      }
      if (CAMERA_KEYS.test(event.code))
        document.dispatchEvent(new KeyboardEvent("keyup", { code: event.code }));
    }
    function letKeysGo(event) {
      if (event.type === "keyup" && event.code !== PAN_KEY) return;
      isPanKeyHeld = false;
      setCursor();
    }
    function fitDepth(camera) {
      const found = controls();
      if (!found || isTop === null) return;
      if (known && found !== known) configure();
      const { position, target } = pose(found, false);
      const distance = position.distanceTo(target);
      const near = isTop ? Math.max(1, distance * 0.5) : Math.max(0.3, 0.5 * (position.z - 4));
      const far = isTop ? distance * 1.5 + 100 : Math.max(3e3, 6 * distance);
      const isClose = (a, b) => Math.abs(a - b) <= 0.05 * b;
      if (isClose(camera.near, near) && isClose(camera.far, far)) return;
      camera.near = near;
      camera.far = far;
      camera.updateProjectionMatrix();
      api.viewer().requestRender?.();
    }
    api.listen(window, "wheel", zoom, { capture: true, passive: false });
    api.listen(window, "pointerdown", startPan, { capture: true });
    api.listen(window, "pointermove", movePan, { capture: true });
    api.listen(window, "pointerup", endPan, { capture: true });
    api.listen(window, "pointercancel", endPan, { capture: true });
    for (const type of ["click", "contextmenu"])
      api.listen(window, type, (event) => {
        if (!hasPanned || !isOnView(event)) return;
        hasPanned = false;
        api.take(event);
      }, { capture: true });
    api.listen(window, "keydown", keyDown);
    api.listen(window, "keyup", letKeysGo);
    api.listen(window, "blur", letKeysGo);
    api.onView(fitDepth);
    api.onDispose(() => document.body.classList.remove("pd-can-pan", "pd-pans"));
    return (state) => {
      isTop = state.isTop;
      const found = controls();
      if (found) found.maxPolarAngle = Math.PI;
      known = null;
      requestAnimationFrame(() => requestAnimationFrame(configure));
    };
  });

  // src/main.js
  pdOverlay.setStyle([guidance_default, locks_default, style_default].join("\n"));
})();
