// Drawing a guidance term: a click on the road, a line drawn on it, or another agent. A line
// is drawn by a drag, or from point to point by clicks: Enter, or another click on the last
// point, such as a double click, ends it; Backspace takes the last point back.
//
// While the mode is on, left presses on the picture belong to it: viser does not hear
// them, so that neither the camera turns nor a rectangle is drawn.
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
  let line = []; // Points on the ground that were clicked, after the agent's place.
  let askedAt = 0;
  let late = null;

  const ground = (point) => api.project([point[0], point[1], 0]);

  function stroke(parent, pixels, isArrow) {
    const line = along(pixels);
    for (const name of ["pd-guide-halo", "pd-guide-line"])
      parent.append(shape("path", name, { d: line }));
    if (isArrow) parent.append(shape("path", "pd-guide-line", { d: head(pixels) }));
  }

  function draw() {
    layer.replaceChildren();
    const ghost = state.ghost ?? {};
    tip.hidden = !state.isActive || !at || Boolean(press) || !ghost.text;
    if (!state.isActive) return;
    const parent = shape("g",
      `pd-guide pd-guide-${state.kind} pd-guide-chosen ${ghost.isBad ? "pd-guide-refused" : ""}`);
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
  const isNear = (one, other) =>
    Boolean(one && other) && Math.hypot(one[0] - other[0], one[1] - other[1]) <= SAME_PX;

  // A drag is the whole line, or goes on with one that was begun by clicks.
  function addToLine(points) {
    const isClick = points.length && points.every(
      (point) => isNear(ground(point), ground(points[0])));
    if (isClick && line.length > 1 && isNear(ground(points[0]), ground(line.at(-1)))) {
      finish();
      return;
    }
    const isWhole = !isClick && !line.length;
    if (isClick && !line.length) line.push(state.from.slice(0, 2));
    line.push(...(isClick ? [points[0]] : points));
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
