// The tooltip of the picture: asked for once when the pointer comes to rest.
import { ray } from "../bridge.ts";
import { make } from "../dom.ts";
import { define, hearFirst, isOnPicture, local, onView, pictureSize } from "../frame.ts";
import { distance, type Pixel } from "../geometry.ts";
import { agentUnderPointer } from "../shared.ts";

const REST_MS = 400;
const STILL_PX = 3;
const GAP_PX = 14;

define("tooltip", (api) => {
  const tip = make("div", "pd-tip", { role: "tooltip" });
  tip.hidden = true;
  api.box.append(tip);
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
    tip.hidden = true;
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
    tip.replaceChildren(...lines.map((line) => make("div", "", {}, line)));
    tip.hidden = false;
    tell(under);
    const { width, height } = pictureSize();
    const left = Math.min(point[0] + GAP_PX, width - tip.offsetWidth - 8);
    const below = point[1] + GAP_PX;
    const fits = below + tip.offsetHeight + 64 < height;
    tip.style.left = `${Math.max(left, 8)}px`;
    tip.style.top = `${fits ? below : point[1] - tip.offsetHeight - GAP_PX}px`;
  };
});
