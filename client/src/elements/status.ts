// The status chip, bottom right, and the list that it opens upwards.
// The chip keeps its place and size whatever it says; the open list only grows.
import { button, hasModifier, icon, make } from "../dom.ts";
import { define, linesWalked, root } from "../frame.ts";
import { clamp } from "../geometry.ts";
import type { ProblemRow, StatusState } from "../messages.ts";

const LINE_PX = 28;
const NOTHING = "No problems with agents, road or guidance.";
const ICONS: Record<string, string> = {
  collision: "M2 6h6v5H2zM9 4l6-1 1 5-6 1zM11.5 11.5l1 2M14 11l2 1M9 12.5l-1 2",
  road: "M6 2 3 16M12 2l3 14M9 3v3M9 8v3M9 13v3",
  speed: "M3 13a7 7 0 1 1 12 0M9 12l4-5",
  against: "M6 15V3M3 6l3-3 3 3M12 3v12M9 12l3 3 3-3",
  goal: "M5 16V3h8l-2 3 2 3H5",
  beyond: "M5 2 3 16M11 2l2 14M8 3v2M8 7v1M5 11h6M15 5l2 3-2 3",
  past: "M9 4v5l3 2M3 9a6 6 0 1 0 2-4.5M3 3v3h3",
  bend: "M4 16c0-7 10-4 10-13M8 16c0-5 10-3 10-13",
};

define("status", (api) => {
  // Groups as a click has left them; else what edits have caused is open, the worst of it.
  const folded: Record<string, boolean> = {};
  let isOpen = false;
  let state: StatusState | null = null;

  const unsaved = make("div", "pd-solid pd-unsaved", { role: "alert" });
  const unsavedText = make("span", "pd-clipped");
  unsaved.append(
    unsavedText,
    button("pd-strong", "Download", () => api.send({ kind: "download" })),
  );

  const list = make("div", "pd-solid pd-problems", { role: "dialog", "aria-label": "Problems" });
  const rows = make("div", "pd-problem-rows");
  const detail = make("div", "pd-problem-detail");
  const sentence = make("div", "pd-problem-sentence", { role: "status" });
  const cures = make("div", "pd-problem-cures");
  detail.append(sentence, cures);
  list.append(rows, detail);

  const chip = make("div", "pd-solid pd-chip");
  const main = button("pd-chip-main", "", () => toggle(!isOpen));
  const text = make("span", "pd-clipped", { role: "status", "aria-label": "Status" });
  const caret = make("span", "pd-caret", {}, "\u25b4");
  main.append(make("span", "pd-dot"), text, caret);
  chip.append(main);
  api.box.append(list, unsaved, chip);

  const items = () => [...rows.querySelectorAll<HTMLElement>(".pd-problem-row")];
  const place = (id: string | undefined) => items().findIndex((item) => item.dataset.problem === id);

  // The share of the picture's width that the list leaves free at its left.
  const free = () => {
    const whole = root.getBoundingClientRect();
    if (!isOpen || !whole.width) return 1;
    return clamp((list.getBoundingClientRect().left - whole.left) / whole.width, 0, 1);
  };
  const choose = (id: string) => api.send({ kind: "choose", value: id, free: free() });

  // The list is as high as its lines, and lower only when it is opened again.
  let mostLines = 0;
  function fit() {
    mostLines = Math.max(mostLines, rows.childElementCount);
    list.style.setProperty("--pd-lines", String(mostLines));
  }

  function toggle(wanted: boolean) {
    const wasOpen = isOpen;
    isOpen = wanted;
    list.hidden = !isOpen;
    if (!wasOpen) mostLines = 0;
    fit();
    if (isOpen !== wasOpen) api.send({ kind: "list", isOpen, free: free() });
    // The hint has its place where the list opens.
    root.classList.toggle("pd-lists-problems", isOpen);
    main.setAttribute("aria-expanded", String(isOpen));
    caret.textContent = isOpen ? "\u25be" : "\u25b4";
  }

  function rowOf(row: ProblemRow) {
    const item = button("pd-problem-row", "", () => choose(row.id), { title: row.hint });
    item.dataset.problem = row.id;
    item.dataset.severity = row.severity;
    item.append(
      icon(ICONS[row.icon] ?? ICONS.collision, 18),
      make("span", "pd-clipped", {}, row.text),
      make("span", "pd-problem-time", {}, row.time),
    );
    return item;
  }

  let drawn = "";
  function drawRows() {
    if (!state) return;
    const wanted = JSON.stringify([state.groups, folded]);
    if (wanted !== drawn) {
      drawn = wanted;
      const top = rows.scrollTop;
      const focused = document.activeElement?.getAttribute("data-problem");
      const groups = state.groups.filter((group) => group.rows.length);
      const parts = groups.flatMap((group, place) => {
        const isFolded = folded[group.name] ?? !(place === 0 && ["new", "notices"].includes(group.name));
        const fold = () => {
          folded[group.name] = !isFolded;
          drawRows();
        };
        const head = button("pd-problem-group", group.title, fold, { "aria-expanded": `${!isFolded}` });
        head.dataset.problem = group.name;
        if (isFolded) return [head];
        const more = make("div", "pd-problem-more", {}, `... and ${group.more} more`);
        return [head, ...group.rows.map(rowOf), ...(group.more ? [more] : [])];
      });
      rows.replaceChildren(...(parts.length ? parts : [make("div", "pd-problem-more", {}, NOTHING)]));
      detail.hidden = !items().length;
      if (isOpen) fit();
      rows.scrollTop = top;
      if (focused) parts.find((part) => part.dataset.problem === focused)?.focus({ preventScroll: true });
    }
    for (const item of items()) item.setAttribute("aria-current", String(item.dataset.problem === state.active?.id));
  }

  // Escape closes the list, also with the focus on the chip that opened it. With the focus
  // elsewhere the server closes it, unless a mode or a gesture ends first.
  api.box.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !isOpen) return;
    toggle(false);
    main.focus();
    event.stopPropagation();
  });
  // Keys walk the rows, and choose them; a page's worth at a time as well.
  api.box.addEventListener("keydown", (event) => {
    if (!isOpen || hasModifier(event)) return;
    const step = linesWalked(event, rows.clientHeight / LINE_PX);
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const all = items();
    if (!all.length) return;
    const at = all.indexOf(document.activeElement as HTMLElement);
    const begin = at < 0 ? place(state?.active?.id) : at;
    const next = all[clamp(begin + step, 0, all.length - 1)];
    next.focus();
    next.scrollIntoView({ block: "nearest" });
    choose(next.dataset.problem ?? "");
  });

  function drawCures() {
    const active = state?.active;
    sentence.textContent = active
      ? [active.message, active.note].filter(Boolean).join(" ")
      : "Choose a row to see it and what helps.";
    const made = (active?.cures ?? []).map((label) =>
      button("pd-strong", label, () => api.send({ kind: "cure", value: label })),
    );
    if (active?.ignore) made.push(button("pd-quiet", active.ignore, () => api.send({ kind: "ignore" })));
    cures.replaceChildren(...made);
  }

  toggle(false);
  let drawnCures = "";
  let numClosed = 0;
  return (next) => {
    if (next.numClosed > numClosed) toggle(false);
    numClosed = next.numClosed;
    const isCuring = cures.contains(document.activeElement);
    const former = place(state?.active?.id);
    state = next;
    chip.dataset.tone = next.tone;
    if (text.textContent !== next.text) text.textContent = next.text;
    text.title = next.text;
    unsaved.hidden = !next.unsaved;
    unsavedText.textContent = unsavedText.title = next.unsaved;
    api.box.classList.toggle("pd-has-unsaved", Boolean(next.unsaved));
    drawRows();
    const wanted = JSON.stringify(next.active);
    if (wanted === drawnCures) return;
    drawnCures = wanted;
    drawCures();
    if (!isCuring || !isOpen) return;
    // Keys go on from the row that was cured, or from the one in its place.
    const all = items();
    const now = place(next.active?.id);
    const row = all[now >= 0 ? now : clamp(former, 0, Math.max(all.length - 1, 0))];
    (row ?? main).focus({ preventScroll: true });
  };
});
