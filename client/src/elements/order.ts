// A press on the picture that follows a tool's button or key waits until the tool is armed.
//
// Modes begin on the server. A press that comes before its answer would mean what presses
// meant before; it is kept, and goes on when the server has answered. This element is
// mounted first, so that it hears of events before viser and before all other elements.
import { canvas } from "../bridge.ts";
import { hasModifier, isTyping, within } from "../dom.ts";
import { define, hearFirst, isOnPicture, isPanPress, take } from "../frame.ts";
import type { OrderState } from "../messages.ts";

const ARMING = ["bar", "banner-bar", "menu-list", "guidance-tools"].map((name) => `.pd-${name} button`).join();
const TYPES = ["pointerdown", "pointermove", "pointerup", "pointercancel", "click"] as const;

interface KeptPress {
  x: number;
  y: number;
  events: PointerEvent[];
  isOver: boolean;
  target?: Element | null;
}

define("order", (api) => {
  let state: OrderState = { keys: [], labels: [], answered: 0 };
  let asked = 0;
  let press: KeptPress | null = null;

  // After the message of the button or key itself.
  function ask() {
    asked += 1;
    setTimeout(() => api.send({ number: asked }));
  }
  const isAwaited = () => state.answered < asked;

  function goOn() {
    if (!press || isAwaited()) return;
    // What is there now: the mode may have laid a layer of its own over the picture.
    press.target ??= document.elementFromPoint(press.x, press.y) ?? canvas();
    for (const event of press.events.splice(0)) {
      const Same = event.constructor as typeof PointerEvent;
      press.target?.dispatchEvent(new Same(event.type, event));
    }
    if (press.isOver) press = null;
  }

  function hear(event: PointerEvent) {
    if (!event.isTrusted) return;
    if (!press) {
      if (event.type !== "pointerdown" || event.button !== 0 || !isAwaited()) return;
      if (!isOnPicture(event) || isPanPress()) return;
      press = { x: event.clientX, y: event.clientY, events: [], isOver: false };
    }
    take(event);
    press.events.push(event);
    if (event.type === "pointerup" || event.type === "pointercancel")
      // The click comes at once after it, in the same task.
      setTimeout(() => {
        if (press) press.isOver = true;
        goOn();
      });
    goOn();
  }
  for (const type of TYPES) hearFirst(type, (event) => hear(event as PointerEvent));

  hearFirst("keydown", (event) => {
    if (event.repeat || hasModifier(event) || isTyping(event)) return;
    if (state.keys.includes(event.key.toUpperCase())) ask();
  });
  hearFirst("click", (event) => {
    const button = within(event, "button");
    if (button?.matches(ARMING) || state.labels.includes(button?.textContent.trim() ?? "")) ask();
  });

  return (next) => {
    state = next;
    goOn();
  };
});
