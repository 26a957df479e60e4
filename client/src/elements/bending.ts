// Bending: the place of the road that is pressed follows the pointer aside.
import { ground } from "../bridge.ts";
import { define, modePress, onDigit, paced } from "../frame.ts";
import type { Ground } from "../geometry.ts";

const PULL_MS = 30;

define("bending", (api) => {
  let numKinds = 0;
  const { ask, stop } = paced(PULL_MS, () => {
    if (press.held) api.send({ kind: "pull", point: press.held.point });
    return press.held !== null;
  });
  const press = modePress<{ point: Ground }>("pd-bending", {
    begin(at) {
      const point = ground(...at);
      if (point) api.send({ kind: "grab", point });
      return point && { point };
    },
    drag(held, at) {
      held.point = ground(...at) ?? held.point;
      ask();
    },
    release({ point }) {
      stop();
      api.send({ kind: "pull", point });
      api.send({ kind: "end" });
    },
    giveUp() {
      stop();
      api.send({ kind: "cancel" });
    },
  });
  onDigit(
    () => (press.isOn ? numKinds : 0),
    (number) => api.send({ kind: "kind", number }),
  );

  return (state) => {
    numKinds = state.numKinds;
    press.turn(state.isActive);
  };
});
