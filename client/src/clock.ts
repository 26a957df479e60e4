// Steps and seconds of the timeline, without the page.
import type { PlayheadState, TimelineState } from "./messages.ts";

/** At most so many seconds have a number on the track. */
const MOST_TICKS = 24;

export const secondsOf = (step: number, axis: Pick<TimelineState, "stepS">): number => step * axis.stepS;

/** A time as the page shows it, with a true minus sign. */
export function inWords(step: number, axis: Pick<TimelineState, "stepS">): string {
  const seconds = Math.abs(secondsOf(step, axis)).toFixed(1);
  return `${step < 0 && seconds !== "0.0" ? "\u2212" : ""}${seconds} s`;
}

/** The step that is shown so many seconds after a message of the server. */
export function stepAfter(
  seconds: number,
  head: PlayheadState,
  { beginStep, endStep, stepS }: Pick<TimelineState, "beginStep" | "endStep" | "stepS">,
): number {
  if (!head.isPlaying) return head.step;
  const step = head.step + (seconds / stepS) * head.speed;
  const sign = Math.sign(head.speed);
  const [ahead, behind] = sign > 0 ? [endStep, beginStep] : [beginStep, endStep];
  const passed = sign * (step - ahead);
  if (passed <= 0) return step;
  const length = endStep - beginStep;
  return !head.loops || length <= 0 ? ahead : behind + sign * (passed % length);
}

/** Whole seconds that are marked on the track. */
export function ticks(axis: TimelineState): number[] {
  const first = Math.ceil(secondsOf(axis.firstStep, axis) - 1e-6);
  const last = Math.floor(secondsOf(axis.lastStep, axis) + 1e-6);
  const every = Math.max(1, Math.ceil((last - first) / MOST_TICKS));
  const all = Array.from({ length: last - first + 1 }, (_, index) => first + index);
  return all.filter((second) => second % every === 0);
}
