// The outline of a map, of which a square is chosen: by a drag, or by a click and a size.
pdOverlay.define("mapWindow", (api) => {
  const SVG = "http://www.w3.org/2000/svg";
  const LEAST_M = 10;
  let square = null; // middle and half side, in metres of the file
  let press = null;

  const veil = api.make("div", "pd-veil pd-map-window");
  const card = api.make("div", "pd-solid", {
    role: "dialog", "aria-label": "Choose a part of the map", "aria-modal": "true" });
  const title = api.make("b");
  const [svg, road, rect] = ["svg", "path", "rect"].map(
    (name) => document.createElementNS(SVG, name));
  svg.append(road, rect); // y is down in them, and north up
  const size = api.make("input", "", { type: "number", min: LEAST_M, step: 10 });
  const label = api.make("label", "", {}, "Half side (m) ");
  const told = api.make("span");
  const [cancel, open] = ["Cancel", "Open this part"].map(
    (text) => api.make("button", "", { type: "button" }, text));
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
    told.textContent = `${Math.round(2 * half)} \u00d7 ${Math.round(2 * half)} m`;
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
  svg.addEventListener("pointerup", () => (press = null));
  size.addEventListener("input", () => {
    square[2] = Math.max(Number(size.value), LEAST_M);
    draw();
  });
  open.addEventListener("click", () => api.send({ kind: "open", square }));
  cancel.addEventListener("click", () => api.send({ kind: "cancel" }));
  // Keys belong to the dialog while it is open.
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
