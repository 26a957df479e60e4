// Marks of guidance terms on the road: flags, paths, stop lines, arrows and badges. Flags
// and stop lines are dragged; a click on any mark chooses its term.
pdOverlay.define("guidance_marks", (api) => {
  const { shape, plate, flag, along, head, bow } = pdOverlay.guidance;
  const STILL_PX = 4;
  const SEND_MS = 50;
  const SETTLE_MS = 700;
  const HELD_BACK_PX = 16; // Arrows begin and end outside the agents.
  // Around an offered flag's foot: agents in there could not be pressed.
  const COVERED_PX = { left: -20, right: 37, top: -48, bottom: 2 };
  const DRAGGED = ["flag", "line"];
  const layer = shape("svg", "pd-guide-marks");
  const tip = api.make("div", "pd-tip pd-guide-tip", { role: "tooltip" });
  tip.hidden = true;
  api.box.append(layer, tip);
  let state = { marks: [], agents: [], refusal: "" };
  let press = null; // the mark that is held
  let settling = null; // a mark that was dropped, until the server has answered
  let sentAt = 0;
  let late = null;
  let pointed = null; // the index of the arc under the pointer

  const isMode = () =>
    ["pd-crosshair", "pd-drawing-region", "pd-guiding"].some((name) =>
      document.body.classList.contains(name));
  const held = () => press ?? settling;
  // Boxes of pixels that names of agents do not cover.
  const taken = [];
  pdOverlay.taken = taken;
  const take = (left, top, right, bottom) =>
    taken.push({ left, top, width: right - left, height: bottom - top });

  // Not drawn from the server's state: the held mark, and the term it has just become.
  function isHeldBack(mark) {
    const hold = held();
    return Boolean(hold?.point) &&
      (mark.index === hold.mark.index || !hold.known.has(mark.index)) &&
      mark.shape !== "badges";
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

  // The point half way along a line of pixels.
  function halfWay(pixels) {
    const steps = pixels.slice(1).map((point, index) =>
      Math.hypot(point[0] - pixels[index][0], point[1] - pixels[index][1]));
    let rest = steps.reduce((sum, step) => sum + step, 0) / 2;
    const index = steps.findIndex((step) => (rest -= step) <= 0);
    if (index < 0) return pixels[0];
    const share = 1 + rest / (steps[index] || 1);
    return [0, 1].map((axis) => pixels[index][axis] +
      share * (pixels[index + 1][axis] - pixels[index][axis]));
  }

  function drawPath(mark, parent) {
    const pixels = mark.points.map(ground);
    const line = along(pixels);
    if (!line) return;
    // The line takes no clicks: agents that are to be dragged stand on it.
    for (const name of ["pd-guide-halo", "pd-guide-line"])
      parent.append(shape("path", name, { d: line }));
    parent.append(shape("path", "pd-guide-halo", { d: head(pixels) }),
      shape("path", "pd-guide-line", { d: head(pixels) }));
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
    const end = [0, 1].map((axis) =>
      first[axis] - ((last[axis] - first[axis]) / length) * 15);
    put(parent, plate(mark.kind), end);
    if (mark.isBad) warn(parent, end[0] + 10, end[1] - 10);
  }

  function drawArrow(mark, parent) {
    const [from, to] = [api.project(mark.from), api.project(mark.to)];
    if (!from || !to) return;
    const { points, middle } = bow(from, to);
    const far = (point, other) =>
      Math.hypot(point[0] - other[0], point[1] - other[1]) > HELD_BACK_PX;
    const shown = points.filter((point) => far(point, from) && far(point, to));
    if (shown.length > 1) {
      for (const name of ["pd-guide-halo", "pd-guide-line"])
        parent.append(shape("path", name, { d: along(shown) }));
      parent.append(shape("path", "pd-guide-line pd-guide-head", { d: head(shown) }));
    }
    put(parent, plate(mark.kind), middle);
    if (mark.isBad) warn(parent, middle[0] + 10, middle[1] - 10);
  }

  // What could happen: a thin arc, and where it is pointed at the agent's way.
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
    for (const mark of state.marks) if (!isHeldBack(mark)) drawMark(mark);
    const hold = held();
    if (!hold?.point) return;
    const isRefused = state.refusal !== "";
    const mark = { ...hold.mark, isOffer: false, isFaint: false, isChosen: true };
    mark.isBad = isRefused;
    if (mark.shape === "flag") drawMark({ ...mark, point: hold.point });
    // The line snaps to a lane: where, the server says.
    else drawMark(state.marks.find((one) => one.index === mark.index) ?? mark);
    if (isRefused) layer.lastElementChild.classList.add("pd-guide-refused");
  }

  // Agents under arcs are pressed as those beside them are.
  function isOverAgent(at) {
    return state.agents.some(([x, y, z, radius]) => {
      const [middle, ...edges] = [[0, 0], [radius, 0], [0, radius]].map(([dx, dy]) =>
        api.project([x + dx, y + dy, z]));
      const away = (edge, from) =>
        edge ? Math.hypot(edge[0] - from[0], edge[1] - from[1]) : 0;
      return middle &&
        away(middle, at) <=
          Math.max(HELD_BACK_PX, ...edges.map((edge) => away(edge, middle)));
    });
  }

  function markOf(target) {
    const found = target?.closest?.("[data-guide]");
    if (!found || !layer.contains(found)) return null;
    const index = Number(found.dataset.guide);
    return state.marks.flatMap((mark) => mark.badges ?? [mark]).find(
      (mark) => mark.index === index) ?? null;
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
      id: event.pointerId, mark, at, point: null,
      offset: [foot[0] - at[0], foot[1] - at[1]],
      known: new Set(state.marks.map((one) => one.index)),
    };
    settling = null;
    send("grab");
  }, { capture: true });

  api.listen(window, "pointermove", (event) => {
    if (press && event.pointerId === press.id) {
      api.take(event);
      const at = api.local(event);
      const isStill =
        Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) <= STILL_PX;
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
    send("drop", press.point ?? undefined);
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
      "pd-arcs", state.marks.some((mark) => mark.shape === "arc"));
    draw();
    if (press?.pointer && state.refusal !== wasRefused)
      tell(state.refusal ? [state.refusal] : [], press.pointer);
  };
});
