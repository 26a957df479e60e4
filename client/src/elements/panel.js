// viser's own panel: which of its tabs is open, when the pointer holds one of its
// sliders, how its fields are left, whether its settings are offered, and how its dialogs
// are left.
pdOverlay.define("panel", (api) => {
  const PATIENCE_MS = 8000;
  const RETRY_MS = 250;
  let wanted = null;
  let told = null;
  let startedAt = 0;
  let triedAt = -Infinity;

  const tabs = () => [...document.querySelectorAll("[role=tab]")].filter(
    (tab) => !api.root.contains(tab));
  const isOpen = (tab) => tab.getAttribute("aria-selected") === "true";
  const title = (tab) => tab.textContent.trim();

  // A tab that was open before the page was reloaded is opened once it is there.
  function restore() {
    if (wanted === null) return;
    const now = performance.now();
    const tab = tabs().find((one) => title(one) === wanted);
    if ((tab && isOpen(tab)) || now - startedAt > PATIENCE_MS) wanted = null;
    else if (tab && now - triedAt > RETRY_MS) {
      triedAt = now;
      // viser's docked tabs, which can be dragged, listen to presses and keys.
      tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
      if (!isOpen(tab)) tab.click();
    }
  }

  function tell() {
    restore();
    if (wanted !== null) return;
    const open = tabs().find(isOpen);
    if (!open || title(open) === told) return;
    told = title(open);
    const box = scrolled();
    if (box) box.scrollTop = places.get(told) ?? 0;
    api.send({ kind: "tab", title: told });
  }

  // viser scrolls all tabs as one: each shall be where it was left, at first at its top.
  const places = new Map();
  const scrolled = () => tabs().find(isOpen)?.closest("[data-scrollarea-viewport]");
  api.listen(document, "scroll", (event) => {
    const box = event.target;
    if (told !== null && box !== document && box === scrolled())
      places.set(told, box.scrollTop);
  }, { capture: true });

  // viser tells a slider's values, not that the pointer has let go of it. Outside of the
  // window no pointer tells either: a slider is let go when the window is left.
  let isHeld = false;
  function release() {
    if (!isHeld) return;
    isHeld = false;
    api.send({ kind: "release" });
  }
  api.listen(window, "pointerdown", (event) => {
    release();
    if (event.button !== 0 || api.root.contains(event.target)) return;
    if (!event.target?.closest?.("[class*=Slider-root]")) return;
    isHeld = true;
    api.send({ kind: "hold" });
  }, { capture: true });
  for (const type of ["pointerup", "pointercancel"])
    api.listen(window, type, release, { capture: true });
  // Not in the capture phase: there every element that loses the focus would tell.
  api.listen(window, "blur", release);

  // Enter finishes what is typed: keys are the editor's again, such as Ctrl+Z, by which the
  // browser would else take back the typing.
  const isField = (target) =>
    target?.matches?.("input:not([type=checkbox]):not([type=range])") &&
    target.closest(
      ".mantine-NumberInput-root, .mantine-TextInput-root, .pd-guidance-inputs") &&
    !target.closest("[role=dialog]");
  api.listen(window, "keydown", (event) => {
    if (event.key === "Enter" && !event.isComposing && isField(event.target))
      event.target.blur();
  });

  // viser sends no number of a field that is emptied, so that the number before it stays
  // in force: the field shows it again once it is left.
  const numbers = new WeakMap();
  const isNumber = (text) => text.trim() !== "" && Number.isFinite(Number(text));
  const numberField = (event) => event.target?.closest?.("input.mantine-NumberInput-input");
  api.listen(document, "beforeinput", (event) => {
    const field = numberField(event);
    if (field && isNumber(field.value)) numbers.set(field, field.value);
  }, { capture: true });
  api.listen(document, "focusout", (event) => {
    const field = numberField(event);
    // After viser's own handling, which clears what is no number.
    if (field) setTimeout(() => restoreNumber(field));
  }, { capture: true });
  function restoreNumber(field) {
    if (isNumber(field.value) || !numbers.has(field)) return;
    // As if it were typed, for React keeps the text. The server has this number already,
    // so that nothing is edited.
    const { set } = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
    set.call(field, numbers.get(field));
    field.dispatchEvent(new Event("input", { bubbles: true }));
  }

  // Escape and a press beside a dialog choose its last button, which changes nothing;
  // viser leaves both without an effect.
  function leaveDialog() {
    const dialog = [...document.querySelectorAll(".mantine-Modal-content")].at(-1);
    const buttons = dialog?.querySelectorAll("button") ?? [];
    buttons[buttons.length - 1]?.click();
    return buttons.length > 0;
  }
  api.listen(window, "keydown", (event) => {
    if (event.key === "Escape" && leaveDialog()) event.stopImmediatePropagation();
  }, { capture: true });
  api.listen(window, "click", ({ target }) => {
    if (target?.matches?.(".mantine-Modal-inner, .mantine-Modal-overlay")) leaveDialog();
  }, { capture: true });

  const observer = new MutationObserver(tell);
  api.onDispose(() => {
    observer.disconnect();
    document.body.classList.remove("pd-debug");
  });

  return (state) => {
    document.body.classList.toggle("pd-debug", state.isDebug);
    const open = tabs().find(isOpen);
    if (state.instead && open && title(open) !== state.instead) return;
    wanted = state.tab;
    told = state.instead ?? state.tab;
    startedAt = performance.now();
    observer.observe(document.body, {
      subtree: true, childList: true, attributes: true, attributeFilter: ["aria-selected"],
    });
    tell();
  };
});
