// The scorecard: metrics beside what is usual, and charts of the selected agents.
import { button, closeButton, fill, make, svg } from "../dom.ts";
import { define, pictureSize } from "../frame.ts";
import { along, clamp, type Pixel } from "../geometry.ts";
import type { Chart, ChartsState, ScorecardEvent, ScorecardState, ScoreLine } from "../messages.ts";
import { playheadMoved } from "../shared.ts";

const WIDTH = 276;
const HEIGHT = 66;
const TOP = 8;
const LEFT = 30;
const NARROW_PX = 11;
// Level is told by shape as well as by colour.
const SHAPES = { usual: "\u25cf", unusual: "\u25b2", extreme: "\u25a0" };
const COLORS = ["var(--pd-line-1)", "var(--pd-line-2)", "var(--pd-line-3)"];
const EMPTY = "Select up to three agents to see speed, acceleration and gap.";
let setCharts = (_state: ChartsState) => {};

/** A number with a true minus sign. */
const written = (value: number, digits = 1) => value.toFixed(digits).replace("-", "\u2212");

/** A chart, and what moves its playhead; null where nothing is known. */
function chart({ title, lines }: Chart, time: readonly number[], ids: readonly string[]) {
  const known = lines.flat().filter((value) => value !== null);
  if (!known.length) return null;
  const low = Math.min(0, ...known);
  const high = Math.max(low + 1, ...known);
  const [first, last] = [time[0], time.at(-1) ?? 0];
  const x = (t: number) => LEFT + ((t - first) / (last - first || 1)) * (WIDTH - LEFT - 4);
  const y = (value: number) => TOP + (1 - (value - low) / (high - low)) * (HEIGHT - TOP - 4);
  const picture = svg("svg", "", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    role: "img",
    "aria-label": `${title} of ${ids.join(", ")}`,
  });
  for (const value of low < 0 ? [low, 0, high] : [low, high]) {
    const grid = { x1: LEFT, x2: WIDTH - 4, y1: y(value), y2: y(value) };
    picture.append(svg("line", "pd-chart-grid", grid));
    // Of an axis that reaches just below zero only the ends are labelled.
    const isNarrow = Math.min(y(low) - y(0), y(0) - y(high)) < NARROW_PX;
    if (value === 0 && low < 0 && isNarrow) continue;
    const text = value === 0 ? "0" : written(value, Math.abs(value) >= 100 ? 0 : 1);
    picture.append(svg("text", "pd-chart-text", { x: LEFT - 4, y: y(value) + 3.5 }, text));
  }
  for (const [index, line] of lines.entries()) {
    const points = line.map((value, step): Pixel | null => (value === null ? null : [x(time[step]), y(value)]));
    const drawn = svg("path", "pd-chart-line", { d: along(points) });
    drawn.style.stroke = COLORS[index];
    picture.append(drawn);
  }
  const playhead = svg("line", "pd-chart-head", { y1: TOP - 4, y2: HEIGHT - 2 });
  picture.append(playhead);
  const box = make("div", "pd-chart");
  // The values under the playhead, in the colours of their lines.
  const values = lines.map((_, index) => {
    const value = make("span", "pd-chart-value");
    value.style.color = COLORS[index];
    return value;
  });
  const heading = make("div", "pd-chart-title", {}, title);
  heading.append(...values);
  box.append(heading, picture);
  const step = (last - first) / Math.max(time.length - 1, 1) || 1;
  const move = (t: number) => {
    playhead.setAttribute("x1", String(x(t)));
    playhead.setAttribute("x2", String(x(t)));
    const at = clamp(Math.round((t - first) / step), 0, time.length - 1);
    for (const [index, line] of lines.entries()) {
      const value = line[at];
      const text = value === null ? "\u2013" : written(value);
      if (values[index].textContent !== text) values[index].textContent = text;
    }
  };
  return { box, move };
}

define("scorecard", (api) => {
  const drawer = make("div", "pd-solid pd-agents pd-score", { role: "region", "aria-label": "Scorecard" });
  drawer.hidden = true;
  // How much of the picture's width the drawer covers: what is shown stands beside it.
  const send = (event: Omit<ScorecardEvent, "covered">) => {
    const covered = (drawer.offsetLeft + drawer.offsetWidth) / Math.max(pictureSize().width, 1);
    api.send({ ...event, covered: Math.min(covered, 1) });
  };
  const head = make("div", "pd-agents-head");
  head.append(
    make("b", "pd-score-title", {}, "Scorecard"),
    closeButton("Close the scorecard", "I", () => send({ kind: "close" })),
  );
  const columns = make("div", "pd-score-row pd-score-head");
  for (const [name, text] of [
    ["dot", ""],
    ["name", "Motor vehicles"],
    ["value", "scene"],
    ["usual", "usual"],
  ])
    columns.append(make("span", `pd-score-${name}`, {}, text));
  columns.title = "Usual: 5 to 95 % of recorded scenes";
  const list = make("div", "pd-score-rows", { role: "group", "aria-label": "Metrics" });
  const charts = make("div", "pd-charts");
  const foot = make("label", "pd-score-draw");
  const draws = make("input", "", { type: "checkbox" });
  draws.addEventListener("change", () => send({ kind: "draw", value: draws.checked }));
  foot.append(draws, make("span", "", {}, "Draw findings in the scene"));
  drawer.append(head, columns, list, foot, charts);
  api.box.append(drawer);

  let moves: ((time: number) => void)[] = [];
  let now = 0;
  function showTime(time: number) {
    now = time;
    if (!drawer.hidden) for (const move of moves) move(time);
  }
  setCharts = ({ charts: all, time, ids }) => {
    const made = all.map((one) => chart(one, time, ids)).filter((one) => one !== null);
    moves = made.map((one) => one.move);
    const legend = make("div", "pd-chart-legend");
    ids.forEach((id, index) => {
      const name = make("span", "", { title: id }, id);
      name.style.setProperty("--line", COLORS[index]);
      legend.append(name);
    });
    const empty = make("div", "pd-score-note", {}, EMPTY);
    charts.replaceChildren(...(made.length ? [legend, ...made.map((one) => one.box)] : [empty]));
    showTime(now);
  };
  playheadMoved.listen(showTime);

  function rowOf(row: ScoreLine) {
    const where = row.where ? `The worst: ${row.where}` : "No agent stands out";
    const item = button("pd-score-row", "", () => send({ kind: "row", name: row.name }), {
      title: `${row.meaning} ${where}`,
      "aria-expanded": String(row.findings !== null),
    });
    item.disabled = !row.where;
    const name = make("span", "pd-score-name", {}, row.title);
    if (row.mark) name.append(make("i", `pd-score-mark pd-score-${row.mark}`));
    const dot = `pd-score-dot pd-${row.tone}`;
    item.append(
      make("span", dot, { role: "img", "aria-label": row.level }, SHAPES[row.level]),
      name,
      make("span", "pd-score-value", {}, row.value),
      make("span", "pd-score-usual", {}, row.usual),
    );
    return item;
  }

  // The findings of the open row, and what helps against the chosen one.
  function detail(row: ScoreLine, state: ScorecardState) {
    const label = `Findings: ${row.title}`;
    const box = make("div", "pd-score-detail", { role: "group", "aria-label": label });
    for (const { id, agent, text, time, isChosen } of row.findings ?? []) {
      const item = button("pd-score-finding", "", () => send({ kind: "finding", id }), {
        title: `${agent} ${text}, ${time}`,
        "aria-current": String(isChosen),
      });
      item.append(
        make("b", "", {}, agent),
        make("span", "pd-score-text", {}, text),
        make("span", "pd-score-time", {}, time),
      );
      box.append(item);
      if (!isChosen || !(state.isSearching || state.cures.length)) continue;
      const cures = make("div", "pd-score-cures");
      if (state.isSearching) cures.append(make("span", "pd-score-note", {}, "Looking for repairs ..."));
      for (const name of state.cures) cures.append(button("", name, () => send({ kind: "cure", name })));
      box.append(cures);
    }
    if (row.more) box.append(make("div", "pd-score-note", {}, `and ${row.more} more`));
    return box;
  }

  return (state) => {
    drawer.hidden = !state.isOpen;
    if (!state.isOpen) return;
    draws.checked = state.draws;
    fill(list, { ...state, draws: null }, () =>
      state.rows.flatMap((row) => (row.findings ? [rowOf(row), detail(row, state)] : [rowOf(row)])),
    );
  };
});

define("charts", () => (state) => setCharts(state));
