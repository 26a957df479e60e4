// viser's own panel: which of its tabs is open, when the pointer holds one of its
// sliders, how its fields are left, whether its settings are offered, and how its dialogs
// are left.
import * as viser from "../bridge.ts";
import { hasModifier, within } from "../dom.ts";
import { define, hearFirst, listen, markBody, onDispose, root, take } from "../frame.ts";

const PATIENCE_MS = 8000;
const RETRY_MS = 250;
const NAMING_PAUSE_MS = 500;

define("panel", (api) => {
  let wanted: string | null = null;
  let told: string | null = null;
  let startedAt = 0;
  let triedAt = Number.NEGATIVE_INFINITY;
  let isAwaited = false; // The tab that opens takes the focus.

  const tabs = () => [...document.querySelectorAll<HTMLElement>(viser.TAB)].filter((tab) => !root.contains(tab));
  const isOpen = (tab: HTMLElement) => tab.getAttribute("aria-selected") === "true";
  const title = (tab: HTMLElement) => tab.textContent.trim();

  // A tab that was open before the page was reloaded is opened once it is there.
  function restore() {
    if (wanted === null) return;
    const now = performance.now();
    const tab = tabs().find((one) => title(one) === wanted);
    if ((tab && isOpen(tab)) || now - startedAt > PATIENCE_MS) wanted = null;
    else if (tab && now - triedAt > RETRY_MS) {
      triedAt = now;
      viser.openTab(tab);
    }
  }

  // F6 goes to what the open tab offers first, to the run bar, and back to the picture.
  function enter() {
    const open = tabs().find(isOpen);
    const all = [...(scrolled()?.querySelectorAll<HTMLElement>("button, input, select, [tabindex='0']") ?? [])];
    const first = all.find((one) => one.offsetParent && !one.matches(`${viser.TAB}, ${viser.FOLD}, :disabled`));
    (first ?? open)?.focus();
  }
  hearFirst("keydown", (event) => {
    if (event.key !== "F6" || hasModifier(event)) return;
    take(event);
    const focused = document.activeElement as HTMLElement;
    const bar = root.querySelector<HTMLElement>(".pd-solid.pd-run");
    if (bar?.contains(focused)) focused.blur();
    else if (scrolled()?.contains(focused)) bar?.querySelector<HTMLElement>("button:enabled")?.focus();
    else enter();
  });

  function tell() {
    restore();
    if (wanted !== null) return;
    if (isAwaited) enter();
    isAwaited = false;
    const open = tabs().find(isOpen);
    const box = scrolled();
    // The title of a folded panel is a tab outside of it.
    if (!open || !box || title(open) === told) return;
    told = title(open);
    box.scrollTop = places.get(told) ?? 0;
    api.send({ kind: "tab", title: told });
  }

  // viser scrolls all tabs as one: each shall be where it was left, at first at its top.
  const places = new Map<string, number>();
  const scrolled = () => tabs().find(isOpen)?.closest(viser.SCROLLED);
  listen(
    document,
    "scroll",
    ({ target }) => {
      const box = scrolled();
      if (told !== null && box && target === box) places.set(told, box.scrollTop);
    },
    { capture: true },
  );

  // A list that opened as the focus came by would cover what comes after it.
  let pressed = "";
  const note = (event: Event) => {
    pressed = event instanceof KeyboardEvent ? event.key : "";
  };
  for (const type of ["keydown", "pointerdown"] as const) listen(document, type, note, { capture: true });
  const leaveShut = (event: FocusEvent) => {
    if (pressed === "Tab" && within(event, viser.LIST)) event.stopPropagation();
  };
  listen(document, "focusin", leaveShut, { capture: true });

  // viser tells a slider's values, not that the pointer has let go of it. Outside of the
  // window no pointer tells either: a slider is let go when the window is left.
  let isHeld = false;
  function release() {
    if (!isHeld) return;
    isHeld = false;
    api.send({ kind: "release" });
  }
  hearFirst("pointerdown", (event) => {
    release();
    if (event.button !== 0 || root.contains(event.target as Node)) return;
    if (!within(event, viser.SLIDER)) return;
    isHeld = true;
    api.send({ kind: "hold" });
  });
  hearFirst("pointerup", release);
  hearFirst("pointercancel", release);
  // Not in the capture phase: there every element that loses the focus would tell.
  listen(window, "blur", release);

  // Enter finishes what is typed: keys are the editor's again, such as Ctrl+Z, by which the
  // browser would else take back the typing.
  listen(window, "keydown", (event) => {
    if (event.key !== "Enter" || event.isComposing || !(event.target instanceof HTMLInputElement)) return;
    const field = event.target;
    if (field.matches("[type=checkbox], [type=range]") || field.closest("[role=dialog]")) return;
    if (field.closest(`${viser.FIELD}, .pd-guidance-inputs, .pd-run`)) field.blur();
  });

  // Fields of numbers drop characters that they do not take and read the rest: 15 for "1.5"
  // where numbers are whole. So what is typed stays until the field is left; it is taken
  // then if it is a number of the field's kind, and otherwise the number before it stays.
  // viser sends no number of a field that is emptied: the last one is in force.
  const numbers = new WeakMap<HTMLInputElement, { first: string; last: string }>();
  const held = new WeakSet<HTMLInputElement>();
  const numberField = (event: Event) => within(event, viser.NUMBER) as HTMLInputElement | null;
  const numberIn = (text: string) => {
    const plain = text.trim().replace(",", ".").replace("\u2212", "-");
    return plain ? Number(plain) : Number.NaN;
  };
  function settle(field: HTMLInputElement) {
    const { value: text, validity } = field;
    const [number, { first, last }] = [numberIn(text), numbers.get(field) ?? { first: "", last: "" }];
    const [isHeld, isWhole] = [held.delete(field), viser.isWhole(field)];
    if (Number.isFinite(number) && (Number.isInteger(number) || !isWhole)) {
      if (isHeld) viser.typeInto(field, String(number));
    } else if (text || validity.badInput) {
      viser.typeInto(field, first);
      const title = field.ariaLabel ?? field.labels?.[0]?.textContent ?? "";
      api.send({ kind: "refused", title, typed: text, kept: first, isWhole });
    } else if (text !== last && field.type !== "number") viser.typeInto(field, last);
  }
  hearFirst("beforeinput", (event) => {
    const field = numberField(event);
    if (field?.type === "number" && event.data?.includes(",")) {
      event.preventDefault();
      document.execCommand("insertText", false, event.data.replaceAll(",", "."));
    }
    if (!field || held.has(field) || !Number.isFinite(numberIn(field.value))) return;
    // The server may have given it another one.
    if (field.value !== numbers.get(field)?.last) numbers.set(field, { first: field.value, last: field.value });
  });
  hearFirst("input", (event) => {
    const field = numberField(event);
    if (!field || !event.isTrusted) return;
    const text = field.value;
    held.delete(field);
    const isRead = field.type === "number" || (viser.isWhole(field) ? /^-?\d*$/ : /^-?\d*\.?\d*$/).test(text);
    if (!isRead) {
      held.add(field);
      event.stopImmediatePropagation();
    } else if (Number.isFinite(numberIn(text))) numbers.set(field, { first: "", ...numbers.get(field), last: text });
  });
  hearFirst("keydown", (event) => {
    const field = numberField(event);
    if (field && held.has(field) && ["ArrowUp", "ArrowDown"].includes(event.key)) settle(field);
  });
  hearFirst("change", (event) => {
    const field = numberField(event);
    if (field) settle(field);
  });
  hearFirst("focusout", (event) => {
    const field = numberField(event);
    if (!field) return;
    if (field.type !== "number") settle(field);
    numbers.delete(field);
  });

  // Escape and a press beside a dialog choose its last button, which changes nothing;
  // viser leaves both without an effect.
  function leaveDialog(): boolean {
    const dialog = [...document.querySelectorAll(viser.DIALOG)].at(-1);
    const last = [...(dialog?.querySelectorAll("button") ?? [])].at(-1);
    last?.click();
    return last !== undefined;
  }
  hearFirst("keydown", (event) => {
    if (event.key === "Escape" && leaveDialog()) event.stopImmediatePropagation();
  });
  hearFirst("click", ({ target }) => {
    if (target instanceof Element && target.matches(viser.BESIDE_DIALOG)) leaveDialog();
  });

  // viser's folds hear the mouse alone.
  hearFirst("keydown", (event) => {
    if (!(event.target as Element).matches?.(viser.FOLD) || ![" ", "Enter"].includes(event.key)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    (event.target as HTMLElement).click();
  });

  // Beside the panel there would be no picture.
  if (innerWidth < 760) api.send({ kind: "narrow" });

  let naming: ReturnType<typeof setTimeout> | undefined;
  const observer = new MutationObserver(() => {
    tell();
    viser.hideNeedless();
    naming ??= setTimeout(() => {
      naming = undefined;
      viser.nameControls();
    }, NAMING_PAUSE_MS);
  });
  onDispose(() => {
    observer.disconnect();
    clearTimeout(naming);
    markBody("pd-debug", false);
  });

  return (state) => {
    markBody("pd-debug", state.isDebug);
    wanted = state.tab;
    told = state.tab;
    isAwaited = state.takesFocus;
    startedAt = performance.now();
    observer.observe(document.body, {
      subtree: true,
      childList: true,
      attributes: true,
      attributeFilter: ["aria-selected", "inert"],
    });
    tell();
  };
});
