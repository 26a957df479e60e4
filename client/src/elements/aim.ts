// A tool by keys: arrows move a cross over the picture, and Enter presses there as the mouse
// would; where a tool asks for a drag, one Enter presses and the next one lets go.
import { canvas } from "../bridge.ts";
import { hasModifier, isTyping, svg, within } from "../dom.ts";
import { define, hearFirst, pictureSize, take } from "../frame.ts";
import { clamp, type Pixel } from "../geometry.ts";

const STEP_PX = 6;
const FAR = 10; // times as far with Shift
const POINTER_ID = -36; // no pointer of the browser
const CLICKED = "body:is(.pd-guiding, .pd-crosshair)";
const DRAGGED = "body:is(.pd-drawing-region, .pd-bending)";
const MEASURED = ".pd-measure-layer:not(.pd-gone)";

define("aim", (api) => {
  const cross = svg("svg", "pd-aim", { viewBox: "-12 -12 24 24", "aria-hidden": "true" });
  for (const name of ["pd-aim-halo", ""]) cross.append(svg("path", name, { d: "M-11 0H-3M3 0H11M0 -11V-3M0 3V11" }));
  api.box.append(cross);
  let at: Pixel | null = null;
  let isHeld = false;

  const target = (): Element | null =>
    document.querySelector(MEASURED) ?? (document.querySelector(`${CLICKED}, ${DRAGGED}`) ? canvas() : null);

  function show(next: Pixel | null) {
    at = next;
    if (!at) isHeld = false;
    cross.classList.toggle("pd-aims", at !== null);
    if (at) cross.style.transform = `translate(${at[0] - 12}px, ${at[1] - 12}px)`;
  }

  function tell(type: "pointermove" | "pointerdown" | "pointerup" | "click") {
    const box = canvas()?.getBoundingClientRect();
    if (!at || !box) return;
    const place = { clientX: box.left + at[0], clientY: box.top + at[1], pointerId: POINTER_ID, detail: 1 };
    const held = { button: type === "pointermove" ? -1 : 0, buttons: Number(isHeld) };
    target()?.dispatchEvent(new PointerEvent(type, { ...place, ...held, bubbles: true, cancelable: true }));
  }

  function press() {
    const isDrag = document.querySelector(DRAGGED) !== null;
    if (!isHeld) {
      isHeld = true;
      tell("pointerdown");
      if (isDrag) return;
    }
    isHeld = false;
    tell("pointerup");
    if (document.querySelector(MEASURED)) tell("click");
  }

  hearFirst("keydown", (event) => {
    if (!target() || event.key === "Escape") show(null);
    if (!target() || hasModifier(event) || isTyping(event)) return;
    if (event.key === "Enter" && at) {
      take(event);
      press();
      return;
    }
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!by || within(event, "[role=slider], [role=tab], [role=option], [role=listbox], [role=dialog]")) return;
    take(event);
    const { width, height } = pictureSize();
    const [x, y] = at ?? [width / 2, height / 2];
    const far = STEP_PX * (event.shiftKey ? FAR : 1);
    show([clamp(x + by[0] * far, 0, width), clamp(y + by[1] * far, 0, height)]);
    tell("pointermove");
  });
  // The mouse has the tool again.
  hearFirst("pointermove", (event) => {
    if (event.isTrusted && at && !isHeld) show(null);
  });
});
