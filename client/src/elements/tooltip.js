// The tooltip of the picture: asked for once when the pointer comes to rest.
pdOverlay.define("tooltip", (api) => {
  const REST_MS = 400;
  const STILL_PX = 3;
  const GAP_PX = 14;
  const tip = api.make("div", "pd-tip", { role: "tooltip" });
  tip.hidden = true;
  api.box.appendChild(tip);
  let at = null;
  let timer = null;
  let asks = 0;
  let agent = null;

  // Other elements, the agent list among them, light up what the pointer rests on.
  function tell(next) {
    if (next === agent) return;
    agent = next;
    window.dispatchEvent(new CustomEvent("pd-agent-under-pointer", { detail: agent }));
  }

  function hide() {
    clearTimeout(timer);
    tip.hidden = true;
    tell(null);
    asks += 1;
  }
  function ask() {
    const ray = at && api.ray(...at);
    if (!ray) return;
    asks += 1;
    api.send({ kind: "rest", at, ray, ask: asks });
  }

  api.listen(window, "pointermove", (event) => {
    const isOver = api.isOnPicture(event) && event.buttons === 0;
    const now = isOver ? api.local(event) : null;
    if (now && at && Math.hypot(now[0] - at[0], now[1] - at[1]) <= STILL_PX) return;
    hide();
    at = now;
    if (now) timer = setTimeout(ask, REST_MS);
  }, { capture: true, passive: true });
  for (const type of ["pointerdown", "wheel", "keydown", "blur"])
    api.listen(window, type, hide, { capture: true, passive: true });
  api.onView(hide);

  return ({ at: point, lines, agent: under, asked }) => {
    // An answer that comes after the pointer has gone on is of no use.
    if (asked !== asks || !lines.length) return;
    tip.replaceChildren(...lines.map((line) => api.make("div", "", {}, line)));
    tip.hidden = false;
    tell(under);
    const { clientWidth, clientHeight } = api.canvas();
    const left = Math.min(point[0] + GAP_PX, clientWidth - tip.offsetWidth - 8);
    const below = point[1] + GAP_PX;
    const fits = below + tip.offsetHeight + 64 < clientHeight;
    tip.style.left = `${Math.max(left, 8)}px`;
    tip.style.top = `${fits ? below : point[1] - tip.offsetHeight - GAP_PX}px`;
  };
});
