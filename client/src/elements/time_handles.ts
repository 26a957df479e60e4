// Times of goals, way-points and locks on the track of the timeline; a drag moves one.
import { inWords } from "../clock.ts";
import { make } from "../dom.ts";
import { define, followPress, listen, paced } from "../frame.ts";
import { guidanceIcon } from "../guidance_shapes.ts";
import type { TimeHandle, TimeHandlesState } from "../messages.ts";
import { padlock, track } from "../shared.ts";

const PAUSE_MS = 40;
const STILL_PX = 3;

interface Hold {
  id: number;
  index: number;
  startX: number;
  step: number | null; // null until it moves
}

define("timeHandles", (api) => {
  const lane = make("div", "pd-time-handles");
  track.box?.append(lane);
  let state: TimeHandlesState = { handles: [] };
  let hold: Hold | null = null;
  const width = () => track.box?.offsetWidth ?? 0;

  function picture({ kind, step, text, isChosen }: TimeHandle, index: number) {
    const at = hold?.index === index && hold.step !== null ? hold.step : step;
    const words = hold?.index === index ? `${text.replace(/ [\d.]+ s$/, "")} ${inWords(at, track)}` : text;
    const handle = make("div", `pd-time-handle pd-guide-${kind}`, {
      role: "slider",
      tabindex: 0,
      title: `${words}. Drag it, or press an arrow key`,
      "aria-label": words,
      "aria-valuenow": (at * track.stepS).toFixed(1),
    });
    handle.classList.toggle("pd-is-chosen", isChosen);
    handle.style.left = `${(100 * track.share(at)).toFixed(3)}%`;
    handle.append(kind === "lock" ? padlock() : guidanceIcon(kind, 13));
    handle.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || hold) return;
      event.stopPropagation();
      hold = { id: event.pointerId, index, startX: event.clientX, step: null };
      api.send({ kind: "grab", index });
    });
    handle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!by || hold) return;
      event.preventDefault();
      event.stopPropagation();
      api.send({ kind: "grab", index });
      api.send({ kind: "drop", index, step: step + by * (event.shiftKey ? 10 : 1) });
    });
    return handle;
  }

  function draw() {
    const focus = [...lane.children].indexOf(document.activeElement as Element);
    lane.replaceChildren(...state.handles.map(picture));
    if (focus >= 0) (lane.children[focus] as HTMLElement | undefined)?.focus();
  }

  const { ask, stop } = paced(PAUSE_MS, () => {
    if (hold?.step === null || !hold) return false;
    api.send({ kind: "drag", index: hold.index, step: hold.step });
    return true;
  });
  listen(window, "pointermove", (event) => {
    if (hold?.id !== event.pointerId) return;
    if (hold.step === null && Math.abs(event.clientX - hold.startX) <= STILL_PX) return;
    const left = (track.box?.getBoundingClientRect().left ?? 0) + track.share(0) * width();
    const step = Math.round((event.clientX - left) / ((track.share(1) - track.share(0)) * width() || 1));
    if (step === (hold.step ?? state.handles[hold.index]?.step)) return;
    hold.step = step;
    ask();
    draw();
  });
  function end(kind: "drop" | "cancel") {
    if (!hold) return;
    stop();
    api.send({ kind, index: hold.index, step: kind === "drop" ? hold.step : null });
    hold = null;
    draw();
  }
  followPress(
    () => hold,
    () => end("drop"),
    () => end("cancel"),
  );

  track.drawn.listen(draw);
  return (next) => {
    state = next;
    if (hold && hold.index >= state.handles.length) hold = null;
    draw();
  };
});
