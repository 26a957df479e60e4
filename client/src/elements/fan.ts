// While possible trajectories are drawn: where the pointer is, to highlight one.
import { ground } from "../bridge.ts";
import { define, hearFirst, isOnPicture, local, paced } from "../frame.ts";
import type { Pixel } from "../geometry.ts";

const PAUSE_MS = 80;

define("fan", (api) => {
  let isShown = false;
  let at: Pixel | null = null;

  const { ask } = paced(PAUSE_MS, () => {
    if (isShown) api.send({ point: at && ground(...at) });
    return isShown;
  });
  hearFirst(
    "pointermove",
    (event) => {
      if (!isShown || event.buttons !== 0) return;
      at = isOnPicture(event) ? local(event) : null;
      ask();
    },
    { passive: true },
  );
  return (state) => {
    isShown = state.isShown;
  };
});
