// The tooltip of the picture: asked for once when the pointer comes to rest.
import { ray } from "../bridge.ts";
import { define, hearFirst, isOnPicture, local, onView, Tip } from "../frame.ts";
import { distance, type Pixel } from "../geometry.ts";
import { agentUnderPointer } from "../shared.ts";

const REST_MS = 400;
const STILL_PX = 3;

define("tooltip", (api) => {
  const tip = new Tip(api.box);
  let at: Pixel | null = null;
  let timer: ReturnType<typeof setTimeout> | undefined;
  let asks = 0;
  let agent: string | null = null;

  function tell(next: string | null) {
    if (next === agent) return;
    agent = next;
    agentUnderPointer.tell(agent);
  }

  function hide() {
    clearTimeout(timer);
    tip.hide();
    tell(null);
    asks += 1;
  }
  function ask() {
    const seen = at && ray(...at);
    if (!at || !seen) return;
    asks += 1;
    api.send({ at, ray: seen, ask: asks });
  }

  hearFirst(
    "pointermove",
    (event) => {
      const now = isOnPicture(event) && event.buttons === 0 ? local(event) : null;
      if (now && at && distance(now, at) <= STILL_PX) return;
      hide();
      at = now;
      if (now) timer = setTimeout(ask, REST_MS);
    },
    { passive: true },
  );
  for (const type of ["pointerdown", "wheel", "keydown", "blur"] as const) hearFirst(type, hide, { passive: true });
  onView(hide);

  return ({ at: point, lines, agent: under, asked }) => {
    // An answer that comes after the pointer has gone on is of no use.
    if (asked !== asks || !lines.length) return;
    tip.tell(lines, point);
    tell(under);
  };
});
