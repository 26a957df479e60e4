// Placing: a crosshair, a ghost under the pointer, a press that is dragged to turn it.
//
// While the mode is on, left presses on the picture belong to it: viser does not hear
// them, so that neither the camera turns nor a rectangle is drawn.
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
      place[0] + forward * cos - left * sin, place[1] + forward * sin + left * cos, up]);
    const ring = (up) => [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(
      ([f, l]) => project((f * length) / 2, (l * width) / 2, up));
    const [base, top] = [ring(0), ring(height)];
    const reach = length / 2 + Math.max(2.2, length * 0.4);
    const arrow = [
      project(length / 2 + 0.3, 0, 0), project(reach, 0, 0),
      project(reach - 0.9, 0.6, 0), project(reach - 0.9, -0.6, 0)];
    if ([...base, ...top, ...arrow].some((point) => !point)) {
      svg.style.display = "none";
      return;
    }
    const line = (points) => `M${points.map((p) => p.map((v) => v.toFixed(1))).join("L")}`;
    shapes[0].setAttribute("d", `${line(base)}Z`);
    shapes[1].setAttribute("d", `${line(top)}Z` +
      base.map((point, index) => line([point, top[index]])).join(""));
    shapes[2].setAttribute("d",
      line([arrow[0], arrow[1]]) + line([arrow[2], arrow[1], arrow[3]]));
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

  // Before viser's hot keys, which may mean something else by digits.
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
