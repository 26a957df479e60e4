// While possible trajectories are drawn: where the pointer is, to highlight one.
pdOverlay.define("fan", (api) => {
  const PAUSE_MS = 80;
  let isShown = false;
  let at = null;
  let timer = null;

  function tell() {
    timer = null;
    if (isShown) api.send({ point: at && api.ground(...at) });
  }
  api.listen(window, "pointermove", (event) => {
    if (!isShown || event.buttons !== 0) return;
    at = api.isOnPicture(event) ? api.local(event) : null;
    timer ??= setTimeout(tell, PAUSE_MS);
  }, { capture: true, passive: true });
  return (state) => { isShown = state.isShown; };
});
