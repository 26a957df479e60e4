// The outline of a map, of which a square is chosen: by a drag, or by a click and a size.
import { button, make, svg } from "../dom.ts";
import { define, hearFirst } from "../frame.ts";
import { type Ground, type Square, squareBetween } from "../geometry.ts";

const LEAST_M = 10;

define("mapWindow", (api) => {
  let square: Square = [0, 0, 0]; // in metres of the file
  let press: Ground | null = null;

  const veil = make("div", "pd-veil pd-map-window");
  const card = make("div", "pd-solid", {
    role: "dialog",
    "aria-label": "Choose a part of the map",
    "aria-modal": "true",
  });
  const title = make("b");
  const named = { tabindex: 0, role: "img", "aria-label": "Map with the square; arrow keys move it" };
  const [map, road, rect] = [svg("svg", "", named), svg("path"), svg("rect")];
  map.append(road, rect); // y is down in them, and north up
  const size = make("input", "", { type: "number", min: LEAST_M, step: 10 });
  const label = make("label", "", {}, "Half side (m) ");
  const told = make("span");
  const cancel = () => api.send({ kind: "cancel" });
  const foot = make("div", "pd-map-window-foot");
  label.append(size);
  foot.append(
    label,
    told,
    button("", "Cancel", cancel),
    button("pd-map-window-open", "Open this part", () => api.send({ kind: "open", square })),
  );
  card.append(title, map, foot);
  veil.append(card);
  veil.hidden = true;
  api.box.append(veil);

  function draw() {
    const [x, y, half] = square;
    const box = { x: x - half, y: -y - half, width: 2 * half, height: 2 * half };
    for (const [name, value] of Object.entries(box)) rect.setAttribute(name, String(value));
    told.textContent = `${Math.round(2 * half)} \u00d7 ${Math.round(2 * half)} m`;
    if (document.activeElement !== size) size.value = half.toFixed(0);
  }
  function metres(event: PointerEvent): Ground {
    const at = new DOMPoint(event.clientX, event.clientY);
    const { x, y } = at.matrixTransform(map.getScreenCTM()?.inverse());
    return [x, -y];
  }

  map.addEventListener("pointerdown", (event) => {
    size.blur();
    press = metres(event);
    map.setPointerCapture(event.pointerId);
    square = [...press, square[2]];
    draw();
  });
  map.addEventListener("pointermove", (event) => {
    const spanned = press && squareBetween(press, metres(event));
    if (!spanned || spanned[2] < LEAST_M) return;
    square = spanned;
    draw();
  });
  map.addEventListener("pointerup", () => {
    press = null;
  });
  size.addEventListener("input", () => {
    square = [square[0], square[1], Math.max(Number(size.value), LEAST_M)];
    draw();
  });
  // Keys belong to the dialog while it is open.
  hearFirst("keydown", (event) => {
    if (veil.hidden) return;
    event.stopPropagation();
    if (event.key === "Escape") cancel();
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!by || event.target === size) return;
    event.preventDefault();
    const step = square[2] * (event.shiftKey ? 1 : 0.1);
    square = [square[0] + by[0] * step, square[1] + by[1] * step, square[2]];
    draw();
  });
  let before: HTMLElement | null = null;

  return (state) => {
    if (!state.road && !veil.hidden) before?.focus();
    if (state.road && veil.hidden) before = document.activeElement as HTMLElement | null;
    veil.hidden = !state.road;
    if (veil.hidden) return;
    square = [...state.square];
    title.textContent = state.title;
    road.setAttribute("d", state.road);
    map.setAttribute("viewBox", state.view);
    draw();
    map.focus();
  };
});
