// The speeds of the selected agent above the timeline, in step with its track. A drag
// pulls the curve where it was pressed; arrow keys do where the playhead is.
import { inWords } from "../clock.ts";
import { button, icon, make, recall, remember, svg } from "../dom.ts";
import { define, followPress, listen, onDispose, paced, root } from "../frame.ts";
import { along, clamp, type Pixel } from "../geometry.ts";
import type { SpeedCurveState } from "../messages.ts";
import { clock, playheadMoved, track } from "../shared.ts";

const HEIGHT = 64;
const TOP = 14;
const BOTTOM = 5;
const GUTTER = 32;
const PULL_PAUSE_MS = 30;
const KEY_MPS = 0.5;
const FINE = 0.2; // Of a pull with Shift.
const KEY_FOLDED = "pd-speed-folded";
const ROOMY_PX = 700; // In a lower window the curve is folded until it is asked for.
const KEY_REST_MS = 800;

interface Pull {
  id: number;
  step: number;
  startY: number;
  from: number;
  speed: number;
}

define("speedCurve", (api) => {
  let state: SpeedCurveState = { agent: "", beginStep: 0, speeds: [], former: [], harsh: [] };
  let top = 10; // m/s at the upper edge; kept while the curve is pulled
  let pull: Pull | null = null;
  let keyRest: ReturnType<typeof setTimeout> | undefined;
  const box = make("div", "pd-solid pd-speed-curve", { role: "group", tabindex: 0 });
  const picture = svg("svg", "", { "aria-hidden": "true" });
  const title = make("span", "pd-speed-title");
  const value = make("output", "pd-speed-value");
  const isFolded = () => recall(KEY_FOLDED) ?? window.innerHeight < ROOMY_PX;
  const fold = button("pd-speed-fold", "", () => {
    remember(KEY_FOLDED, !isFolded());
    draw();
  });
  fold.append(icon("M1.5 12.5h2c3 0 3-8 6-8s2 4 5 4", 16, "pd-speed-icon"));
  fold.setAttribute("aria-label", "Curve of speed");
  track.box?.after(fold);
  box.append(picture, title, value);
  api.box.append(box);

  const speedAt = (step: number) => state.speeds[step - state.beginStep] ?? null;
  const left = () => (track.box?.getBoundingClientRect().left ?? 0) - box.getBoundingClientRect().left;
  const width = () => track.box?.offsetWidth ?? 0;
  const x = (step: number) => left() + track.share(step) * width();
  const y = (speed: number) => HEIGHT - BOTTOM - (speed / top) * (HEIGHT - TOP - BOTTOM);
  function stepAt(event: MouseEvent): number {
    const at = event.clientX - box.getBoundingClientRect().left - left();
    const share = (step: number) => track.share(step) * width();
    return Math.round((at - share(0)) / (share(1) - share(0) || 1));
  }

  function draw() {
    const isShown = Boolean(state.agent) && !isFolded();
    box.hidden = !isShown;
    root.classList.toggle("pd-shows-speed", isShown);
    fold.title = isFolded() ? "Show speed of one selected agent" : "Hide speed of the selected agent";
    fold.setAttribute("aria-pressed", String(!isFolded()));
    if (!isShown) return;
    box.setAttribute("aria-label", `Speed of ${state.agent}: arrows up and down change it at the time shown`);
    title.textContent = `Speed of ${state.agent}, m/s`;
    if (!pull) {
      const known = [...state.speeds, ...state.former].filter((one) => one !== null);
      top = Math.max(5, Math.ceil((1.15 * Math.max(...known)) / 5) * 5);
    }
    const pixel = (speed: number | null, index: number): Pixel | null =>
      speed === null ? null : [x(state.beginStep + index), y(speed)];
    const line = (name: string, speeds: readonly (number | null)[]) =>
      svg("path", name, { d: along(speeds.map(pixel)) });
    const lastStep = state.beginStep + state.speeds.length - 1;
    const [begin, zero, end] = [x(state.beginStep), x(0), x(lastStep)];
    title.style.maxWidth = `${begin - GUTTER}px`; // It wraps beside the numbers of the axis.
    const grid = [0, top / 2, top].flatMap((speed) => [
      svg("line", "pd-chart-grid", { x1: begin, x2: end, y1: y(speed), y2: y(speed) }),
      svg("text", "pd-chart-text", { x: begin - 5, y: y(speed) + 3.5 }, String(speed)),
    ]);
    const harsh = new Set(state.harsh);
    const hard = state.speeds.map((speed, index) => (harsh.has(state.beginStep + index) ? speed : null));
    picture.replaceChildren(
      ...grid,
      svg("rect", "pd-speed-past", { x: begin, y: 0, width: Math.max(zero - begin, 0), height: HEIGHT }),
      line("pd-speed-former", state.former),
      line("pd-speed-line", state.speeds),
      line("pd-speed-line pd-speed-harsh", hard),
      head,
      dot,
    );
    point(pull?.step ?? hovered);
    drawHead();
  }

  const head = svg("line", "pd-chart-head", { y1: 0, y2: HEIGHT });
  function drawHead() {
    if (box.hidden) return;
    const at = String(x(clock.step()));
    head.setAttribute("x1", at);
    head.setAttribute("x2", at);
  }

  // What the pointer is above, or what is pulled: a dot, and its value in words.
  const dot = svg("circle", "pd-speed-dot", { r: 5 });
  let hovered: number | null = null;
  function point(step: number | null) {
    const speed = step === null ? null : speedAt(step);
    dot.style.display = speed === null || step === null ? "none" : "";
    if (speed === null || step === null) {
      value.textContent = "";
      return;
    }
    dot.setAttribute("cx", String(x(step)));
    dot.setAttribute("cy", String(y(speed)));
    dot.classList.toggle("pd-is-past", step < 0);
    const words = step < 0 ? "the past stays" : harshWords(step);
    value.textContent = `${speed.toFixed(1)} m/s at ${inWords(step, track)}${words ? `, ${words}` : ""}`;
  }
  const harshWords = (step: number) => (state.harsh.includes(step) ? "harsh" : "");

  const { ask: tell, stop } = paced(PULL_PAUSE_MS, () => {
    if (!pull) return false;
    api.send({ kind: "pull", step: pull.step, speed: pull.speed });
    return true;
  });
  function end(kind: "release" | "cancel") {
    if (!pull) return;
    stop();
    if (kind === "release" && pull.speed !== pull.from) api.send({ kind: "pull", step: pull.step, speed: pull.speed });
    api.send({ kind });
    pull = null;
    draw();
  }

  box.addEventListener("pointermove", (event) => {
    if (pull) return;
    hovered = stepAt(event);
    point(hovered);
  });
  box.addEventListener("pointerleave", () => {
    hovered = null;
    if (!pull) point(null);
  });
  box.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || pull) return;
    const step = stepAt(event);
    const from = step < 0 ? null : speedAt(step);
    if (from === null) return;
    settleKeys();
    box.setPointerCapture(event.pointerId);
    pull = { id: event.pointerId, step, startY: event.clientY, from, speed: from };
    point(step);
  });
  listen(box, "pointermove", (event) => {
    if (pull?.id !== event.pointerId) return;
    const perPixel = top / (HEIGHT - TOP - BOTTOM);
    const moved = (pull.startY - event.clientY) * perPixel * (event.shiftKey ? FINE : 1);
    const speed = Math.max(Math.round((pull.from + moved) * 10) / 10, 0);
    if (speed === pull.speed) return;
    pull.speed = speed;
    tell();
  });
  followPress(
    () => pull,
    () => end("release"),
    () => end("cancel"),
  );

  // A pull by keys ends after a rest, or with the next press.
  function settleKeys() {
    if (keyRest === undefined) return;
    clearTimeout(keyRest);
    keyRest = undefined;
    api.send({ kind: "release" });
  }
  let keyed = 0;
  box.addEventListener("keydown", (event) => {
    const sign = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    const step = Math.round(clock.step());
    const speed = step < 0 ? null : speedAt(step);
    if (!sign || speed === null || pull) return;
    event.preventDefault();
    event.stopPropagation();
    if (keyRest === undefined) keyed = speed;
    clearTimeout(keyRest);
    keyed = clamp(keyed + sign * KEY_MPS * (event.shiftKey ? FINE : 1), 0, 60);
    api.send({ kind: "pull", step, speed: Math.round(keyed * 100) / 100 });
    keyRest = setTimeout(settleKeys, KEY_REST_MS);
  });

  playheadMoved.listen(drawHead);
  track.drawn.listen(draw);
  // Also when the panel folds, or the bar comes to its width after the curve.
  const resized = new ResizeObserver(draw);
  if (track.box) resized.observe(track.box);
  onDispose(() => resized.disconnect());
  return (next) => {
    if (next.agent !== state.agent) pull = null;
    state = next;
    draw();
  };
});
