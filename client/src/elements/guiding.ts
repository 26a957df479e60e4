// Drawing a guidance term: a click on the road, a line drawn on it, or another agent. A line
// is drawn by a drag, or from point to point by clicks: Enter, or another click on the last
// point, such as a double click, ends it; Backspace takes the last point back. Points that
// are clicked snap to lanes, unless Alt is held.
import { ground, project, ray } from "../bridge.ts";
import { svg } from "../dom.ts";
import { define, hearFirst, local, modePress, onView, paced, Tip, take } from "../frame.ts";
import { along, bow, distance, type Ground, head, isSeen, type Pixel } from "../geometry.ts";
import { flag, haloed } from "../guidance_shapes.ts";
import type { GuidingState } from "../messages.ts";

const ASK_MS = 60;
const APART_PX = 2;
const SAME_PX = 8;
const MAX_POINTS = 1500;

define("guiding", (api) => {
  const layer = svg("svg", "pd-guide-marks pd-guide-drawing");
  api.box.append(layer);
  const tip = new Tip(api.box);
  let state: GuidingState | null = null;
  let at: Pixel | null = null;
  let line: Ground[] = []; // Points that were clicked, after the agent's place.
  let isClicked = false; // Whether all of them were.
  const press = modePress<{ at: Pixel; points: Ground[] | null }>("pd-guiding", {
    begin(pixel) {
      at = pixel;
      const point = ground(...pixel);
      return { at: pixel, points: state?.gesture === "draw" ? (point ? [point] : []) : null };
    },
    drag(held, pixel) {
      at = pixel;
      const isFar = held.points && distance(pixel, held.at) >= APART_PX;
      const point = isFar ? ground(...pixel) : null;
      if (!held.points || !point || held.points.length >= MAX_POINTS) return;
      held.points.push(point);
      held.at = pixel;
    },
    hover(pixel, event) {
      at = pixel;
      if (at && event.buttons === 0) ask();
    },
    release({ points }, event) {
      const pixel = local(event);
      const seen = points ? null : ray(...pixel);
      if (state && points) addToLine(points, state, event.altKey);
      else if (state && seen) api.send({ kind: "click", tool: state.kind, at: pixel, ray: seen });
    },
    draw,
  });

  function stroke(parent: Element, pixels: readonly (Pixel | null)[], isArrow: boolean) {
    parent.append(...haloed(along(pixels)));
    if (isArrow) parent.append(svg("path", "pd-guide-line", { d: head(pixels) }));
  }

  function draw() {
    layer.replaceChildren();
    tip.hide();
    if (!state?.isActive) return;
    const { kind, gesture, ghost } = state;
    const refused = ghost.isBad ? "pd-guide-refused" : "";
    const parent = svg("g", `pd-guide pd-guide-${kind} pd-guide-chosen ${refused}`);
    layer.append(parent);
    if (gesture === "draw") {
      const next = line.length && at ? ground(...at) : null;
      const rest = press.held?.points ?? (next ? [next] : []);
      const points = [...line, ...rest].map(project);
      if (points.length > 1) stroke(parent, points, true);
      for (const [cx, cy] of line.map(project).filter(isSeen))
        parent.append(svg("circle", "pd-guide-point", { cx, cy, r: 4 }));
    } else if (gesture === "pick") {
      const from = project(state.start);
      const to = ghost.end ? project(ghost.end) : at;
      if (from && to) stroke(parent, bow(from, to), true);
    } else if (ghost.points) stroke(parent, ghost.points.map(project), kind !== "stop-at-line");
    else if (kind === "goal-point" && at) {
      const picture = flag();
      picture.setAttribute("transform", `translate(${at[0]} ${at[1]})`);
      parent.append(picture);
    }
    if (at && !press.held && ghost.text) tip.tell([ghost.text], at);
  }

  const { ask } = paced(ASK_MS, () => {
    if (!state?.isActive || press.held || !at || state.gesture === "draw") return false;
    const seen = ray(...at);
    if (seen) api.send({ kind: "point", tool: state.kind, at, ray: seen });
    return seen !== null;
  });

  function finish({ kind }: GuidingState) {
    const rounded = (value: number) => Math.round(value * 100) / 100;
    const points = line.map(([x, y]): Ground => [rounded(x), rounded(y)]);
    line = [];
    api.send({ kind: "drawn", tool: kind, points, isClicked });
  }
  function isNear(one: Ground, other: Ground | undefined): boolean {
    const [here, there] = [project(one), other ? project(other) : null];
    return here !== null && there !== null && distance(here, there) <= SAME_PX;
  }

  // A drag is the whole line, or goes on with one that was begun by clicks.
  function addToLine(points: Ground[], mode: GuidingState, isFree: boolean) {
    const isClick = points.length > 0 && points.every((point) => isNear(point, points[0]));
    if (isClick && line.length > 1 && isNear(points[0], line.at(-1))) {
      finish(mode);
      return;
    }
    const isWhole = !isClick && !line.length;
    isClicked = isClick && !isFree && (isClicked || !line.length);
    if (isClick && !line.length) line.push([mode.start[0], mode.start[1]]);
    line.push(...(isClick ? [points[0]] : points));
    if (isWhole) finish(mode);
  }
  hearFirst("keydown", (event) => {
    if (!state?.isActive || !line.length || press.held) return;
    if (event.key !== "Enter" && event.key !== "Backspace") return;
    take(event);
    if (event.key === "Enter") finish(state);
    else if (line.pop() && line.length === 1) line = [];
    draw();
  });

  onView(draw);
  return (next) => {
    if (!next.isActive || next.kind !== state?.kind) {
      press.giveUp();
      line = [];
    }
    state = next;
    press.turn(state.isActive);
    draw();
  };
});
