// Drawing a guidance term: a click on the road, a line drawn on it, or another agent. A line
// is drawn by a drag, or from point to point by clicks: Enter, or another click on the last
// point, such as a double click, ends it; Backspace takes the last point back. Points that
// are clicked snap to lanes, unless Alt is held.
//
// While the mode is on, left presses on the picture belong to it: viser does not hear
// them, so that neither the camera turns nor a rectangle is drawn.
import { ground, project, ray } from "../bridge.ts";
import { make, svg } from "../dom.ts";
import {
  define,
  followPress,
  hearFirst,
  isModePress,
  isOnPicture,
  local,
  markBody,
  onDispose,
  onView,
  type Press,
  paced,
  pictureSize,
  take,
} from "../frame.ts";
import { along, bow, distance, type Ground, head, isSeen, type Pixel } from "../geometry.ts";
import { flag, haloed } from "../guidance_shapes.ts";
import type { GuidingState } from "../messages.ts";

const ASK_MS = 60;
const APART_PX = 2;
const SAME_PX = 8;
const MAX_POINTS = 1500;

define("guiding", (api) => {
  const layer = svg("svg", "pd-guide-marks pd-guide-drawing");
  const tip = make("div", "pd-tip pd-guide-tip", { role: "tooltip" });
  tip.hidden = true;
  api.box.append(layer, tip);
  let state: GuidingState | null = null;
  let at: Pixel | null = null;
  let press: (Press & { points: Ground[] | null }) | null = null;
  let line: Ground[] = []; // Points that were clicked, after the agent's place.
  let isClicked = false; // Whether all of them were.

  function stroke(parent: Element, pixels: readonly (Pixel | null)[], isArrow: boolean) {
    parent.append(...haloed(along(pixels)));
    if (isArrow) parent.append(svg("path", "pd-guide-line", { d: head(pixels) }));
  }

  function draw() {
    layer.replaceChildren();
    tip.hidden = true;
    if (!state?.isActive) return;
    const { kind, gesture, ghost } = state;
    const refused = ghost.isBad ? "pd-guide-refused" : "";
    const parent = svg("g", `pd-guide pd-guide-${kind} pd-guide-chosen ${refused}`);
    layer.append(parent);
    if (gesture === "draw") {
      const next = line.length && at ? ground(...at) : null;
      const rest = press?.points ?? (next ? [next] : []);
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
    tip.hidden = !at || press !== null || !ghost.text;
    if (!at || tip.hidden) return;
    tip.textContent = ghost.text;
    tip.style.left = `${Math.min(at[0] + 18, pictureSize().width - 200)}px`;
    tip.style.top = `${at[1] + 18}px`;
  }

  const { ask } = paced(ASK_MS, () => {
    if (!state?.isActive || press || !at || state.gesture === "draw") return false;
    const seen = ray(...at);
    if (seen) api.send({ kind: "point", tool: state.kind, at, ray: seen });
    return seen !== null;
  });

  hearFirst("pointerdown", (event) => {
    if (!state?.isActive || !isModePress(event)) return;
    take(event);
    at = local(event);
    const point = ground(...at);
    const points = state.gesture === "draw" ? (point ? [point] : []) : null;
    press = { id: event.pointerId, at, points };
    draw();
  });

  hearFirst("pointermove", (event) => {
    if (!state?.isActive) return;
    if (press && event.pointerId !== press.id) return;
    at = press || isOnPicture(event) ? local(event) : null;
    if (press?.points && at) {
      const isFar = distance(at, press.at) >= APART_PX;
      const point = isFar ? ground(...at) : null;
      if (point && press.points.length < MAX_POINTS) {
        press.points.push(point);
        press.at = at;
      }
    } else if (at && event.buttons === 0) ask();
    draw();
  });

  function giveUp() {
    press = null;
    draw();
  }
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
    if (!state?.isActive || !line.length || press) return;
    if (event.key !== "Enter" && event.key !== "Backspace") return;
    take(event);
    if (event.key === "Enter") finish(state);
    else if (line.pop() && line.length === 1) line = [];
    draw();
  });

  followPress(
    () => press,
    (event, { points }) => {
      const pixel = local(event);
      const seen = points ? null : ray(...pixel);
      if (state && points) addToLine(points, state, event.altKey);
      else if (state && seen) api.send({ kind: "click", tool: state.kind, at: pixel, ray: seen });
      giveUp();
    },
    giveUp,
  );

  onView(draw);
  onDispose(() => markBody("pd-guiding", false));
  return (next) => {
    if (!next.isActive || next.kind !== state?.kind) [press, line] = [null, []];
    state = next;
    markBody("pd-guiding", state.isActive);
    draw();
  };
});
