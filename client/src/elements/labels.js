// Names beside agents: each stands clear of its agent, joined to it by a thin line.
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

  // Beside the agent: right or left, above or below, whatever lies in the picture and
  // on no label placed before, flag or stop line.
  function choose(x, y, radius, width, height, placed) {
    const reach = radius * Math.SQRT1_2 + GAP_PX * Math.SQRT1_2;
    let best = null;
    for (const [side, rise] of [[1, -1], [-1, -1], [1, 1], [-1, 1]]) {
      const left = side > 0 ? x + reach : x - reach - width;
      const top = rise < 0 ? y - reach - height : y + reach;
      const outside =
        Math.max(0, -left) + Math.max(0, left + width - api.root.clientWidth) +
        Math.max(0, -top) + Math.max(0, top + height - api.root.clientHeight);
      const hits = placed.filter((other) =>
        left < other.left + other.width && other.left < left + width &&
        top < other.top + other.height && other.top < top + height).length;
      const cost = outside + 1000 * hits;
      if (best === null || cost < best.cost)
        best = { left, top, width, height, side, rise, cost };
    }
    return best;
  }

  function place() {
    const placed = [...(pdOverlay.taken ?? [])];
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
        Math.hypot(along[0] - at[0], along[1] - at[1]));
      const spot = choose(
        at[0], at[1], radiusPx, shown.box.offsetWidth, shown.box.offsetHeight, placed);
      placed.push(spot);
      shown.box.style.transform =
        `translate(${Math.round(spot.left)}px, ${Math.round(spot.top)}px)`;
      const start = radiusPx * Math.SQRT1_2;
      const corner = [
        spot.side > 0 ? spot.left : spot.left + spot.width,
        spot.rise < 0 ? spot.top + spot.height : spot.top,
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
