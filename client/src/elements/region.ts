// The region that is resampled: drawn by a drag on the ground, shown until it is cleared.
//
// While the mode is on, left presses on the picture belong to it: viser does not hear
// them, so that neither the camera turns nor a rectangle is drawn.
import { ground, project } from "../bridge.ts";
import { button, make, svg } from "../dom.ts";
import {
  define,
  followPress,
  hearFirst,
  isModePress,
  local,
  markBody,
  onDispose,
  onView,
  pictureSize,
  take,
} from "../frame.ts";
import { along, clamp, type Ground, isSeen, outlineOf, squareBetween } from "../geometry.ts";
import type { RegionState } from "../messages.ts";

const PARTS = 16; // of a side, so that what is behind the camera is left out alone

define("region", (api) => {
  let state: RegionState = { isActive: false, leastM: 10, square: null };
  let press: { id: number; from: Ground; to: Ground } | null = null;

  const drawing = svg("svg", "pd-region-drawing", { "aria-hidden": "true" });
  const paths = ["area", "halo", "edge"].map((name) => svg("path", `pd-region-${name}`));
  drawing.append(...paths);
  const label = make("div", "pd-region-label pd-gone", { role: "group", "aria-label": "Region" });
  const text = make("span");
  const clear = "Clear the region";
  const close = button("pd-region-clear", "\u00d7", () => api.send({ kind: "clear" }), {
    title: clear,
    "aria-label": clear,
  });
  label.append(text, close);
  api.box.append(drawing, label);

  function draw() {
    const square = press ? squareBetween(press.from, press.to) : state.square;
    const ring = square && square[2] > 0 ? outlineOf(square, PARTS) : [];
    const seen = ring.map(project).filter(isSeen);
    const isShown = square !== null && seen.length > 2;
    drawing.style.display = isShown ? "" : "none";
    label.classList.toggle("pd-gone", !isShown);
    if (!isShown) return;
    for (const path of paths) path.setAttribute("d", `${along(seen)}Z`);
    const side = 2 * square[2];
    const isSmall = press !== null && side < state.leastM;
    drawing.classList.toggle("pd-region-small", isSmall);
    const width = side.toFixed(side < 100 ? 1 : 0);
    text.textContent = isSmall ? `${width} m: at least ${state.leastM} m` : `Region ${width} \u00d7 ${width} m`;
    close.hidden = press !== null;
    label.classList.toggle("pd-solid", !press);
    // At the uppermost corner, and never beneath the toolbar or out of the picture.
    const top = seen.reduce((one, other) => (other[1] < one[1] ? other : one));
    const picture = pictureSize();
    const x = clamp(top[0], 90, picture.width - 90).toFixed(1);
    const y = clamp(top[1], 96, picture.height - 72).toFixed(1);
    label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -130%)`;
  }

  hearFirst("pointerdown", (event) => {
    if (!state.isActive || !isModePress(event)) return;
    take(event);
    const point = ground(...local(event));
    if (point) press = { id: event.pointerId, from: point, to: point };
    draw();
  });

  hearFirst("pointermove", (event) => {
    if (!press || event.pointerId !== press.id) return;
    press.to = ground(...local(event)) ?? press.to;
    draw();
  });

  function giveUp() {
    press = null;
    draw();
  }
  followPress(
    () => press,
    (_event, { from, to }) => {
      if (from[0] !== to[0] || from[1] !== to[1]) api.send({ kind: "drawn", start: from, end: to });
      giveUp();
    },
    giveUp,
  );

  onView(draw);
  onDispose(() => markBody("pd-drawing-region", false));
  return (next) => {
    if (!next.isActive) press = null;
    state = next;
    markBody("pd-drawing-region", state.isActive);
    draw();
  };
});
