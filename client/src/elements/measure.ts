// Distances on the ground: click points; each stretch and the whole way have a label.
import { ground, project } from "../bridge.ts";
import { hasModifier, isTyping, make, svg } from "../dom.ts";
import { define, hearFirst, local, onView } from "../frame.ts";
import { distance, type Ground, isSeen, type Pixel } from "../geometry.ts";
import type { MeasureState } from "../messages.ts";

const SAME_PX = 4;
const LEAST_TOLD_M = 0.05;

const metres = (value: number) => `${value.toFixed(value < 100 ? 1 : 0)} m`;

define("measure", (api) => {
  const layer = make("div", "pd-picture pd-measure-layer pd-gone");
  const drawing = svg("svg");
  const labels = make("div");
  layer.append(drawing, labels);
  api.box.append(layer);
  let state: MeasureState = { isActive: false, start: null, speed: null, agent: "" };
  let points: Ground[] = []; // on the ground, in metres
  let isComplete = false;
  let pointer: Pixel | null = null; // pixel under the mouse

  function line(from: Pixel, to: Pixel, name: string) {
    const ends = { x1: from[0], y1: from[1], x2: to[0], y2: to[1] };
    drawing.append(svg("line", "pd-measure-halo", ends), svg("line", name, ends));
  }

  function label(at: Pixel, lines: readonly string[], name: string) {
    const element = make("div", `pd-measure-label ${name}`);
    for (const text of lines) element.append(make("div", "", {}, text));
    element.style.transform = `translate(${at[0]}px, ${at[1]}px)`;
    labels.append(element);
  }

  function draw() {
    drawing.replaceChildren();
    labels.replaceChildren();
    if (!state.isActive) return;
    const preview = !isComplete && points.length && pointer ? ground(...pointer) : null;
    const way = preview ? [...points, preview] : points;
    const pixels = way.map(project);
    let total = 0;
    for (let i = 1; i < way.length; i += 1) {
      const [from, to] = [pixels[i - 1], pixels[i]];
      const length = distance(way[i - 1], way[i]);
      total += length;
      if (!from || !to) continue;
      const isOpen = preview && i === way.length - 1;
      line(from, to, isOpen ? "pd-measure-open" : "pd-measure-line");
      // The last stretch is told by the label at its end when it is the only one.
      const middle: Pixel = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
      if (way.length > 2 && length >= LEAST_TOLD_M) label(middle, [metres(length)], "pd-measure-part");
    }
    for (const [cx, cy] of pixels.slice(0, points.length).filter(isSeen))
      drawing.append(svg("circle", "", { cx, cy, r: 4 }));
    const end = pixels.at(-1);
    if (way.length < 2 || !end) return;
    const lines = [way.length > 2 ? `${metres(total)} in all` : metres(total)];
    const { speed, agent } = state;
    if (speed !== null) lines.push(`${(total / speed).toFixed(1)} s at ${speed.toFixed(1)} m/s (${agent})`);
    label(end, lines, "pd-measure-total");
  }

  layer.addEventListener("click", (event) => {
    if (event.button !== 0) return;
    if (event.detail === 2) {
      isComplete = points.length > 1;
      draw();
      return;
    }
    const at = local(event);
    const point = ground(...at);
    if (!point) return;
    if (isComplete) points = [];
    isComplete = false;
    // A second click on the last point adds nothing.
    const last = points.at(-1);
    const drawn = last && project(last);
    if (drawn && distance(at, drawn) < SAME_PX) return;
    points.push(point);
    draw();
  });
  function follow(at: Pixel | null) {
    pointer = at;
    draw();
  }
  layer.addEventListener("pointermove", (event) => follow(local(event)));
  layer.addEventListener("pointerleave", () => follow(null));
  // While one measures, these take back points and never delete agents.
  hearFirst("keydown", (event) => {
    if (!state.isActive || hasModifier(event) || isTyping(event)) return;
    if (event.key === "Enter" && !(event.target instanceof HTMLButtonElement)) isComplete = points.length > 1;
    else if (event.key === "Backspace" || event.key === "Delete") {
      points.pop();
      isComplete = false;
    } else return;
    event.preventDefault();
    event.stopPropagation();
    draw();
  });
  onView(draw);

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
