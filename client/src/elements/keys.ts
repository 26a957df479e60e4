// The sheet of all keys: ? or F1 opens it, Esc, a click beside it or ? closes it.
import { pressAlso } from "../bridge.ts";
import { button, hasModifier, isTyping, make } from "../dom.ts";
import { define, hearFirst, listen } from "../frame.ts";

define("keys", (api) => {
  const veil = make("div", "pd-veil");
  const sheet = make("div", "pd-solid pd-sheet", {
    role: "dialog",
    "aria-modal": "true",
    "aria-label": "Keys and mouse",
    tabindex: "-1",
  });
  const columns = make("div", "pd-sheet-columns");
  const close = button("pd-sheet-close", "\u00d7", () => show(false), { "aria-label": "Close" });
  sheet.append(close, columns);
  veil.append(sheet);
  veil.hidden = true;
  api.box.append(veil);
  let numOpened = 0;
  let before: HTMLElement | null = null;

  function show(isOpen: boolean) {
    if (veil.hidden !== isOpen) return;
    veil.hidden = !isOpen;
    if (isOpen) {
      before = document.activeElement as HTMLElement | null;
      sheet.focus();
    } else before?.focus?.();
  }

  // Second keys of commands, which stand but once among all commands.
  listen(window, "keydown", (event) => {
    const isCommand = event.ctrlKey || event.metaKey;
    if (event.altKey || event.shiftKey || isTyping(event)) return;
    if (event.key === "Backspace" && !isCommand) pressAlso(event, { key: "Delete", code: "Delete" });
    if (event.key.toLowerCase() === "y" && isCommand) pressAlso(event, { key: "Z", code: "KeyZ", shiftKey: true });
  });

  // In the capture phase: Esc that closes the sheet clears no selection.
  hearFirst("keydown", (event) => {
    const asks = event.key === "F1" || (event.key === "?" && !isTyping(event));
    if (asks && !hasModifier(event)) {
      event.preventDefault();
      show(Boolean(veil.hidden));
    } else if (veil.hidden) return;
    else if (event.key === "Escape") show(false);
    // While the sheet is open no key reaches the editor.
    if (!event.ctrlKey && !event.metaKey) event.stopPropagation();
  });
  veil.addEventListener("pointerdown", (event) => {
    if (event.target === veil) show(false);
  });

  return (state) => {
    columns.replaceChildren(
      ...state.groups.map(({ title, rows }) => {
        const group = make("section");
        const list = make("dl");
        for (const { keys, does } of rows) {
          const row = make("div");
          row.append(make("dt", "", {}, keys), make("dd", "", {}, does));
          list.append(row);
        }
        group.append(make("h2", "", {}, title), list);
        return group;
      }),
    );
    if (state.numOpened > numOpened) show(true);
    numOpened = state.numOpened;
  };
});
