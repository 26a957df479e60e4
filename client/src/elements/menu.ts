// The menu at the pointer: a right click that is no drag asks for it.
import { ray } from "../bridge.ts";
import { button, make } from "../dom.ts";
import { define, hearFirst, isOnPicture, listen, local, onView, type Press, pictureSize, take } from "../frame.ts";
import { clamp, distance } from "../geometry.ts";

const STILL_PX = 4;

define("menu", (api) => {
  const list = make("div", "pd-solid pd-menu-list", { role: "menu" });
  list.hidden = true;
  api.box.append(list);
  let press: Press | null = null;

  function close() {
    list.hidden = true;
  }
  function focusBy(steps: number) {
    const all = [...list.querySelectorAll<HTMLElement>("button:not(:disabled)")];
    const index = all.indexOf(document.activeElement as HTMLElement);
    all[(index + steps + all.length) % all.length]?.focus();
  }
  const isInList = (event: Event) => list.contains(event.target as Node);

  hearFirst(
    "pointerdown",
    (event) => {
      if (!isInList(event)) close();
      const isRight = event.button === 2 && isOnPicture(event);
      press = isRight ? { id: event.pointerId, at: [event.clientX, event.clientY] } : null;
    },
    { passive: true },
  );
  const strays = (event: PointerEvent, held: Press) => distance([event.clientX, event.clientY], held.at) > STILL_PX;
  hearFirst(
    "pointermove",
    (event) => {
      if (press && event.pointerId === press.id && strays(event, press)) press = null;
    },
    { passive: true },
  );
  hearFirst(
    "pointerup",
    (event) => {
      if (!press || event.pointerId !== press.id || event.button !== 2) return;
      const isClick = !strays(event, press);
      press = null;
      const at = local(event);
      const seen = isClick ? ray(...at) : null;
      if (seen) api.send({ kind: "open", at, ray: seen });
    },
    { passive: true },
  );
  // The browser's own menu would cover ours, and tells nothing of the scene.
  hearFirst("contextmenu", (event) => {
    if (isOnPicture(event) || isInList(event)) event.preventDefault();
  });
  hearFirst("wheel", close, { passive: true });
  listen(window, "blur", close);
  onView(close);

  hearFirst("keydown", (event) => {
    if (list.hidden) return;
    if (event.key === "Escape") close();
    else if (event.key === "ArrowDown") focusBy(1);
    else if (event.key === "ArrowUp") focusBy(-1);
    else return;
    take(event);
  });

  return ({ number, at, title, items }) => {
    close();
    if (!items.length) return;
    const lines = items.map((item, index) => {
      const choose = () => {
        close();
        api.send({ kind: "choose", index, menu: number });
      };
      const line = button("", "", choose, { role: "menuitem" });
      line.append(make("span", "", {}, item.label));
      if (item.key) line.append(make("span", "pd-menu-key", {}, item.key));
      line.disabled = !item.isEnabled;
      return line;
    });
    list.setAttribute("aria-label", title);
    list.replaceChildren(make("div", "pd-menu-title", {}, title), ...lines);
    list.hidden = false;
    const { width, height } = pictureSize();
    list.style.left = `${clamp(at[0] + 2, 8, width - list.offsetWidth - 8)}px`;
    list.style.top = `${clamp(at[1] + 2, 8, height - list.offsetHeight - 8)}px`;
  };
});
