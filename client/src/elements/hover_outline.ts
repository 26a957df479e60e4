// viser outlines what the pointer is on by 10 px of yellow: from above, a blob that hides
// a small car. The outline of agents is made as thin as their size on the screen allows.
import { dragsNode, outline, showBox } from "../bridge.ts";
import { define, listen, markBody } from "../frame.ts";

const WIDTH_PX = 2.5;
const PAUSE_MS = 200;

define("hover_outline", () => {
  let lookedAt = 0;

  // From above viser draws its selection box also while an agent is dragged.
  function hideBox() {
    markBody("pd-holds-agent", dragsNode());
    showBox(!dragsNode());
  }
  // After viser's own listeners, and before the frame is painted.
  for (const type of ["pointermove", "pointerup"] as const)
    listen(window, type, () => requestAnimationFrame(hideBox), { passive: true });

  listen(
    window,
    "pointermove",
    () => {
      const now = performance.now();
      if (now - lookedAt < PAUSE_MS) return;
      lookedAt = now;
      outline("/agents/", WIDTH_PX);
    },
    { passive: true },
  );
});
