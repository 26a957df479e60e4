// Bending: the place of the road that is pressed follows the pointer aside.
//
// While the mode is on, left presses on the picture belong to it, as in "placing".
import { ground } from "../bridge.ts";
import {
  define,
  followPress,
  hearFirst,
  isModePress,
  local,
  markBody,
  onDigit,
  onDispose,
  paced,
  take,
} from "../frame.ts";
import type { Ground } from "../geometry.ts";
import type { BendingState } from "../messages.ts";

const PULL_MS = 30;

define("bending", (api) => {
  let mode: BendingState | null = null;
  let press: { id: number; point: Ground } | null = null;

  const { ask, stop } = paced(PULL_MS, () => {
    if (press) api.send({ kind: "pull", point: press.point });
    return press !== null;
  });

  hearFirst("pointerdown", (event) => {
    if (!mode?.isActive || !isModePress(event)) return;
    take(event);
    const point = ground(...local(event));
    if (!point) return;
    press = { id: event.pointerId, point };
    api.send({ kind: "grab", point });
  });

  hearFirst("pointermove", (event) => {
    if (!press || event.pointerId !== press.id) return;
    press.point = ground(...local(event)) ?? press.point;
    ask();
  });

  function end(kind: "end" | "cancel") {
    if (!press) return;
    stop();
    press = null;
    api.send({ kind });
  }
  followPress(
    () => press,
    (_event, { point }) => {
      api.send({ kind: "pull", point });
      end("end");
    },
    () => end("cancel"),
  );
  onDigit(
    () => (mode?.isActive ? mode.numKinds : 0),
    (number) => api.send({ kind: "kind", number }),
  );

  onDispose(() => markBody("pd-bending", false));
  return (state) => {
    if (!state.isActive) end("cancel");
    mode = state;
    markBody("pd-bending", state.isActive);
  };
});
