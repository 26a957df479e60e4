// The sheet of all keys: ? or F1 opens it, Esc, a click beside it or ? closes it.
pdOverlay.define("keys", (api) => {
  const veil = api.make("div", "pd-veil");
  const sheet = api.make("div", "pd-solid pd-sheet", {
    role: "dialog", "aria-modal": "true", "aria-label": "Keys and mouse", tabindex: "-1",
  });
  const columns = api.make("div", "pd-sheet-columns");
  const close = api.make("button", "pd-sheet-close", {
    type: "button", "aria-label": "Close",
  }, "\u00d7");
  sheet.append(close, columns);
  veil.append(sheet);
  veil.hidden = true;
  api.box.append(veil);
  let numOpened = 0;
  let before = null;

  function show(isOpen) {
    if (veil.hidden !== isOpen) return;
    veil.hidden = !isOpen;
    if (isOpen) {
      before = document.activeElement;
      sheet.focus();
    } else {
      before?.focus?.();
    }
  }

  const isTyping = (target) =>
    target?.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(target?.tagName ?? "");
  // In the capture phase: Esc that closes the sheet clears no selection.
  api.listen(window, "keydown", (event) => {
    const asks = event.key === "F1" || (event.key === "?" && !isTyping(event.target));
    if (asks && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      show(veil.hidden);
    } else if (veil.hidden) {
      return;
    } else if (event.key === "Escape") {
      show(false);
    }
    // While the sheet is open no key reaches the editor.
    if (!event.ctrlKey && !event.metaKey) event.stopPropagation();
  }, true);
  veil.addEventListener("pointerdown", (event) => {
    if (event.target === veil) show(false);
  });
  close.addEventListener("click", () => show(false));

  return (state) => {
    columns.replaceChildren(...state.groups.map(({ title, rows }) => {
      const group = api.make("section");
      const list = api.make("dl");
      for (const { keys, does } of rows) {
        const row = api.make("div");
        row.append(api.make("dt", "", {}, keys), api.make("dd", "", {}, does));
        list.append(row);
      }
      group.append(api.make("h2", "", {}, title), list);
      return group;
    }));
    if (state.numOpened > numOpened) show(true);
    numOpened = state.numOpened;
  };
});
