// Placing: a crosshair, a ghost under the pointer, a press that is dragged to turn it.
import { ground, project } from "../bridge.ts";
import { svg } from "../dom.ts";
import { define, modePress, onDigit, onView, paced } from "../frame.ts";
import { along, distance, type Ground, isSeen, type Pixel } from "../geometry.ts";
import type { PlacingState } from "../messages.ts";

const TURN_PX = 8;
const ASK_MS = 60;

define("placing", (api) => {
  let mode: PlacingState | null = null;
  let at: Pixel | null = null;
  const press = modePress<{ at: Pixel; point: Ground; heading: number | null }>("pd-crosshair", {
    begin(pixel) {
      at = pixel;
      const point = ground(...pixel);
      return point && { at: pixel, point, heading: null };
    },
    drag(held, pixel) {
      at = pixel;
      const isFar = distance(pixel, held.at) > TURN_PX;
      const point = isFar ? ground(...pixel) : null;
      if (point) held.heading = Math.atan2(point[1] - held.point[1], point[0] - held.point[0]);
      else if (!isFar) held.heading = null;
    },
    release({ point, heading }) {
      api.send({ kind: "place", point, headingRad: heading });
    },
    hover(pixel, event) {
      at = pixel;
      if (at && event.buttons === 0) ask();
    },
    draw,
  });

  const drawing = svg("svg", "pd-placing-ghost", { "aria-hidden": "true" });
  const [base, edges, arrow] = ["base", "edges", "arrow"].map((name) => svg("path", `pd-placing-${name}`));
  drawing.append(base, edges, arrow);
  api.box.append(drawing);

  function draw() {
    const place = press.isOn ? (press.held?.point ?? (at && ground(...at))) : null;
    const lines = mode && place && ghost(mode, place, press.held?.heading ?? mode.headingRad);
    drawing.style.display = lines ? "" : "none";
    if (!mode || !lines) return;
    [base, edges, arrow].forEach((path, index) => {
      path.setAttribute("d", lines[index]);
    });
    drawing.style.setProperty("--pd-placing", mode.color);
  }

  // Its ground plan, its edges and its arrow, as SVG; null where a part is not seen.
  function ghost(state: PlacingState, place: Ground, heading: number): string[] | null {
    const [length, width, height] = state.sizeM;
    const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
    const pixel = (forward: number, left: number, up: number) =>
      project([place[0] + forward * cos - left * sin, place[1] + forward * sin + left * cos, up]);
    const ring = (up: number) => [
      pixel(length / 2, width / 2, up),
      pixel(length / 2, -width / 2, up),
      pixel(-length / 2, -width / 2, up),
      pixel(-length / 2, width / 2, up),
    ];
    const reach = length / 2 + Math.max(2.2, length * 0.4);
    const [low, high] = [ring(0), ring(height)];
    const [tail, tip, left, right] = [
      pixel(length / 2 + 0.3, 0, 0),
      pixel(reach, 0, 0),
      pixel(reach - 0.9, 0.6, 0),
      pixel(reach - 0.9, -0.6, 0),
    ];
    if (![...low, ...high, tail, tip, left, right].every(isSeen)) return null;
    return [
      `${along(low)}Z`,
      `${along(high)}Z${low.map((point, index) => along([point, high[index]])).join("")}`,
      along([tail, tip]) + along([left, tip, right]),
    ];
  }

  const { ask } = paced(ASK_MS, () => {
    const point = press.isOn && !press.held && at ? ground(...at) : null;
    if (point) api.send({ kind: "point", point });
    return point !== null;
  });

  onDigit(
    () => (press.isOn && mode ? mode.numKinds : 0),
    (number) => api.send({ kind: "kind", number }),
  );

  onView(draw);
  return (state) => {
    mode = state;
    press.turn(state.isActive);
    draw();
  };
});
