// Distances on the ground: click points; each stretch and the whole way have a label.
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
  let points = []; // on the ground, in metres
  let isComplete = false;
  let pointer = null; // pixel under the mouse

  const length = (a, b) => Math.hypot(b[0] - a[0], b[1] - a[1]);
  const metres = (value) => `${value.toFixed(value < 100 ? 1 : 0)} m`;

  function line(from, to, name) {
    for (const part of ["pd-measure-halo", name]) {
      const element = document.createElementNS(SVG, "line");
      for (const [key, value] of
        [["x1", from[0]], ["y1", from[1]], ["x2", to[0]], ["y2", to[1]]])
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
      // The last stretch is told by the label at its end when it is the only one.
      if (way.length > 2 && length(way[i - 1], way[i]) >= LEAST_TOLD_M)
        label([(from[0] + to[0]) / 2, (from[1] + to[1]) / 2],
          [metres(length(way[i - 1], way[i]))], "pd-measure-part");
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
      lines.push(`${(total / state.speed).toFixed(1)} s at ` +
        `${state.speed.toFixed(1)} m/s (${state.agent})`);
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
    // A second click on the last point adds nothing.
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
  // While one measures, these take back points and never delete agents.
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
