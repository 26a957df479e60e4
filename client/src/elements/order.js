// A press on the picture that follows a tool's button or key waits until the tool is armed.
//
// Modes begin on the server. A press that comes before its answer would mean what presses
// meant before; it is kept, and goes on when the server has answered. This element is
// mounted first, so that it hears of events before viser and before all other elements.
pdOverlay.define("order", (api) => {
  const ARMING = ["bar", "banner-bar", "menu-list", "guidance-tools"]
    .map((name) => `.pd-${name} button`).join();
  const TYPES = ["pointerdown", "pointermove", "pointerup", "pointercancel", "click"];
  let state = { keys: [], labels: [], answered: 0 };
  let asked = 0;
  let press = null;

  // After the message of the button or key itself.
  function ask() {
    asked += 1;
    setTimeout(() => api.send({ number: asked }));
  }
  const isAwaited = () => state.answered < asked;

  function goOn() {
    if (!press || isAwaited()) return;
    // What is there now: the mode may have laid a layer of its own over the picture.
    press.target ??= document.elementFromPoint(press.x, press.y) ?? api.canvas();
    for (const event of press.events.splice(0))
      press.target.dispatchEvent(new event.constructor(event.type, event));
    if (press.isOver) press = null;
  }

  function hear(event) {
    if (!event.isTrusted) return;
    if (!press) {
      if (event.type !== "pointerdown" || event.button !== 0 || !isAwaited()) return;
      if (!api.isOnPicture(event) || api.isPanPress()) return;
      press = { x: event.clientX, y: event.clientY, events: [], isOver: false };
    }
    api.take(event);
    press.events.push(event);
    if (event.type === "pointerup" || event.type === "pointercancel")
      // The click comes at once after it, in the same task.
      setTimeout(() => {
        press.isOver = true;
        goOn();
      });
    goOn();
  }
  for (const type of TYPES) api.listen(window, type, hear, { capture: true });

  api.listen(window, "keydown", (event) => {
    if (event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target?.closest?.("input, textarea, select, [contenteditable]")) return;
    if (state.keys.includes(event.key.toUpperCase())) ask();
  }, { capture: true });
  api.listen(window, "click", (event) => {
    const button = event.target?.closest?.("button");
    if (button?.matches(ARMING) || state.labels.includes(button?.textContent.trim())) ask();
  }, { capture: true });

  return (next) => {
    state = next;
    goOn();
  };
});
