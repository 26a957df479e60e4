// Padlocks beside locked agents: as large on the screen at every zoom, and never one on
// another. A closed padlock keeps the whole trajectory, one with a line its first seconds,
// a hollow one the state alone.
import { make } from "../dom.ts";
import { define, onView } from "../frame.ts";
import type { LockMark } from "../messages.ts";
import { circle, padlock } from "../shared.ts";

const SIZE_PX = 18;
const COMPACT_PX = 9; // half the width of an agent that is too narrow for seconds

define("locks", (api) => {
  const plates: { box: HTMLElement; text: HTMLElement }[] = [];
  let locks: readonly LockMark[] = [];

  function plate(index: number) {
    while (plates.length <= index) {
      const box = make("div", "pd-lock", { role: "img" });
      const text = make("span", "pd-lock-seconds");
      box.append(padlock(), text);
      api.box.append(box);
      plates.push({ box, text });
    }
    return plates[index];
  }

  function place() {
    const taken: { left: number; right: number; top: number }[] = [];
    locks.forEach(({ point, radius }, index) => {
      const { box } = plate(index);
      const seen = circle(point, radius);
      box.style.display = seen ? "" : "none";
      if (!seen) return;
      box.classList.toggle("pd-compact", seen.radius < COMPACT_PX);
      // Its upper right corner lies on the lower left side of the agent.
      const right = seen.at[0] - seen.radius * Math.SQRT1_2 + 3;
      const top = seen.at[1] + seen.radius * Math.SQRT1_2 - 3;
      const left = right - box.offsetWidth;
      const isFree = taken.every(
        (other) => left >= other.right || right <= other.left || Math.abs(top - other.top) >= SIZE_PX,
      );
      // Of padlocks that would cover each other, the first one stands for all.
      if (!isFree) {
        box.style.display = "none";
        return;
      }
      taken.push({ left, right, top });
      box.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
    });
    for (const { box } of plates.slice(locks.length)) box.style.display = "none";
  }

  onView(place);
  return (state) => {
    locks = state.locks;
    locks.forEach(({ keeps, seconds, label }, index) => {
      const { box, text } = plate(index);
      box.className = `pd-lock pd-lock-${keeps}`;
      box.setAttribute("aria-label", label);
      if (text.textContent !== seconds) text.textContent = seconds;
    });
    place();
  };
});
