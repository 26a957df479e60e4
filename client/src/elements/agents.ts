// The list of agents: search, sort, filters, selection. Only rows in sight have elements.
//
// Events name agents by their place in the list, with the number of the list that they
// belong to.
import { arranged, type Filter, MARKS, nextOrder, type Order } from "../agent_rows.ts";
import { button, closeButton, hasModifier, isTyping, make, option } from "../dom.ts";
import { define, hearFirst, linesWalked } from "../frame.ts";
import { clamp } from "../geometry.ts";
import type { AgentsState } from "../messages.ts";
import { agentUnderPointer } from "../shared.ts";

const ROW_PX = 24;
const SPARE_ROWS = 4;
const SHAPES: Record<string, string> = {
  vehicle: "box",
  bus: "long",
  pedestrian: "dot",
  cyclist: "peak",
  motorcyclist: "peak",
};
const COLUMNS = [
  ["Agent", "Sort by id", 0],
  ["m/s", "Sort by speed at t = 0", 2],
  ["m", "Sort by distance to the focal agent", 3],
  ["Marks", "Sort by marks", 4],
] as const;

let selected = new Set<number>();
let followSelection = () => {};

define("agents", (api) => {
  let state: AgentsState = { isOpen: false, number: 0, focal: "", ego: "", kinds: [], rows: [] };
  let shown: number[] = [];
  let underPointer: string | null = null;
  const drawer = make("div", "pd-solid pd-agents", { role: "region", "aria-label": "Agent list" });
  drawer.hidden = true;
  const search = make("input", "pd-search", {
    type: "search",
    placeholder: "Search by id, kind, focal, ego",
    "aria-label": "Search agents",
    spellcheck: "false",
    autocomplete: "off",
  });
  const head = make("div", "pd-agents-head");
  head.append(
    search,
    closeButton("Close the agent list", "Ctrl+F", () => api.send({ kind: "close" })),
  );
  const filters = make("div", "pd-agents-filters");
  const filter: Filter = { words: "", moving: false, new: false, kind: -1 };
  for (const [key, text, title] of [
    ["moving", "Moving", "Only agents that move at t = 0"],
    ["new", "New", "Only agents that the recording does not have"],
  ] as const) {
    const toggle = () => {
      filter[key] = !filter[key];
      choice.setAttribute("aria-pressed", String(filter[key]));
      arrange();
    };
    const choice = button("", text, toggle, { "aria-pressed": "false", title });
    filters.append(choice);
  }
  const kindBox = make("select", "", { "aria-label": "Kind" });
  kindBox.addEventListener("change", () => {
    filter.kind = Number(kindBox.value);
    arrange();
  });
  filters.append(kindBox);

  let order: Order = { column: -1, isDown: false };
  const columns = make("div", "pd-agents-columns");
  const headings = COLUMNS.map(([text, title, column]) => {
    const sort = () => {
      order = nextOrder(order, column);
      for (const [place, heading] of headings.entries()) {
        const [word, , other] = COLUMNS[place];
        const sign = order.isDown ? " \u25be" : " \u25b4";
        heading.textContent = word;
        if (other === order.column) heading.append(make("span", "", { "aria-hidden": "true" }, sign));
      }
      arrange();
    };
    return button("", text, sort, { title, "aria-label": `${text}. ${title}` });
  });
  columns.append(...headings);

  const list = make("div", "pd-agents-list", {
    role: "listbox",
    "aria-label": "Agents",
    "aria-multiselectable": "true",
    tabindex: "0",
  });
  const space = make("div", "pd-agents-space");
  list.append(space);
  const count = make("div", "pd-agents-count", { role: "status" });
  const foot = make("div", "pd-agents-foot");
  const alike = () => {
    const kinds = new Set([...selected].map((row) => state.rows[row][1]));
    return [...state.rows.keys()].filter((row) => kinds.has(state.rows[row][1]));
  };
  for (const [text, title, wanted] of [
    ["All", "Select all agents of the list", () => [...shown]],
    ["None", "Select none", () => []],
    ["Invert", "Select the agents of the list that are not selected", () => shown.filter((row) => !selected.has(row))],
    ["Same kind", "Add all agents of the kinds that are selected", alike],
  ] as const)
    foot.append(button("", text, () => choose(wanted()), { title }));
  const lock = () => api.send({ kind: "lock", number: state.number });
  foot.append(button("", "Lock", lock, { title: "Lock or unlock the selected agents (Shift+K)" }));
  drawer.append(head, filters, columns, list, count, foot);
  api.box.append(drawer);

  function choose(rows: number[]) {
    api.send({ kind: "select", number: state.number, rows });
  }

  let anchor: number | null = null;
  let cursor: number | null = null;
  function pick(row: number, event: MouseEvent | KeyboardEvent) {
    const place = shown.indexOf(row);
    const from = anchor === null ? -1 : shown.indexOf(anchor);
    const isAdding = event.ctrlKey || event.metaKey;
    if (event.shiftKey && from >= 0) {
      const range = shown.slice(Math.min(from, place), Math.max(from, place) + 1);
      choose(isAdding ? [...new Set([...selected, ...range])] : range);
    } else {
      anchor = row;
      const others = [...selected].filter((one) => one !== row);
      choose(!isAdding ? [row] : selected.has(row) ? others : [...others, row]);
    }
    cursor = row;
  }

  let pointed: number | null = null;
  function point(row: number | null) {
    if (row === pointed) return;
    pointed = row;
    api.send({ kind: "point", number: state.number, row });
  }

  const pool = new Map<number, HTMLElement>();
  function rowElement(row: number) {
    const [id, kind, speed, distance, marks] = state.rows[row];
    const [word, color] = state.kinds[kind];
    const element = make("div", "pd-agents-row", { role: "option" });
    const glyph = make("span", `pd-glyph pd-${SHAPES[word] ?? "thing"}`, {
      title: word,
      role: "img",
      "aria-label": word,
    });
    glyph.style.background = marks & 1 ? state.focal : marks & 2 ? state.ego : color;
    const name = make("span", "pd-name", { title: `${word} ${id}` }, id);
    const numbers = [speed, distance].map((value) =>
      make("span", "pd-number", {}, value === null ? "\u2013" : value.toFixed(1)),
    );
    const badges = make("span", "pd-badges");
    const own = MARKS.filter(([bit]) => marks & bit);
    for (const [, letter, title, style] of own)
      badges.append(make("span", `pd-badge ${style}`, { title, role: "img", "aria-label": title }, letter));
    element.append(glyph, name, ...numbers, badges);
    element.addEventListener("click", (event) => pick(row, event));
    element.addEventListener("pointerenter", () => point(row));
    pool.set(row, element);
    space.append(element);
    return element;
  }

  function redraw() {
    if (drawer.hidden) return;
    const first = Math.max(0, Math.floor(list.scrollTop / ROW_PX) - SPARE_ROWS);
    const bottom = Math.ceil((list.scrollTop + list.clientHeight) / ROW_PX);
    const wanted = shown.slice(first, bottom + SPARE_ROWS);
    for (const [row, element] of pool)
      if (!wanted.includes(row)) {
        element.remove();
        pool.delete(row);
      }
    wanted.forEach((row, index) => {
      const element = pool.get(row) ?? rowElement(row);
      element.style.top = `${(first + index) * ROW_PX}px`;
      element.setAttribute("aria-selected", String(selected.has(row)));
      element.classList.toggle("pd-lit", state.rows[row][0] === underPointer);
      element.setAttribute("aria-posinset", String(first + index + 1));
      element.setAttribute("aria-setsize", String(shown.length));
    });
    const total = `${shown.length} of ${state.rows.length} listed`;
    count.textContent = `${total}, ${selected.size} selected`;
  }

  function arrange() {
    filter.words = search.value;
    shown = arranged(state.rows, state.kinds, filter, order);
    for (const element of pool.values()) element.remove();
    pool.clear();
    space.style.height = `${shown.length * ROW_PX}px`;
    redraw();
  }

  // One of these rows comes into sight, unless one is in sight already.
  function bringIntoSight(rows: Iterable<number>) {
    const places = [...rows].map((row) => shown.indexOf(row)).filter((place) => place >= 0);
    const top = list.scrollTop;
    const bottom = top + list.clientHeight - ROW_PX;
    const isSeen = (place: number) => place * ROW_PX >= top && place * ROW_PX <= bottom;
    if (!places.length || places.some(isSeen)) return;
    list.scrollTop = places[0] * ROW_PX - list.clientHeight / 2;
  }
  followSelection = () => {
    redraw();
    bringIntoSight(selected);
  };
  agentUnderPointer.listen((agent) => {
    underPointer = agent;
    if (drawer.hidden) return;
    const row = state.rows.findIndex(([id]) => id === agent);
    if (row >= 0) bringIntoSight([row]);
    redraw();
  });

  list.addEventListener("scroll", redraw);
  list.addEventListener("pointerleave", () => point(null));
  list.addEventListener("keydown", (event) => {
    const by = linesWalked(event, list.clientHeight / ROW_PX);
    if (!by || !shown.length) return;
    event.preventDefault();
    event.stopPropagation();
    const place = cursor === null ? -1 : shown.indexOf(cursor);
    const next = clamp(place + by, 0, shown.length - 1);
    pick(shown[next], event);
    const y = next * ROW_PX;
    list.scrollTop = clamp(list.scrollTop, y + ROW_PX - list.clientHeight, y);
  });
  search.addEventListener("input", arrange);
  search.addEventListener("keydown", (event) => {
    event.stopPropagation();
    if (event.key === "ArrowDown") list.focus();
    if (event.key === "Enter" && shown.length) choose([...shown]);
    if (event.key !== "Escape") return;
    if (!search.value) api.send({ kind: "close" });
    search.value = "";
    arrange();
  });
  // The browser's own search would find nothing here.
  hearFirst("keydown", (event) => {
    if (!hasModifier(event) || event.shiftKey || event.altKey) return;
    if (event.key.toLowerCase() !== "f") return;
    event.preventDefault();
    if (isTyping(event)) api.send({ kind: event.target === search ? "close" : "open" });
  });

  return (next) => {
    const wasHidden = drawer.hidden;
    drawer.hidden = !next.isOpen;
    if (!next.isOpen) {
      const focus = document.activeElement;
      if (!wasHidden && drawer.contains(focus)) (focus as HTMLElement).blur();
      return;
    }
    state = next;
    const kinds = state.kinds.map(([name], kind) => option(kind, name));
    kindBox.replaceChildren(option(-1, "All kinds"), ...kinds);
    if (filter.kind >= state.kinds.length) filter.kind = -1;
    kindBox.value = String(filter.kind);
    selected = new Set([...selected].filter((row) => row < state.rows.length));
    arrange();
    if (!wasHidden) return;
    search.focus();
    bringIntoSight(selected);
  };
});

define("agent-selection", () => (state) => {
  selected = new Set(state.rows);
  followSelection();
});
