// The timeline: play, t = 0, the track with its playhead, speed and loop.
//
// Steps are counted from the current step, so t = step * stepS. The playhead runs here
// between two messages of the server, which stays the truth.
import { inWords, secondsOf, stepAfter, ticks } from "../clock.ts";
import { button, fill, hasModifier, isTyping, make, svg, within } from "../dom.ts";
import { define, everyFrame, hearFirst, paced } from "../frame.ts";
import { clamp } from "../geometry.ts";
import type { PlayheadState, TimelineEvent, TimelineMark, TimelineState } from "../messages.ts";
import { clock, playheadMoved, track as sharedTrack } from "../shared.ts";

const SCRUB_PAUSE_MS = 40;
const SOON_STEPS = 3;
const LEFT_OPEN = 0.7; // Share of a small gap that stays after a message.

let axis: TimelineState = { firstStep: -50, lastStep: 59, beginStep: -50, endStep: 59, stepS: 0.1, marks: [] };
let head: PlayheadState = { step: 0, isPlaying: false, speed: 1, loops: true };
let since = performance.now();
let isScrubbing = false;
let drawHead = (_step: number) => {};

clock.step = () => stepAfter((performance.now() - since) / 1000, head, axis);

function icon(...shapes: [path: string, isLine: boolean][]): SVGSVGElement {
  const picture = svg("svg", "", { viewBox: "0 0 16 16", width: 16, height: 16 });
  for (const [d, isLine] of shapes)
    picture.append(
      svg(
        "path",
        "",
        isLine ? { d, fill: "none", stroke: "currentColor", "stroke-width": 1.6 } : { d, fill: "currentColor" },
      ),
    );
  return picture;
}
const playIcon = icon(["M4 2.5v11l9.5-5.5z", false]);
const pauseIcon = icon(["M3.5 2.5h3v11h-3z", false], ["M9.5 2.5h3v11h-3z", false]);
const loopIcon = icon(["M4.5 5h6.2a2.8 2.8 0 0 1 0 6H4.8a2.8 2.8 0 0 1-2.6-3.8", true], ["M6.5 1.8v6.4L2.8 5z", false]);

define("timeline", (api) => {
  const bar = make("div", "pd-solid pd-timeline-bar", { role: "group", "aria-label": "Timeline" });
  const action = (name: string, title: string, kind: TimelineEvent["kind"]) =>
    button("", "", () => api.send({ kind }), { "aria-label": name, title });
  const play = action("Play", "Play or pause (Space)", "play");
  const current = action("t = 0", "Go to t = 0, where edits act", "current");
  current.textContent = "t = 0";
  const shown = make("output", "pd-time", { "aria-label": "Time shown" });
  // Marks lie over the track, since a slider holds no buttons.
  const rail = make("div", "pd-rail");
  const named = { role: "slider", "aria-label": "Time", "aria-orientation": "horizontal", tabindex: 0 };
  const track = make("div", "pd-track", named);
  const lane = make("div", "pd-lane");
  const past = make("div", "pd-past");
  const future = make("div", "pd-future");
  lane.append(past, future);
  const scale = make("div", "pd-scale");
  const knob = make("div", "pd-knob");
  const problems = make("div", "pd-marks");
  const hint = make("div", "pd-solid pd-mark-hint", { role: "tooltip" });
  hint.hidden = true;
  track.append(lane, scale, knob);
  rail.append(track, problems, hint);
  const speed = action("Speed", "Speed of playback", "speed");
  speed.classList.add("pd-speed");
  const loop = action("Loop", "Begin again at the end", "loop");
  loop.append(loopIcon);
  bar.append(play, current, shown, rail, speed, loop);
  api.box.append(bar);

  const length = () => Math.max(axis.lastStep - axis.firstStep, 1);
  const inside = (step: number) => clamp(step, axis.firstStep, axis.lastStep);
  const share = (step: number) => (100 * (inside(step) - axis.firstStep)) / length();
  sharedTrack.box = rail;
  sharedTrack.share = (step) => (step - axis.firstStep) / length();

  function drawAxis() {
    const zero = share(0);
    past.style.width = `${zero}%`;
    future.style.left = `${zero}%`;
    future.style.width = `${share(axis.endStep) - zero}%`;
    scale.replaceChildren(
      ...ticks(axis).map((second) => {
        const mark = make("div", second === 0 ? "pd-second pd-zero" : "pd-second");
        mark.style.left = `${share(second / axis.stepS)}%`;
        mark.append(make("span", "", {}, String(second).replace("-", "\u2212")));
        return mark;
      }),
    );
    track.setAttribute("aria-valuemin", secondsOf(axis.firstStep, axis).toFixed(1));
    track.setAttribute("aria-valuemax", secondsOf(axis.lastStep, axis).toFixed(1));
    sharedTrack.stepS = axis.stepS;
    sharedTrack.drawn.tell();
  }

  function markOf({ kind, step, text }: TimelineMark) {
    const what = { problem: "Problem", notice: "Notice", finding: "Finding" }[kind];
    const mark = button(`pd-mark pd-${kind}`, "", () => api.send({ kind, value: step }), {
      "aria-label": `${what} at ${inWords(step, axis)}`,
    });
    mark.style.left = `${share(step)}%`;
    mark.addEventListener("pointerenter", () => {
      hint.textContent = text;
      hint.hidden = false;
      const [half, width] = [hint.offsetWidth / 2, track.offsetWidth];
      hint.style.left = `${clamp((share(step) / 100) * width, half - 90, width - half + 90)}px`;
    });
    mark.addEventListener("pointerleave", () => {
      hint.hidden = true;
    });
    return mark;
  }

  let wasPlaying: boolean | null = null;
  drawHead = (step) => {
    playheadMoved.tell(secondsOf(step, axis));
    knob.style.left = `${share(step)}%`;
    const words = inWords(step, axis);
    if (shown.textContent !== words) {
      shown.textContent = words;
      track.setAttribute("aria-valuenow", secondsOf(step, axis).toFixed(1));
      track.setAttribute("aria-valuetext", words);
    }
    if (wasPlaying !== head.isPlaying) {
      wasPlaying = head.isPlaying;
      play.setAttribute("aria-label", head.isPlaying ? "Pause" : "Play");
      play.replaceChildren(head.isPlaying ? pauseIcon : playIcon);
    }
    speed.textContent = `${head.speed}\u00d7`.replace("-", "\u2212");
    speed.setAttribute("aria-label", `Speed ${speed.textContent}`);
    loop.setAttribute("aria-pressed", String(head.loops));
  };

  // Not the playhead's step, which an earlier answer may still move back.
  let [wanted, sent]: (number | null)[] = [null, null];
  const { ask: tell } = paced(SCRUB_PAUSE_MS, () => {
    if (wanted === null || wanted === sent) return false;
    sent = wanted;
    api.send({ kind: "seek", value: sent });
    return true;
  });
  function scrub(event: PointerEvent) {
    const box = track.getBoundingClientRect();
    const part = (event.clientX - box.left) / Math.max(box.width, 1);
    const step = inside(Math.round(axis.firstStep + part * (axis.lastStep - axis.firstStep)));
    wanted = step;
    head = { ...head, step, isPlaying: false };
    drawHead(step);
    tell();
  }
  track.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    isScrubbing = true;
    sent = null;
    track.setPointerCapture(event.pointerId);
    scrub(event);
  });
  track.addEventListener("pointermove", (event) => {
    if (isScrubbing) scrub(event);
  });
  for (const type of ["pointerup", "pointercancel"] as const)
    track.addEventListener(type, () => {
      isScrubbing = false;
    });

  // Arrow keys step frames, as comma and full stop do, except where they already mean
  // something. They are taken before viser hears them, whose camera would move.
  hearFirst("keydown", (event) => {
    const isOnTrack = event.target === track;
    const steps = { ArrowLeft: -1, ArrowRight: 1, ",": -1, ".": 1, ...(isOnTrack && { PageDown: -10, PageUp: 10 }) }[
      event.key
    ];
    const end = isOnTrack ? { Home: axis.firstStep, End: axis.lastStep }[event.key] : undefined;
    if (!(steps || end !== undefined) || hasModifier(event) || isTyping(event)) return;
    if (within(event, "[role=slider]:not(.pd-track), [role=tab], [role=option], [role=dialog]")) return;
    event.preventDefault();
    event.stopPropagation();
    if (end !== undefined) api.send({ kind: "seek", value: end });
    else if (steps) api.send({ kind: "step", value: steps * (event.shiftKey ? 10 : 1) });
  });

  everyFrame(() => {
    if (head.isPlaying && !isScrubbing) drawHead(clock.step());
  });

  drawAxis();
  drawHead(head.step);
  return (state) => {
    axis = state;
    drawAxis();
    hint.hidden = true;
    fill(problems, state, () => state.marks.map(markOf));
    drawHead(clock.step());
  };
});

define("playhead", () => (state) => {
  if (isScrubbing) return;
  const gap = state.step - clock.step();
  const isRun = state.isPlaying && head.isPlaying && state.speed === head.speed;
  // Messages come late by different times: a small gap is closed bit by bit.
  const isSoon = isRun && Math.abs(gap) < SOON_STEPS;
  head = { ...state, step: isSoon ? state.step - LEFT_OPEN * gap : state.step };
  since = performance.now();
  drawHead(head.step);
});
