// The scorecard: metrics beside what is usual, and charts of the selected agents.
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const WIDTH = 276;
  const HEIGHT = 66;
  const TOP = 8;
  const LEFT = 30;
  // Level is told by shape as well as by colour.
  const SHAPES = { usual: "\u25cf", unusual: "\u25b2", extreme: "\u25a0" };
  const COLORS = ["var(--pd-line-1)", "var(--pd-line-2)", "var(--pd-line-3)"];
  let showTime = () => {};
  let setCharts = () => {};

  pdOverlay.define("scorecard", (api) => {
    const { make } = api;
    const drawer = make("div", "pd-solid pd-agents pd-score", {
      role: "region", "aria-label": "Scorecard",
    });
    drawer.hidden = true;
    const head = make("div", "pd-agents-head");
    head.append(make("b", "pd-score-title", {}, "Scorecard"));
    const close = make("button", "pd-close", {
      type: "button", "aria-label": "Close the scorecard", title: "Close (I)",
    }, "\u00d7");
    // How much of the picture's width the drawer covers: what is shown stands beside it.
    const send = (event) => api.send({
      ...event,
      covered: (drawer.offsetLeft + drawer.offsetWidth) / Math.max(api.box.parentElement.offsetWidth, 1),
    });
    close.addEventListener("click", () => send({ kind: "close" }));
    head.append(close);
    const columns = make("div", "pd-score-row pd-score-head");
    for (const [name, text] of [["dot", ""], ["name", "Motor vehicles"], ["value", "scene"],
      ["usual", "usual"]])
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
      const x = (t) => LEFT + ((t - time[0]) / (time.at(-1) - time[0] || 1)) * (WIDTH - LEFT - 4);
      const y = (v) => TOP + (1 - (v - low) / (high - low)) * (HEIGHT - TOP - 4);
      const svg = shape("svg", {
        viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img",
        "aria-label": `${title} of ${ids.join(", ")}`,
      });
      for (const value of low < 0 ? [low, 0, high] : [low, high]) {
        svg.append(shape("line", {
          x1: LEFT, x2: WIDTH - 4, y1: y(value), y2: y(value), class: "pd-chart-grid",
        }));
        // Of an axis that reaches just below zero only the ends are labelled.
        if (value === 0 && low < 0 && Math.min(y(low) - y(0), y(0) - y(high)) < 11) continue;
        const text = shape("text", { x: LEFT - 4, y: y(value) + 3.5, class: "pd-chart-text" });
        const shown = Math.abs(value) >= 100 ? value.toFixed(0) : value.toFixed(1);
        text.textContent = value === 0 ? "0" : shown.replace("-", "\u2212");
        svg.append(text);
      }
      lines.forEach((line, index) => {
        let path = "";
        let isDrawing = false;
        line.forEach((value, step) => {
          if (value === null) isDrawing = false;
          else {
            path += `${isDrawing ? "L" : "M"}${x(time[step]).toFixed(1)} ${y(value).toFixed(1)}`;
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
      // The values under the playhead, in the colours of their lines.
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
          const text = value === null ? "\u2013" : value.toFixed(1).replace("-", "\u2212");
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
      const made = state.charts
        .map(({ title, lines }) => chart(title, lines, state.time, state.ids))
        .filter((one) => one !== null);
      moves = made.map((one) => one.move);
      const legend = make("div", "pd-chart-legend");
      state.ids.forEach((id, index) => {
        const name = make("span", "", { title: id }, id);
        name.style.setProperty("--line", COLORS[index]);
        legend.append(name);
      });
      const empty = make("div", "pd-score-note", {},
        "Select up to three agents to see speed, acceleration and gap.");
      charts.replaceChildren(...(made.length ? [legend, ...made.map((one) => one.box)] : [empty]));
      showTime(now);
    };
    api.listen(window, "pd-playhead", (event) => showTime(event.detail));

    function rowOf(row) {
      const item = make("button", "pd-score-row", {
        type: "button",
        title: row.where ? `${row.meaning} The worst: ${row.where}` :
          `${row.meaning} No agent stands out`,
        "aria-label": `${row.title}: ${row.value}, ${row.level}; usual ${row.usual}`,
        "aria-expanded": String(Boolean(row.findings)),
      });
      item.disabled = !row.where;
      const name = make("span", "pd-score-name", {}, row.title);
      if (row.mark) name.append(make("i", `pd-score-mark pd-score-${row.mark}`, {}));
      item.append(
        make("span", `pd-score-dot pd-${row.tone}`, { "aria-hidden": "true" },
          SHAPES[row.level]),
        name,
        make("span", "pd-score-value", {}, row.value),
        make("span", "pd-score-usual", {}, row.usual),
      );
      item.addEventListener("click", () => send({ kind: "row", name: row.name }));
      return item;
    }

    // The findings of the open row, and what helps against the chosen one.
    function detail(row, state) {
      const box = make("div", "pd-score-detail", {
        role: "group", "aria-label": `Findings: ${row.title}`,
      });
      for (const { id, agent, text, time, isChosen } of row.findings) {
        const item = make("button", "pd-score-finding", {
          type: "button", title: `${agent} ${text}, ${time}`,
          "aria-current": String(isChosen),
        });
        item.append(
          make("b", "", {}, agent),
          make("span", "pd-score-text", {}, text),
          make("span", "pd-score-time", {}, time));
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
      list.replaceChildren(...state.rows.flatMap((row) =>
        row.findings ? [rowOf(row), detail(row, state)] : [rowOf(row)]));
    };
  });

  pdOverlay.define("charts", () => (state) => setCharts(state));
})();
