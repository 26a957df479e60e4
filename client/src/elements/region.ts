// The region that is resampled: drawn by a drag on the ground, shown until it is cleared.
import { ground, project } from "../bridge.ts";
import { button, make, svg } from "../dom.ts";
import { define, modePress, onView, pictureSize } from "../frame.ts";
import { along, clamp, type Ground, isSeen, outlineOf, squareBetween } from "../geometry.ts";
import type { RegionState } from "../messages.ts";

const PARTS = 16; // of a side, so that what is behind the camera is left out alone

define("region", (api) => {
  let state: RegionState = { isActive: false, leastM: 10, square: null };
  const press = modePress<{ from: Ground; to: Ground }>("pd-drawing-region", {
    begin(at) {
      const point = ground(...at);
      return point && { from: point, to: point };
    },
    drag(held, at) {
      held.to = ground(...at) ?? held.to;
    },
    release({ from, to }) {
      if (from[0] !== to[0] || from[1] !== to[1]) api.send({ kind: "drawn", start: from, end: to });
    },
    draw,
  });

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
    const { held } = press;
    const square = held ? squareBetween(held.from, held.to) : state.square;
    const ring = square && square[2] > 0 ? outlineOf(square, PARTS) : [];
    const seen = ring.map(project).filter(isSeen);
    const isShown = square !== null && seen.length > 2;
    drawing.style.display = isShown ? "" : "none";
    label.classList.toggle("pd-gone", !isShown);
    if (!isShown) return;
    for (const path of paths) path.setAttribute("d", `${along(seen)}Z`);
    const side = 2 * square[2];
    const isSmall = held !== null && side < state.leastM;
    drawing.classList.toggle("pd-region-small", isSmall);
    const width = side.toFixed(side < 100 ? 1 : 0);
    text.textContent = isSmall ? `${width} m: at least ${state.leastM} m` : `Region ${width} \u00d7 ${width} m`;
    close.hidden = held !== null;
    label.classList.toggle("pd-solid", !held);
    // At the uppermost corner, and never beneath the toolbar or out of the picture.
    const top = seen.reduce((one, other) => (other[1] < one[1] ? other : one));
    const picture = pictureSize();
    const x = clamp(top[0], 90, picture.width - 90).toFixed(1);
    const y = clamp(top[1], 96, picture.height - 72).toFixed(1);
    label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -130%)`;
  }

  onView(draw);
  return (next) => {
    state = next;
    press.turn(state.isActive);
    draw();
  };
});
