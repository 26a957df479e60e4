// The region that is resampled: drawn by a drag on the ground, shown until it is cleared.
//
// While the mode is on, left presses on the picture belong to it: viser does not hear
// them, so that neither the camera turns nor a rectangle is drawn.
pdOverlay.define("region", (api) => {
  const SVG = "http://www.w3.org/2000/svg";
  const PARTS = 16; // of a side, so that what is behind the camera is left out alone
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
    });
  const label = api.make("div", "pd-region-label pd-gone", { role: "group", "aria-label": "Region" });
  const text = api.make("span");
  const close = api.make("button", "pd-region-clear",
    { type: "button", title: "Clear the region", "aria-label": "Clear the region" }, "\u00d7");
  label.append(text, close);
  api.box.append(svg, label);
  close.addEventListener("click", () => api.send({ kind: "clear" }));

  // Middle and half side of the square that a drag spans.
  function spanned() {
    const [dx, dy] = [press.to[0] - press.from[0], press.to[1] - press.from[1]];
    const half = Math.max(Math.abs(dx), Math.abs(dy)) / 2;
    return [press.from[0] + (dx < 0 ? -half : half),
      press.from[1] + (dy < 0 ? -half : half), half];
  }

  function draw() {
    const square = press ? spanned() : state.square;
    const isShown = square && square[2] > 0;
    svg.style.display = isShown ? "" : "none";
    label.classList.toggle("pd-gone", !isShown);
    if (!isShown) return;
    const [x, y, half] = square;
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(
      ([a, b]) => [x + a * half, y + b * half]);
    const ring = corners.flatMap((from, index) => {
      const to = corners[(index + 1) % 4];
      return Array.from({ length: PARTS }, (_, part) => [0, 1].map(
        (axis) => from[axis] + (part / PARTS) * (to[axis] - from[axis])));
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
    text.textContent = isSmall
      ? `${side} m: at least ${state.leastM} m` : `Region ${side} \u00d7 ${side} m`;
    close.hidden = Boolean(press);
    label.classList.toggle("pd-solid", !press);
    // At the uppermost corner, and never beneath the toolbar or out of the picture.
    const top = seen.reduce((one, other) => (other[1] < one[1] ? other : one));
    const canvas = api.canvas();
    const at = [
      Math.min(Math.max(top[0], 90), canvas.clientWidth - 90),
      Math.min(Math.max(top[1], 96), canvas.clientHeight - 72)];
    label.style.transform =
      `translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px) translate(-50%, -130%)`;
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
