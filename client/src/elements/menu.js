// The menu at the pointer: a right click that is no drag asks for it.
pdOverlay.define("menu", (api) => {
  const STILL_PX = 4;
  const list = api.make("div", "pd-solid pd-menu-list", { role: "menu" });
  list.hidden = true;
  api.box.appendChild(list);
  let press = null;

  function close() {
    list.hidden = true;
  }
  const entries = () => [...list.querySelectorAll("button:not(:disabled)")];
  function focusBy(steps) {
    const all = entries();
    const index = all.indexOf(document.activeElement);
    all[(index + steps + all.length) % all.length]?.focus();
  }

  api.listen(window, "pointerdown", (event) => {
    if (!list.contains(event.target)) close();
    const isRight = event.button === 2 && api.isOnPicture(event);
    press = isRight ? { id: event.pointerId, x: event.clientX, y: event.clientY } : null;
  }, { capture: true, passive: true });
  const strays = (event) =>
    Math.hypot(event.clientX - press.x, event.clientY - press.y) > STILL_PX;
  api.listen(window, "pointermove", (event) => {
    if (press && event.pointerId === press.id && strays(event)) press = null;
  }, { capture: true, passive: true });
  api.listen(window, "pointerup", (event) => {
    if (!press || event.pointerId !== press.id || event.button !== 2) return;
    const isClick = !strays(event);
    press = null;
    const at = api.local(event);
    const ray = isClick && api.ray(...at);
    if (ray) api.send({ kind: "open", at, ray });
  }, { capture: true, passive: true });
  // The browser's own menu would cover ours, and tells nothing of the scene.
  api.listen(window, "contextmenu", (event) => {
    if (api.isOnPicture(event) || list.contains(event.target))
      event.preventDefault();
  }, { capture: true });
  api.listen(window, "wheel", close, { capture: true, passive: true });
  api.listen(window, "blur", close);
  api.onView(close);

  api.listen(window, "keydown", (event) => {
    if (list.hidden) return;
    const steps = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (event.key === "Escape") close();
    else if (steps) focusBy(steps);
    else return;
    api.take(event);
  }, { capture: true });

  return ({ number, at, title, items }) => {
    close();
    if (!items.length) return;
    const head = api.make("div", "pd-menu-title", {}, title);
    const buttons = items.map((item, index) => {
      const button = api.make("button", "", { type: "button", role: "menuitem" });
      button.append(api.make("span", "", {}, item.label));
      if (item.key) button.append(api.make("span", "pd-menu-key", {}, item.key));
      button.disabled = !item.isEnabled;
      button.addEventListener("click", () => {
        close();
        api.send({ kind: "choose", index, menu: number });
      });
      return button;
    });
    list.setAttribute("aria-label", title);
    list.replaceChildren(head, ...buttons);
    list.hidden = false;
    const { clientWidth, clientHeight } = api.canvas();
    const fit = (place, size, room) => Math.max(8, Math.min(place, room - size - 8));
    list.style.left = `${fit(at[0] + 2, list.offsetWidth, clientWidth)}px`;
    list.style.top = `${fit(at[1] + 2, list.offsetHeight, clientHeight)}px`;
  };
});
