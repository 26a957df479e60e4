// Marks of guidance terms on the road: flags, paths, way-points, stop lines, arrows and
// badges. Flags, way-points and stop lines are dragged; a click on any mark chooses its term.
import { ground, project } from "../bridge.ts";
import { svg, within } from "../dom.ts";
import {
  define,
  followPress,
  hearFirst,
  isPanPress,
  local,
  markBody,
  onDispose,
  onView,
  type Press,
  paced,
  Tip,
  take,
} from "../frame.ts";
import { along, bow, distance, type Ground, halfWay, head, isSeen, type Pixel, type Place } from "../geometry.ts";
import { flag, haloed, plate } from "../guidance_shapes.ts";
import type { GuidanceBadge, GuidanceMark, GuidanceMarksEvent, GuidanceMarksState } from "../messages.ts";
import { circle, taken } from "../shared.ts";

const STILL_PX = 4;
const SEND_MS = 50;
const SETTLE_MS = 700;
const HELD_BACK_PX = 16; // Arrows begin and end outside the agents.
const BADGE_PX = 23;
// Around an offered flag's foot: agents in there could not be pressed.
const COVERED_PX = { left: -20, right: 37, top: -48, bottom: 2 };
const DRAGGED = ["flag", "line", "dot"];
const APART_PX = 44; // A way-point is offered between points that are so far apart.
const MISSED_PX = 5;
const MODES = ["pd-crosshair", "pd-bending", "pd-drawing-region", "pd-guiding"];

type Drawn = GuidanceBadge & Partial<GuidanceMark>;
interface Hold extends Press {
  mark: Drawn;
  /** Where the mark is dragged to; null until it moves. */
  point: Ground | null;
  pointer: Pixel;
  offset: Pixel;
  known: ReadonlySet<number>;
  isFree: boolean;
}

const keyOf = ({ index, node, isOffer }: Drawn): string =>
  node == null ? String(index) : `${index} ${node} ${isOffer}`;

define("guidance_marks", (api) => {
  const layer = svg("svg", "pd-guide-marks");
  api.box.append(layer);
  const tip = new Tip(api.box);
  let state: GuidanceMarksState = { marks: [], agents: [], refusal: "" };
  let press: Hold | null = null; // the mark that is held
  let settling: Hold | null = null; // a mark that was dropped, until the server has answered
  let pointed: number | null = null; // the index of the arc under the pointer

  const isMode = () => MODES.some((name) => document.body.classList.contains(name));
  const cover = (left: number, top: number, right: number, bottom: number) =>
    taken.push({ left, top, width: right - left, height: bottom - top });

  // Not drawn from the server's state: the held mark, and the term it has just become.
  function isHeldBack(mark: GuidanceMark): boolean {
    const hold = press ?? settling;
    if (!hold?.point || mark.shape === "badge") return false;
    // The line of a way-point follows it; a new one is drawn in the place of its offer.
    if (hold.mark.shape === "dot")
      return keyOf(mark) === keyOf(hold.mark) || (mark.isOffer && hold.mark.isOffer) === true;
    return mark.index === hold.mark.index || !hold.known.has(mark.index);
  }

  function group(mark: Drawn): SVGGElement {
    const classes = ["pd-guide", `pd-guide-${mark.kind}`];
    if (!mark.isOn) classes.push("pd-guide-off");
    if (mark.isFaint) classes.push("pd-guide-faint");
    if (mark.isChosen) classes.push("pd-guide-chosen");
    if (mark.isOffer) classes.push("pd-guide-offer");
    if (DRAGGED.includes(mark.shape ?? "")) classes.push("pd-guide-drags");
    return svg("g", classes.join(" "), { "data-guide": keyOf(mark) });
  }

  function put(parent: Element, picture: Element, [x, y]: Pixel) {
    picture.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
    parent.append(picture);
  }

  function warn(parent: Element, mark: Drawn, [x, y]: Pixel) {
    if (!mark.isBad) return;
    const badge = svg("g", "pd-guide-warning");
    const sign = svg("text", "", { "text-anchor": "middle", y: 4 }, "!");
    badge.append(svg("circle", "", { r: 7 }), sign);
    put(parent, badge, [x, y]);
  }

  function drawPlate(parent: Element, mark: Drawn, at: Pixel) {
    put(parent, plate(mark.kind), at);
    warn(parent, mark, [at[0] + 10, at[1] - 10]);
  }

  // From where the agent should be to where it is at that time.
  function drawMissed(mark: Drawn, parent: Element, [x, y]: Pixel) {
    const there = mark.achieved ? project(mark.achieved) : null;
    if (!there || mark.isFaint || distance(there, [x, y]) < MISSED_PX) return;
    parent.append(svg("path", "pd-guide-missed", { d: along([[x, y], there]) }));
    parent.append(svg("circle", "pd-guide-missed", { cx: there[0], cy: there[1], r: 4 }));
  }

  function drawDot(mark: Drawn, parent: Element) {
    const [from, to] = (mark.points ?? []).map(project);
    if (mark.isOffer && !(from && to && distance(from, to) > APART_PX)) return;
    const at: Pixel | null =
      from && to ? [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2] : mark.point ? project(mark.point) : null;
    if (!at) return;
    drawMissed(mark, parent, at);
    const dot = svg("g");
    dot.append(
      svg("circle", "pd-guide-hit", { r: 11 }),
      svg("circle", "pd-guide-point", { r: mark.isOffer ? 3.5 : 6 }),
    );
    if (mark.label) dot.append(svg("text", "pd-guide-label", { x: 11, y: 4 }, mark.label));
    put(parent, dot, at);
  }

  function isCovered(x: number, y: number): boolean {
    const { left, right, top, bottom } = COVERED_PX;
    return left < x && x < right && top < y && y < bottom;
  }

  function drawFlag(mark: Drawn, parent: Element) {
    const foot = mark.point ? project(mark.point) : null;
    if (!foot) return;
    const from = mark.start ? project(mark.start) : null;
    if (mark.isOffer && from && isCovered(from[0] - foot[0], from[1] - foot[1])) return;
    if (from && !mark.isFaint && !mark.isOffer)
      parent.append(svg("path", "pd-guide-leader", { d: along([from, foot]) }));
    drawMissed(mark, parent, foot);
    put(parent, flag(mark.isOffer), foot);
    cover(foot[0] - 9, foot[1] - 34, foot[0] + 24, foot[1] + 8);
    warn(parent, mark, [foot[0] + 20, foot[1] - 31]);
  }

  function drawPath(mark: Drawn, parent: Element) {
    const pixels = (mark.points ?? []).map(project);
    const line = along(pixels);
    if (!line) return;
    // The line takes no clicks: agents that are to be dragged stand on it.
    parent.append(...haloed(line), ...haloed(head(pixels)));
    const seen = pixels.filter(isSeen);
    // Way-points are pressed in the place of the plate.
    const hasDots = state.marks.some(({ shape, index }) => shape === "dot" && index === mark.index);
    if (hasDots) warn(parent, mark, [seen[seen.length - 1][0] + 14, seen[seen.length - 1][1] - 12]);
    else drawPlate(parent, mark, halfWay(seen));
  }

  function drawLine(mark: Drawn, parent: Element) {
    const pixels = (mark.points ?? []).map(project);
    if (!pixels.every(isSeen)) return;
    const line = along(pixels);
    parent.append(svg("path", "pd-guide-hit-line", { d: line }), ...haloed(line));
    const [xs, ys] = [0, 1].map((axis) => pixels.map((point) => point[axis]));
    cover(Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys));
    const [first, last] = pixels;
    const share = 15 / (distance(last, first) || 1);
    const beyond = (axis: 0 | 1) => first[axis] - (last[axis] - first[axis]) * share;
    drawPlate(parent, mark, [beyond(0), beyond(1)]);
  }

  const bowOf = ({ start, end }: Drawn): Pixel[] | null => {
    const [from, to] = [start ? project(start) : null, end ? project(end) : null];
    return from && to && bow(from, to);
  };

  function drawArrow(mark: Drawn, parent: Element) {
    const points = bowOf(mark);
    if (!points) return;
    const ends = [points[0], points[points.length - 1]];
    const shown = points.filter((point) => ends.every((end) => distance(point, end) > HELD_BACK_PX));
    if (shown.length > 1) {
      const tip = svg("path", "pd-guide-line pd-guide-head", { d: head(shown) });
      parent.append(...haloed(along(shown)), tip);
    }
    drawPlate(parent, mark, points[points.length >> 1]);
  }

  // What could happen: a thin arc, and where it is pointed at the agent's way.
  function drawArc(mark: Drawn, parent: Element) {
    const points = bowOf(mark);
    if (!points) return;
    parent.classList.add("pd-guide-arc");
    for (const name of ["pd-guide-hit-line", "pd-guide-line"]) parent.append(svg("path", name, { d: along(points) }));
    parent.append(svg("path", "pd-guide-line", { d: head(points, 7) }));
    if (!mark.points) return;
    const way = mark.points.map(project);
    parent.append(...haloed(along(way) + head(way)));
  }

  function drawBadges(badges: readonly GuidanceBadge[], place: Place | null) {
    const at = place && project(place);
    if (!at) return;
    badges.forEach((badge, index) => {
      const parent = group(badge);
      const x = at[0] + (index - (badges.length - 1) / 2) * BADGE_PX;
      put(parent, plate(badge.kind, 10), [x, at[1] + 30]);
      warn(parent, badge, [x + 9, at[1] + 22]);
      layer.append(parent);
    });
  }

  const drawings = { flag: drawFlag, dot: drawDot, path: drawPath, line: drawLine, arrow: drawArrow, arc: drawArc };
  function drawMark(mark: Drawn) {
    if (mark.shape === "badge") drawBadges(mark.badges ?? [], mark.at ?? null);
    if (!mark.shape || mark.shape === "badge") return;
    const parent = group(mark);
    drawings[mark.shape](mark, parent);
    layer.append(parent);
  }

  function draw() {
    layer.replaceChildren();
    taken.length = 0;
    for (const mark of state.marks) if (!isHeldBack(mark)) drawMark(mark);
    const hold = press ?? settling;
    if (!hold?.point) return;
    const isBad = state.refusal !== "";
    const mark = { ...hold.mark, isOffer: false, isFaint: false, isChosen: true, isBad };
    if (mark.shape === "flag" || mark.shape === "dot")
      drawMark({ ...mark, point: hold.point, points: null, achieved: null });
    // The line snaps to a lane: where, the server says.
    else drawMark(state.marks.find((one) => one.index === mark.index) ?? mark);
    if (isBad) layer.lastElementChild?.classList.add("pd-guide-refused");
  }

  // Agents under arcs are pressed as those beside them are.
  function isOverAgent(at: Pixel): boolean {
    return state.agents.some(([x, y, z, radius]) => {
      const seen = circle([x, y, z], radius);
      return seen && distance(seen.at, at) <= Math.max(HELD_BACK_PX, seen.radius);
    });
  }

  function markOf(event: Event): Drawn | null {
    const found = within(event, "[data-guide]");
    if (!found || !layer.contains(found)) return null;
    const all = state.marks.flatMap((mark): readonly Drawn[] => (mark.shape === "badge" ? mark.badges : [mark]));
    return all.find((mark) => keyOf(mark) === found.dataset.guide) ?? null;
  }

  const tellRefusal = (at: Pixel) => tip.tell(state.refusal ? [state.refusal] : [], at);

  const send = (kind: GuidanceMarksEvent["kind"], { mark, point, isFree }: Hold) =>
    api.send({ kind, index: mark.index, point, node: mark.node ?? null, isOffer: mark.isOffer === true, isFree });
  const { ask: sendDrag, stop: stopDrag } = paced(SEND_MS, () => {
    if (press?.point) send("drag", press);
    return true;
  });

  function end(kind: "drop" | "cancel", held: Hold) {
    stopDrag();
    send(kind, held);
    tip.hide();
    settling = kind === "drop" && held.point ? held : null;
    press = null;
    markBody("pd-guide-dragging", false);
    const mine = settling;
    setTimeout(() => {
      if (settling !== mine) return;
      settling = null;
      draw();
    }, SETTLE_MS);
    draw();
  }

  hearFirst("pointerdown", (event) => {
    tip.hide();
    if (event.button !== 0 || isMode() || isPanPress()) return;
    const mark = markOf(event);
    if (!mark) return;
    take(event);
    const at = local(event);
    const foot = (mark.shape !== "line" && mark.point && project(mark.point)) || at;
    press = {
      id: event.pointerId,
      mark,
      at,
      pointer: at,
      point: null,
      offset: [foot[0] - at[0], foot[1] - at[1]],
      known: new Set(state.marks.map((one) => one.index)),
      isFree: event.altKey,
    };
    settling = null;
    send("grab", press);
  });

  hearFirst("pointermove", (event) => {
    const at = local(event);
    if (press && event.pointerId === press.id) {
      take(event);
      const isStill = distance(at, press.at) <= STILL_PX;
      if (!press.point && (isStill || !DRAGGED.includes(press.mark.shape ?? ""))) return;
      const point = ground(at[0] + press.offset[0], at[1] + press.offset[1]);
      if (!point) return;
      markBody("pd-guide-dragging", true);
      press.point = point;
      press.pointer = at;
      press.isFree = event.altKey;
      sendDrag();
      draw();
      tellRefusal(at);
      return;
    }
    if (event.buttons !== 0 || isMode()) {
      tip.hide();
      return;
    }
    const isOver = isOverAgent(at);
    layer.classList.toggle("pd-guide-over-agent", isOver);
    const found = markOf(event);
    const mark = isOver && found?.shape === "arc" ? null : found;
    tip.tell(mark?.lines ?? [], at);
    const index = mark?.shape === "arc" ? mark.index : null;
    if (index !== pointed) api.send({ kind: "point", index });
    pointed = index;
  });

  followPress(
    () => press,
    (_event, held) => end("drop", held),
    () => {
      if (press) end("cancel", { ...press, point: null });
    },
  );

  onView(draw);
  onDispose(() => markBody("pd-guide-dragging", false));
  return (next) => {
    const wasRefused = state.refusal;
    state = next;
    if (!press) settling = null;
    markBody(
      "pd-arcs",
      state.marks.some((mark) => mark.shape === "arc"),
    );
    draw();
    if (press?.point && state.refusal !== wasRefused) tellRefusal(press.pointer);
  };
});
